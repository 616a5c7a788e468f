"""The test that an engine flies, as its operator sees it: which manoeuvre, how long still, what a hand has to do."""

from typing import Any

from rovtwin.live.manoeuvres import Cue, Prompter, plan
from rovtwin.runs.compose.experiment import spans_of
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.schema.experiment import Manoeuvre as Section
from rovtwin.scenario.schema.experiment import MultisineSection, ReleaseSection

LEFT_STANDING = 3.0  # a cue that begins nothing is shown so long [s]


class Manoeuvres:
    """A test's time-line in words.

    Attributes:
        running: Whether its time goes on.
    """

    def __init__(self, scenario: Scenario):
        """Of a scenario with a test."""
        assert scenario.test is not None
        self._scenario, self._test, self._dt = scenario, scenario.test, scenario.control_dt
        self._spans = spans_of(scenario)
        self._prompter = Prompter(scenario)
        self._ticks, self._cue, self.running = 0, _ready(scenario), False
        self._row, self._ended = 0, ""

    @property
    def count(self) -> int:
        """Of manoeuvres."""
        return len(self._test.manoeuvres)

    @property
    def time(self) -> float:
        """Of the test [s]."""
        return self._ticks * self._dt

    @property
    def duration(self) -> float:
        """Of the whole test [s]."""
        return self._spans[-1]["end"]

    def begin(self) -> None:
        """From the first manoeuvre."""
        self._prompter = Prompter(self._scenario)
        self._ticks, self._row, self._ended, self.running = 0, 0, "", True

    def tick(self) -> list[Cue]:
        """One more tick of it; what is said now."""
        prompt = self._prompter.at(self.time)
        self._cue = prompt[-1] if prompt else self._cue
        while self._row + 1 < len(self._spans) and self.time >= self._spans[self._row]["end"] - 1e-9:
            self._row += 1
        self._ticks += 1
        return prompt

    def end(self, how: str) -> None:
        """It is over; `how` is for people."""
        if self.running:
            self.running, self._ended = False, how
            self._cue = Cue(self.time, f"{how}: thrusters are off", False)

    def laid_out(self) -> dict[str, Any]:
        """What does not change: its manoeuvres with their stretches, in order, and when [s]."""
        rows = []
        for i, section in enumerate(self._test.manoeuvres):
            own = [span for span in self._spans if span["manoeuvre"] == i]
            rows.append({"what": _describe(section), "start": own[0]["start"], "end": own[-1]["end"], "pieces": own})
        by_hand = [what for _, what in plan(self._scenario) if what.startswith("BY HAND")]
        description = self._test.description or self._scenario.description
        name, duration = self._test.name, self.duration
        return {
            "name": name,
            "description": description,
            "duration": duration,
            "manoeuvres": rows,
            "by_hand": by_hand,
        }

    def report(self) -> dict[str, Any]:
        """Where it is now."""
        span, t = self._spans[self._row], min(self.time, self.duration)
        lasting = bool(self._cue.begins) or not self.running or t - self._cue.t < LEFT_STANDING
        return {
            "manoeuvre": span["manoeuvre"],
            "of": self.count,
            "what": span["what"],
            "remaining": max(span["end"] - t, 0.0),
            "cue": _large(self._cue.text) if lasting else span["what"],
            "hand": lasting and self._cue.hand,
            "t": t,
            "duration": self.duration,
            "running": self.running,
            "ended": self._ended,
        }


def _ready(scenario: Scenario) -> Cue:
    """What stands there before a test is started."""
    before = [what for _, what in plan(scenario)][:1]
    if before and "before you arm" in before[0]:
        return Cue(0.0, before[0], True)
    return Cue(0.0, "Arm, then Start", False)


def _large(text: str) -> str:
    """A cue by itself, where nobody sees what was said before."""
    return f"let go in {text}" if text.isdigit() else text


def _describe(section: Section) -> str:
    """A manoeuvre in a few words."""
    if isinstance(section, ReleaseSection):
        roll, pitch = section.attitude_deg
        return f"release at {roll:g}, {pitch:g} deg"
    axes = ", ".join(section.axes) if isinstance(section, MultisineSection) else getattr(section, "axis", "")
    return f"{section.manoeuvre} {axes}".strip()
