"""The exercises: a push that turns or moves the vehicle, and in the middle of it what must switch thrusters off."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.commission.dip.schedule import foreseen, shares_along
from rovtwin.commission.work import Work
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import COMMAND_LIFE, Link
from rovtwin.links.remote_link import RemoteLink
from rovtwin.live.connect import may_be_watched
from rovtwin.live.pulses import Guard, Pulse, Pulsed, fly_pulses
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.physics.model import Model

REST, PUSH = 2.0, 1.2  # before the push, and of it before the event [s]
AROUND = 2.0 * np.pi  # largest turn that a push may lead to, if nothing ends it [rad]
TRIED = ("yaw", "heave", "surge", "sway")  # a turn needs no room
SIZES = (0.8, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05)  # of commands that are tried, the clearest first


@dataclass(frozen=True)
class Exercise:
    """One way in which thrusters must come to rest.

    Attributes:
        name: As in the figures.
        words: What happens, for people.
        within: Longest time to thrusters off [s].
        watched: How long readings are looked at after the event [s].
        culprit: Who failed if they are not.
    """

    name: str
    words: str
    within: float
    watched: float
    culprit: str


STOP = Exercise("stop", "STOP", 0.5, 2.5, "The link does not hand STOP on: see its page under docs/links.")
SILENT = Exercise(
    "silent",
    "the program that steers falls silent",
    COMMAND_LIFE + 0.5,
    2.5,
    "Commands do not expire: another client may steer the vehicle too.",
)
CUT = Exercise(
    "cut",
    "the line to the vehicle is cut",
    5.0,
    6.0,
    "Set the vehicle's own watchdog: ArduSub's FS_PILOT_INPUT or FS_GCS_ENABLE; a Blueye has 2 s built in.",
)


@dataclass(frozen=True, eq=False)
class Push:
    """What is pushed in the exercises.

    Attributes:
        axis: Of AXES, the direction that is pushed most.
        u: Command.
    """

    axis: str
    u: Float[np.ndarray, " n"]


def push_of(model: Model, exercise: Exercise, later: float = 0.0) -> Push | None:
    """The clearest push that the model foresees to be harmless even if nothing ends it; None where there is none.

    Args:
        model: Of the vehicle.
        exercise: How long it is watched.
        later: By how much later it can be stopped [s].
    """
    for axis in TRIED:
        shares = shares_along(model, AXES.index(axis))
        if shares is None:
            continue
        for size in SIZES:
            if foreseen(model, size * shares, PUSH + exercise.watched + later, AROUND):
                return Push(axis, size * shares)
    return None


class Seen(Link):
    """A vehicle that one line steers and another one watches, so that it is seen while the first is cut."""

    def __init__(self, steered: Link, watched: Link):
        self._steered, self._watched = steered, watched

    @property
    def age(self) -> float:
        return self._watched.age

    def read(self) -> list[Measurement]:
        return self._watched.read()

    def arm(self) -> None:
        self._steered.arm()

    def send(self, command: Command) -> None:
        self._steered.send(command)

    def stop(self) -> None:
        self._steered.stop()

    def close(self) -> None:
        self._watched.close()
        self._steered.close()


def flown(
    work: Work, scenario: Scenario, exercise: Exercise, push: Push, model: Model, cut_at: list[float] | None = None
) -> Pulsed:
    """One exercise, logged, after a yes of its own; thrusters are off at its end, but for a line that was cut.

    A line that is cut and that nobody watches beside it ends in "link lost".

    Args:
        work: Of the stage.
        scenario: Of the test water.
        exercise: What ends the push.
        push: That is ended.
        model: Of the vehicle.
        cut_at: Gets the time at which a line was cut [s, monotonic].

    Raises:
        ConfigError: The link cannot be cut.
        LinkError: The vehicle is not there, or is silent.
    """
    question = (
        f"Drill, {exercise.words}: it is pushed in {push.axis} at {np.abs(push.u).max():.0%} for {PUSH:g} s, then its "
        "thrusters must rest by themselves. Is it in the middle of the tank below the surface, tether slack, and are "
        "all hands away?"
    )
    with ExitStack() as stack:
        there = stack.enter_context(work.connected(scenario))
        link, event = there.link, _nothing
        if exercise is STOP:
            event = link.stop
        elif exercise is CUT:
            event = _cutting(there.link, [] if cut_at is None else cut_at)
            if may_be_watched(work.request.link):
                watching = stack.enter_context(work.connected(scenario, observe=True, beside=there))
                link = Seen(there.link, watching.link)
        pulses = [
            Pulse("at rest", 0.0 * push.u, REST),
            Pulse(f"pushing in {push.axis}", push.u, PUSH),
            Pulse(exercise.words, None, exercise.watched, event),
        ]
        seconds = sum(pulse.seconds for pulse in pulses)
        return fly_pulses(
            scenario, link, there.sources, there.clock, work.folder / exercise.name, pulses, _guard(work, model),
            lambda: work.may_move(question), lambda t, what: work.person.progress(what, min(t / seconds, 1.0)),
        )  # fmt: skip


def halted(work: Work, scenario: Scenario) -> str:
    """Stop the vehicle over a new line, whatever it does; why that failed, "" if it did not."""
    try:
        with work.connected(scenario) as there:
            there.link.arm()
            there.link.stop()
    except RovtwinError as error:
        return str(error)
    return ""


def _nothing() -> None: ...


def _guard(work: Work, model: Model) -> Guard:
    lowest = float(np.asarray(model.hull.corners)[:, 2].max())
    return Guard(deepest=work.request.room.depth - lowest + 0.1)


def _cutting(link: Link, cut_at: list[float]) -> Callable[[], None]:
    """What cuts a line, and notes when."""
    if not isinstance(link, RemoteLink):
        raise ConfigError("this link is held by no process of its own, which could be ended")

    def cut() -> None:
        cut_at.append(time.monotonic())
        link.cut()

    return cut
