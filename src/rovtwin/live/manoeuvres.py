"""What the operator of a test, who alone can tilt a vehicle, gets: the plan before arming, each step as it comes.

Nothing here moves anything: it is the test's own time-line, in words.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rovtwin.runs.compose.experiment import Piece, pieces_of, spans_of
from rovtwin.scenario.schema import Scenario

NOTICE = 5.0  # a hand is warned that its turn comes so long before [s]
COUNTED = (3, 2, 1)  # before it lets go [s]
REACTION = 0.5  # asked to let go, a hand has gone after this [s]: identification leaves out what it still did


@dataclass(frozen=True)
class Cue:
    """A line for the operator.

    Attributes:
        t: When it is said, test time [s].
        text: The line.
        hand: Whether it is about what a hand has to do.
        begins: What of the test begins with it, "" if nothing does.
    """

    t: float
    text: str
    hand: bool = False
    begins: str = ""


class Prompter:
    """Gives the cues of a test as their time comes; a mission has none.

    Attributes:
        now: What of the test goes on, "" before it begins.
    """

    def __init__(self, scenario: Scenario):
        self._due = deque(cues_of(scenario))
        self.now = ""

    def at(self, t: float) -> list[Cue]:
        """The cues up to test time t [s] that were not given yet."""
        given = []
        while self._due and self._due[0].t <= t + 1e-9:
            given.append(self._due.popleft())
            self.now = given[-1].begins or self.now
        return given


def cues_of(scenario: Scenario) -> list[Cue]:
    """All that is said during a test, in order of time; nothing during a mission."""
    cues: list[Cue] = []
    for piece, span in _pieces(scenario):
        start, end, what = span["start"], span["end"], span["what"]
        if piece.by_hand:
            tilt = attitude_text(piece)
            if start > 0.0:
                cues.append(Cue(max(0.0, start - NOTICE), f"soon by hand: {tilt}. Wait for the word", True))
            cues.append(Cue(start, f"TILT IT, thrusters are off: {tilt}. Hold it still", True, what))
            cues += [Cue(end - n, f"{n}", True) for n in COUNTED if end - n > start]
        elif piece.attitude_deg is not None:
            cues.append(Cue(start, f"LET GO, hands away: {what}, {end - start:.3g} s", True, what))
        else:
            cues.append(Cue(start, f"{what}, {end - start:.3g} s", False, what))
    return sorted(cues, key=lambda cue: cue.t)


def plan(scenario: Scenario) -> list[tuple[float, str]]:
    """Before it is flown: from when [s], and what; a test that begins with a release says first what it takes."""
    lines = [
        (span["start"], f"BY HAND: {attitude_text(piece)}" if piece.by_hand else span["what"])
        for piece, span in _pieces(scenario)
    ]
    if tilted := _begins_tilted(scenario):
        return [
            (0.0, f"BY HAND, before you arm: {attitude_text(tilted)}. Hold it until you are asked to let go"),
            *lines,
        ]
    return lines


def touched_spans(scenario: Scenario) -> list[dict[str, Any]]:
    """`spans_of` as a person flies it: a hand lets go REACTION after it is asked to."""
    spans = spans_of(scenario)
    for hand, release in zip(spans, spans[1:], strict=False):
        if hand["hand"]:
            hand["end"] += REACTION
            release["start"] = hand["end"]
    if _begins_tilted(scenario):
        held = spans[0] | {"what": "hand", "end": REACTION, "hand": True}
        return [held, spans[0] | {"start": REACTION}, *spans[1:]]
    return spans


def attitude_text(piece: Piece) -> str:
    """Roll and pitch of a release for people, who know sides and no signs."""
    roll, pitch = piece.attitude_deg or (0.0, 0.0)
    angles = [f"{abs(roll):g} deg with the {'starboard' if roll > 0 else 'port'} side down"] if roll else []
    angles += [f"{abs(pitch):g} deg with the bow {'up' if pitch > 0 else 'down'}"] if pitch else []
    return " and ".join(angles) or "level"


def _begins_tilted(scenario: Scenario) -> Piece | None:
    """The release that a test begins with, for which nobody is given time."""
    first = pieces_of(scenario)[0] if scenario.test else None
    return first if first is not None and first.attitude_deg is not None and not first.by_hand else None


def _pieces(scenario: Scenario) -> Iterator[tuple[Piece, dict[str, Any]]]:
    if scenario.test:
        yield from zip(pieces_of(scenario), spans_of(scenario), strict=True)
