"""The test of a scenario as a time-line of commands, tick by tick, and the hand that tilts the vehicle."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import GO, HOLD, IDLE
from rovtwin.core.frames import rotation_from_euler
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.gnc.experiment import SPRING, Experiment, HoldingGains, Timeline, mixing
from rovtwin.gnc.safety.supervisor import Supervisor
from rovtwin.runs.compose.sensors import displaced
from rovtwin.runs.compose.supervisor import THESIS_RULES, rules_of
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.schema.experiment import (
    AXES,
    DoubletsSection,
    Manoeuvre,
    MultisineSection,
    ReleaseSection,
    RestSection,
    StepsSection,
)
from rovtwin.simulation.events.attitude_restraint import AttitudeRestraint
from rovtwin.simulation.sensors.sensor import Sensor
from rovtwin.vehicle import Model, Vehicle

FADE = 1.0  # of a multi-sine at both ends [s]
PAD_TICKS, PAD_ROWS = 6000, 64  # tests share shapes, and so one compilation
HOME = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of a test under one rule.

    Attributes:
        share: Command asked for on each axis.
        hold, keep: As in `Timeline`; not a number where the spring is the vehicle's own.
        on: Whether thrusters may run.
        phase: One of core.flow.PHASES.
        what: For people.
        manoeuvre: Its number.
        attitude_deg: Of a release: roll and pitch at which it is let go.
        by_hand: Whether a hand tilts the vehicle to them.
    """

    share: Float[np.ndarray, "ticks 6"]
    hold: Float[np.ndarray, "6"] = field(default_factory=HOME.copy)
    keep: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(6))
    on: bool = True
    phase: int = HOLD
    what: str = "home"
    manoeuvre: int = 0
    attitude_deg: tuple[float, float] | None = None
    by_hand: bool = False


def experiment_of(scenario: Scenario, model: Model, vehicle: Vehicle, sensors: dict[str, Sensor]) -> Experiment:
    """The Block that flies the scenario's test with the sensors that are on board.

    Raises:
        ConfigError: An axis along which the vehicle's thrusters cannot push, or more test than `duration` lets fly.
    """
    pieces = pieces_of(scenario)
    _require_axes(scenario, model, vehicle)
    seconds = sum(len(piece.share) for piece in pieces) * scenario.control_dt
    if seconds > scenario.duration:
        raise ConfigError(
            f"{scenario.name}: duration: found {scenario.duration:g} s, but the test takes {seconds:.0f} s; "
            f"write duration: {math.ceil(seconds + 1)}"
        )
    # A test has no filter that could hold station or come home: whatever ends it switches the thrusters off.
    rules = rules_of(scenario, model, sensors, THESIS_RULES).only_stop()
    springs = SPRING * np.asarray(HoldingGains.of(model).stiffness)
    return Experiment.of(model, _timeline(pieces, springs), Supervisor(rules), displaced(sensors), _home(scenario))


def _home(scenario: Scenario) -> Float[Array, "4"] | None:
    """Place and heading that the test comes home to where that is not where it starts."""
    if scenario.test is None or not scenario.test.home_at_start:
        return None
    return as_array([*scenario.start.position, scenario.heading])


def hand_of(scenario: Scenario) -> AttitudeRestraint | None:
    """Who tilts the vehicle before its releases; None where nobody does."""
    spans, turns = [], []
    for span, piece in zip(spans_of(scenario), pieces_of(scenario), strict=True):
        if piece.by_hand and piece.attitude_deg is not None:
            roll, pitch = (math.radians(angle) for angle in piece.attitude_deg)
            spans.append((span["start"], span["end"]))
            turns.append(rotation_from_euler(jnp.asarray([roll, pitch, scenario.heading])))
    return AttitudeRestraint(np.array(spans), jnp.stack(turns)) if spans else None


def spans_of(scenario: Scenario) -> list[dict[str, Any]]:
    """What happens when, for the log: manoeuvre, what, start, end [s], and whether a hand touches the vehicle."""
    spans, k = [], 0
    for piece in pieces_of(scenario):
        start, k = k, k + len(piece.share)
        times = {"start": start * scenario.control_dt, "end": k * scenario.control_dt}
        spans.append({"manoeuvre": piece.manoeuvre, "what": piece.what, **times, "hand": piece.by_hand})
    return spans


def needs_position(scenario: Scenario) -> bool:
    """Whether a test looks at its horizontal position: on the way home, by a spring on surge or sway, or in a pause."""
    pauses = any(request.ask in ("pause", "arm") for request in scenario.operator)
    return pauses or any(piece.hold[:2].any() or piece.keep[:2].any() for piece in pieces_of(scenario))


def pieces_of(scenario: Scenario) -> list[Piece]:
    """The whole test, in order."""
    assert scenario.test is not None
    dt, pieces = scenario.control_dt, []
    for i, section in enumerate(scenario.test.manoeuvres):
        own = _pieces(section, dt)
        own += [_quiet(section.home, HOME, dt, "home")] if section.home else []
        own += [_quiet(section.settle, _held(section), dt, "settle")] if section.settle else []
        pieces += [replace(piece, manoeuvre=i) for piece in own]
    return pieces


def _pieces(section: Manoeuvre, dt: float) -> list[Piece]:
    """One manoeuvre, without what comes after it."""
    match section:
        case StepsSection():
            return _steps(section, dt)
        case DoubletsSection():
            half = np.full(_ticks(section.half, dt), section.level)
            return [_pull(section, section.axis, np.tile(np.concatenate([half, -half]), section.repeat))]
        case MultisineSection():
            return [_multisine(section, dt)]
        case ReleaseSection():
            return _release(section, dt)
        case RestSection():
            return [_quiet(section.duration, _held(section), dt, "rest")]


