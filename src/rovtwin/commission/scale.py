"""Scale: a pull on a scale says what newtons are; no motion can tell the common scale of all forces and masses."""

import json
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.commission.stage import Check, Outcome
from rovtwin.commission.work import Work
from rovtwin.core.numerics import jnp
from rovtwin.core.user_files.files import write_text
from rovtwin.live.connect import on_this_machine
from rovtwin.live.pulses import Guard, Pulse, fly_pulses
from rovtwin.report.plans.bollard import draw_bollard
from rovtwin.vehicle import Model
from rovtwin.vehicle.constants import AXES, GRAVITY
from rovtwin.vehicle.physics.thrusters import static_force

DIRECTIONS = ("surge", "sway", "heave")
WORDS = {"surge": ("ahead", "stern"), "sway": ("to starboard", "port side"), "heave": ("down", "top")}
SECONDS, SETTLED, RISE = 10.0, 4.0, 1.0  # of a pull, after which it is read, and in which it grows [s]
GROWING = (0.2, 0.4, 0.6, 0.8)  # so that the line does not jerk
SURE, RESOLVED, AFLOAT = 0.02, 0.005, 2.0  # sd: share of the reading, of the scale's range, of net buoyancy [N]
TIPPED, CLEAR = float(np.radians(25.0)), 0.1  # on a line that slipped: tilt [rad] and room above the floor [m]
USED = 0.8  # of the scale's range at most
LEAST = 0.5  # command below which a pull says little of full thrust
ODD, WRONG = 0.2, 2.0  # difference from the file that warns, factor that stops
OTHERS = (("kilograms", GRAVITY), ("grams", 1e-3 * GRAVITY), ("pounds", 0.4536 * GRAVITY))
READINGS = "readings.json"  # of an attempt, written as they are typed
LOST = (
    "nobody pulled on a scale: the scale of all forces and masses is known only as well as the file's thrust curve; "
    "ratios of forces to each other, and so motion, are not touched"
)


@dataclass(frozen=True)
class Pull:
    """One pull.

    Attributes:
        direction: Of DIRECTIONS.
        command: Of all thrusters that help.
        u: Commands of the thrusters.
        expected: Reading of the scale by the file [N].
        lift: Net buoyancy that the scale reads too little by [N]; 0 but in heave.
    """

    direction: str
    command: float
    u: Float[np.ndarray, " n"]
    expected: float
    lift: float


@dataclass(frozen=True)
class Reading:
    """What the person read.

    Attributes:
        direction: Of DIRECTIONS.
        command: Of the pull.
        force: On the scale [N].
        most: The scale's largest reading [N].
    """

    direction: str
    command: float
    force: float
    most: float


def run(work: Work) -> Outcome:
    """Ask for one pull in surge, and for more if the person likes; readings of an attempt that broke off are kept."""
    model = work.vehicle.model()
    able = [name for name in DIRECTIONS if pull_of(model, name, 1.0).expected > 1.0]
    if not able:
        return _without("no thruster pushes along an axis")
    kept = [one for one in before_the_break(work) if one.direction in able]
    words = ", ".join(f"{one.force:.3g} N in {one.direction}" for one in kept)
    if kept and work.person.confirm(f"Before the break the scale read {words}. Is that still right, and to be used"):
        page = _Page(work, kept[-1].most)
        page.checks.append(Check("note", "readings", f"{words}: read in an attempt before the break"))
        for one in kept:
            page.take(pull_of(model, one.direction, one.command), one)
    else:
        if kept:  # who doubts them is not asked again
            write_text(work.folder / READINGS, "[]")
        most = _largest_reading(work, model, able)
        if most is None:
            return _without("there is no scale")
        page, kept = _Page(work, most), []
    for name in able:
        if name in {one.direction for one in kept}:
            continue
        if page.anchors and not work.person.confirm(f"One more pull, in {name}? It makes the scale better known"):
            continue
        if not page.pull(model, name):
            break
    return page.outcome()