def _steps(section: StepsSection, dt: float) -> list[Piece]:
    pieces, n = [], _ticks(section.duration, dt)
    for level in section.levels:
        for sign in (1.0, -1.0) if section.alternate else (1.0,):
            pieces.append(_pull(section, section.axis, np.full(n, sign * level), f" {sign * level:+g}"))
        if section.between:
            pieces.append(_quiet(section.between, HOME, dt, "home"))
    return pieces


def _pull(
    section: StepsSection | DoubletsSection, axis: str, values: Float[np.ndarray, " ticks"], detail: str = ""
) -> Piece:
    """One axis gets values; the others are held as the section says."""
    share = np.zeros((len(values), 6))
    share[:, AXES.index(axis)] = values
    hold = _held(section)
    hold[AXES.index(axis)] = 0.0
    return Piece(share, hold, phase=GO, what=f"{section.manoeuvre} {axis}{detail}")


def _multisine(section: MultisineSection, dt: float) -> Piece:
    n = _ticks(section.duration, dt)
    t, share, keep, hold = np.arange(n) * dt, np.zeros((n, 6)), np.zeros(6), _held(section)
    fade = np.sin(0.5 * np.pi * np.clip(np.minimum(t, t[-1] - t) / FADE, 0.0, 1.0)) ** 2
    for axis, sines in section.axes.items():
        at = AXES.index(axis)
        phases = _phases(sines.phases_deg, len(sines.frequencies_hz), section.seed + 1000 * at)
        amplitudes = np.broadcast_to(sines.amplitudes, phases.shape)
        angles = 2.0 * np.pi * np.outer(t, sines.frequencies_hz) + phases
        share[:, at] = fade * (np.sin(angles) @ amplitudes)
        keep[at] = np.nan if section.keep is None else section.keep
        keep[at] = 0.0 if axis in ("roll", "pitch") else keep[at]
        hold[at] = 0.0
    return Piece(share, hold, keep, phase=GO, what=f"multisine {', '.join(section.axes)}")


def _phases(given: list[float] | None, count: int, seed: int) -> Float[np.ndarray, " count"]:
    """Phases of sines [rad]: as given, or drawn."""
    return np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, count) if given is None else np.radians(given)


def _release(section: ReleaseSection, dt: float) -> list[Piece]:
    roll, pitch = section.attitude_deg
    free = np.zeros((_ticks(section.duration, dt), 6))
    what = f"release at {roll:g}, {pitch:g} deg"
    decay = Piece(free, np.zeros(6), on=False, phase=GO, what=what, attitude_deg=(roll, pitch))
    if not section.by_hand:
        return [decay]
    held = np.zeros((_ticks(section.by_hand, dt), 6))
    return [replace(decay, share=held, phase=IDLE, what="hand", by_hand=True), decay]


def _quiet(seconds: float, hold: Float[np.ndarray, "6"], dt: float, what: str) -> Piece:
    return Piece(np.zeros((_ticks(seconds, dt), 6)), hold, what=what)


def _held(section: Manoeuvre) -> Float[np.ndarray, "6"]:
    hold = np.zeros(6)
    hold[[2, 5]] = "depth" in section.hold, "heading" in section.hold
    return hold


def _ticks(seconds: float, dt: float) -> int:
    return max(1, round(seconds / dt))


def _timeline(pieces: list[Piece], spring: Float[np.ndarray, "6"]) -> Timeline:
    """The arrays of the Block, padded; `spring` is the vehicle's own."""
    count = sum(len(piece.share) for piece in pieces)
    share, row = np.zeros((-(-count // PAD_TICKS) * PAD_TICKS, 6)), np.zeros(-(-count // PAD_TICKS) * PAD_TICKS, int)
    share[:count] = np.concatenate([piece.share for piece in pieces])
    row[:count] = np.repeat(np.arange(len(pieces)), [len(piece.share) for piece in pieces])

    def rows(values: list[Any], kind: type = float) -> Shaped[np.ndarray, "rows ..."]:
        given = np.array(values, dtype=kind)
        out = np.zeros((-(-len(given) // PAD_ROWS) * PAD_ROWS, *given.shape[1:]), dtype=kind)
        out[: len(given)] = given
        return out

    return Timeline(
        share=as_array(share),
        row=as_array(row, int),
        hold=as_array(rows([piece.hold for piece in pieces])),
        keep=as_array(rows([np.where(np.isnan(piece.keep), spring, piece.keep) for piece in pieces])),
        on=as_array(rows([piece.on for piece in pieces], bool), bool),
        manoeuvre=as_array(rows([piece.manoeuvre for piece in pieces], int), int),
        phase=as_array(rows([piece.phase for piece in pieces], int), int),
        count=as_array(count, int),
    )


def _require_axes(scenario: Scenario, model: Model, vehicle: Vehicle) -> None:
    """ConfigError where a manoeuvre asks for an axis that thrusters cannot push."""
    assert scenario.test is not None
    able = np.abs(mixing(model)).max(axis=0, initial=0.0) > 0
    known = ", ".join(name for name, can in zip(AXES, able, strict=True) if can)
    for i, one in enumerate(scenario.test.manoeuvres):
        axes = list(one.axes) if isinstance(one, MultisineSection) else [getattr(one, "axis", None)]
        for axis in axes:
            if axis is not None and not able[AXES.index(axis)]:
                hint = "; tilt it by hand instead (manoeuvre: release)" if axis in ("roll", "pitch") else ""
                raise ConfigError(
                    f"{scenario.name}: test.manoeuvres[{i}]: the thrusters of {vehicle.name} cannot push in {axis}, "
                    f"expected one of {known}{hint}"
                )