def before_the_break(work: Work) -> list[Reading]:
    """Newest readings of attempts that were not passed, of the vehicle as it is described now."""
    attempts = work.dossier.attempts("scale")
    now = next((one for one in attempts if one.folder == work.folder), None)
    if now is None:
        return []
    for last in reversed(attempts[: attempts.index(now)]):
        if last.fingerprint != now.fingerprint or (last.outcome is not None and last.outcome.go):
            break
        try:
            return [Reading(**row) for row in json.loads((last.folder / READINGS).read_text(encoding="utf-8"))]
        except (OSError, ValueError, TypeError):  # nothing was read, or half of it
            continue
    return []


def _largest_reading(work: Work, model: Model, able: list[str]) -> float | None:
    forces = ", ".join(f"{pull_of(model, name, 1.0).expected:.0f} N in {name}" for name in able)
    return work.person.number(
        "A spring balance or luggage scale gives all forces their size. By its file the vehicle pulls "
        f"{forces} at full command. Up to what force does your scale read",
        "N",
    )


class _Page:
    """Pulls so far, on one scale."""

    def __init__(self, work: Work, most: float):
        """`most` is the largest force that the scale reads [N]."""
        self._work, self._most, self._seconds = work, most, 0.0
        self.checks: list[Check] = []
        self.anchors: list[dict[str, Any]] = []
        self.files: list[str] = []
        self._readings: list[Reading] = []

    def pull(self, model: Model, name: str) -> bool:
        """Pull once, and take the reading; whether the next one may come."""
        pull = within(model, name, self._most)
        if pull is None:
            text = f"the scale's {self._most:g} N are too few for a pull in {name}"
            return self._noted(Check("note", name, text))
        self.files.append(_picture(self._work, pull))
        found = _pulled(self._work, pull)
        if isinstance(found, Check):
            return self._noted(found)
        self._seconds += found
        reading = self._work.person.number(f"What did the scale read, its middle, while it pulled in {name}", "N")
        if reading is None:
            return self._noted(Check("note", name, "no reading: this pull counts for nothing"))
        return self.take(pull, Reading(name, pull.command, reading, self._most))

    def take(self, pull: Pull, reading: Reading) -> bool:
        """Judge a reading and keep it at once; whether the next one may come."""
        if good := self._noted(judged(pull, reading.force)):
            self.anchors.append(anchor(pull, reading.force, reading.most))
            self._readings.append(reading)
            text = json.dumps([asdict(one) for one in self._readings])
            write_text(self._work.folder / READINGS, text)
        return good

    def _noted(self, check: Check) -> bool:
        self.checks.append(check)
        return check.verdict != "stop"

    def outcome(self) -> Outcome:
        """The page of the stage."""
        made = Outcome(tuple(self.checks), {"anchors": self.anchors}, tuple(self.files), self._seconds)
        return replace(made, skipped=LOST) if made.go and not self.anchors else made


def pull_of(model: Model, direction: str, command: float) -> Pull:
    """All thrusters that help, each at the command, as an identification takes the pull to be."""
    axis = AXES.index(direction)
    row = np.asarray(model.thrusters.configuration)[axis]
    u = command * np.sign(np.where(np.abs(row) > 0.05 * np.abs(row).max(initial=0.0), row, 0.0))
    force = float((model.thrusters.configuration @ static_force(model.thrusters, jnp.asarray(u)))[axis])
    lift = float(model.buoyancy - model.weight) if direction == "heave" else 0.0
    return Pull(direction, command, u, force - lift, lift)


def within(model: Model, direction: str, most: float) -> Pull | None:
    """The strongest pull that a scale can read, in steps of a tenth; None where that is too weak to say much."""
    for tenth in range(10, round(10 * LEAST) - 1, -1):
        pull = pull_of(model, direction, tenth / 10)
        if 0.0 < pull.expected <= USED * most:
            return pull
    return None


def judged(pull: Pull, reading: float) -> Check:
    """A reading against what the file predicts."""
    text = f"read {reading:.3g} N at {pull.command:.0%}, expected {pull.expected:.3g} N by the file"
    ratio = reading / pull.expected
    if 1.0 / WRONG <= ratio <= WRONG:
        if abs(ratio - 1.0) > ODD:
            fix = "Is the file's thrust right for this battery and water? The reading is used."
            return Check("warning", pull.direction, f"{text}.", fix)
        return Check("ok", pull.direction, text)
    unit, newtons = min(OTHERS, key=lambda one: abs(np.log(max(ratio, 1e-9) * one[1])))
    if 1.0 / WRONG <= ratio * newtons <= WRONG:
        fix = f"If the scale shows {unit}, it is {reading * newtons:.3g} N: repeat this stage, and type that."
        return Check("stop", pull.direction, f"{text}.", fix)
    fix = (
        "Was the line taut, did all thrusters turn, was the scale at zero before? Repeat the dip (--stage dip), or "
        "mend the thrusters' force in the vehicle file."
    )
    return Check("stop", pull.direction, f"{text}: off by more than a factor of {WRONG:g}.", fix)


def anchor(pull: Pull, reading: float, most: float) -> dict[str, Any]:
    """As `identify(anchors=)` takes it; what buoyancy took from the scale is put back."""
    parts = [SURE * reading, RESOLVED * most, AFLOAT if pull.direction == "heave" else 0.0]
    data = {"direction": pull.direction, "command": pull.command, "force": reading + pull.lift}
    return {"bollard": data | {"sd": float(np.linalg.norm(parts))}}


def _without(why: str) -> Outcome:
    return Outcome((Check("note", "scale", f"{why}: no pull"),), {"anchors": []}, skipped=LOST)


def _picture(work: Work, pull: Pull) -> str:
    name = f"pull_{pull.direction}.png"
    draw_bollard(pull.direction, pull.command, SECONDS, pull.expected).savefig(work.folder / name, dpi=150)
    return name


def _pulled(work: Work, pull: Pull) -> float | Check:
    """Seconds that it pulled, or why it did not."""
    way, end = WORDS[pull.direction]
    if on_this_machine(work.request.link):
        work.person.say(f"{pull.direction}: a twin hangs on no line: its thrusters stay off")
        return 0.0
    tied = "a beam above the water" if pull.direction == "heave" else "a fixed point at the wall"
    for line in (
        f"Picture: {work.folder / f'pull_{pull.direction}.png'}",
        f"Set the scale to zero. Tie the {end} to it, and the scale to {tied}: 1 to 2 m of line, taut, in line with "
        "the middle of the vehicle, which is under water.",
        f"It will pull {way} at {pull.command:.0%} for {SECONDS:g} s. Read the middle of the needle once "
        f"{SETTLED:g} s have passed: about {pull.expected:.0f} N.",
    ):
        work.person.say(line)
    model = work.vehicle.model()
    scenario = work.scenario({"test": {"manoeuvres": [{"manoeuvre": "rest"}]}})  # of its sensors; nothing flies it
    steps = [Pulse("growing", share * pull.u, RISE / len(GROWING)) for share in GROWING]
    with work.connected(scenario) as there:
        flown = fly_pulses(
            scenario,
            there.link,
            there.sources,
            there.clock,
            work.folder / f"pull_{pull.direction}",
            [*steps, Pulse(f"pulling {way}", pull.u, SECONDS)],
            Guard(TIPPED, work.request.room.depth - float(np.asarray(model.hull.corners)[:, 2].max()) - CLEAR),
            lambda: work.may_move(f"Tied, and hands away? May the thrusters pull {way} for {SECONDS:g} s?"),
            lambda t, what: work.person.progress(what, min(t / (RISE + SECONDS), 1.0)),
        )
    work.at_rest()
    if not flown.spans:
        return Check("stop", pull.direction, f"nothing was pulled: {flown.ended}.", "Repeat this stage.")
    if flown.ended:
        return Check("stop", pull.direction, f"the pull ended early: {flown.ended}.", "Then repeat this stage.")
    return flown.spans[-1][1]
