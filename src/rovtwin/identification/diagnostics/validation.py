"""Held-out tests: the model runs on its own from a measured state, and what it says is held against the readings.

Never one step ahead: a prediction runs open loop through the whole record, or for windows of some seconds.
Fit is 100 (1 - |y - y_hat| / |y - mean(y)|) percent: 100 is perfect, 0 as good as the mean, negative worse.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.frames import euler_from_quaternion, quaternion_multiply, wrap
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.identification.joint.model.nodes import Nodes, undisturbed
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.segments import Grid, Segments, cut, nodes_from_data, whole_steps
from rovtwin.identification.joint.solver.shooting import Shooting
from rovtwin.identification.logs.record import SIGNALS, Record

_MOVED = 3.0  # times the noise: what spreads less has stood still
_PUSHED = 0.01  # of the full force of all thrusters along an axis: what is asked for less is not excited by them
_AXES = {"velocity": (0, 1, 2), "gyro": (3, 4, 5), "attitude": (3, 4, 5)}
_PASSES = 12  # what no sensor measures travels from window to window, one window a pass


@dataclass(frozen=True)
class Score:
    """Of one component.

    Attributes:
        fit: [%].
        rms: Of prediction less reading, in the signal's unit.
        hold: The same, had the first reading of each window been held.
        still: The same for predicting zero, where that makes sense (rates and velocities), else NaN.
    """

    fit: float
    rms: float
    hold: float
    still: float


@dataclass(frozen=True, eq=False)
class Prediction:
    """One record predicted.

    Attributes:
        record: Its name.
        window: Seconds after which the state is measured anew; None: never.
        readings: By signal: times (n,), measured (n, k), predicted (n, k).
        scores: By component, `gyro.p`.
        excited: Whether the component moved beyond the noise and thrusters pushed along it; a fit of what stood still,
            or was moved by something else, means nothing.
    """

    record: str
    window: float | None
    readings: dict[str, tuple[Float[np.ndarray, " _"], Float[np.ndarray, "_ _"], Float[np.ndarray, "_ _"]]]
    scores: dict[str, Score]
    excited: dict[str, bool]


def judged(prediction: Prediction) -> list[str]:
    """Components by which a model is judged: rates and velocities that moved, without such all that moved.

    Positions and headings drift in open loop, however good the model.
    """
    moved = [c for c in prediction.scores if prediction.excited[c]]
    return [c for c in moved if c.split(".")[0] in ("gyro", "velocity")] or moved


def predict(
    parameters: Parameters,
    theta: Float[np.ndarray, " n"],
    records: Sequence[Record],
    window: float | None = None,
    step: float = 0.02,
    offsets: dict[str, Float[np.ndarray, " _"]] | None = None,
) -> list[Prediction]:
    """Open-loop predictions of records.

    Args:
        parameters: And where they are,
        theta: shape (n,).
        records: Not fitted, or the fitted ones for comparison.
        window: Seconds between restarts from the measured state; None: one run from its first state.
        step: Of the integration [s].
        offsets: Constant errors of the sensors by signal, taken off the readings for the start.
    """
    return Predictor(parameters, records, window, step)(theta, offsets)


class Predictor:
    """Predictions of the same records with one theta after the other: compiled once.

    Arguments are those of `predict`.
    """

    def __init__(self, parameters: Parameters, records: Sequence[Record], window: float | None, step: float):
        self.records, self.window = records, window
        self.configuration = np.asarray(parameters.model.thrusters.configuration)
        self.groups = []
        for places in _alike(records):
            some = [records[i] for i in places]
            # Simulated in one go: one program, where each length of a record would need its own.
            steps = max(whole_steps(r, step) for r in some) if window is None else round(window / step)
            segments = cut(some, Grid(step, steps, 50.0))
            self.groups.append((places, segments, Shooting(parameters, segments)))

    def __call__(
        self, theta: Float[np.ndarray, " n"], offsets: dict[str, Float[np.ndarray, " _"]] | None = None
    ) -> list[Prediction]:
        found: dict[int, Prediction] = {}
        for places, segments, shooting in self.groups:
            found |= zip(places, self._alike(places, segments, shooting, theta, offsets or {}), strict=True)
        return [found[i] for i in range(len(self.records))]

    def _alike(
        self,
        places: list[int],
        segments: Segments,
        shooting: Shooting,
        theta: Float[np.ndarray, " n"],
        offsets: dict[str, Float[np.ndarray, " _"]],
    ) -> list[Prediction]:
        nodes = _run(shooting, segments, theta, offsets)
        zero = np.concatenate([offsets.get(name, np.zeros(len(SIGNALS[name][0]))) for name in segments.levers])
        residual, _ = shooting.residuals(as_array(theta), as_array(zero), nodes, segments.arrays)
        gaps = {name: np.asarray(gap) for name, gap in residual.items()}
        bounds = [*segments.first, segments.count]
        some = [self.records[i] for i in places]
        return [
            _judged_by(record, segments, slice(a, b), gaps, self.window, pushed_axes(self.configuration, record))
            for record, a, b in zip(some, bounds, bounds[1:], strict=False)
        ]


def _alike(records: Sequence[Record]) -> list[list[int]]:
    """Places of records that can be simulated side by side: the same sensors at the same places."""
    groups: dict[str, list[int]] = {}
    for i, record in enumerate(records):
        sensors = sorted((name, np.asarray(signal.lever).tolist()) for name, signal in record.signals.items())
        groups.setdefault(repr(sensors), []).append(i)
    return list(groups.values())


def _judged_by(
    record: Record,
    segments: Segments,
    own: slice,
    gaps: dict[str, Float[np.ndarray, "S R _"]],
    window: float | None,
    pushed: Bool[np.ndarray, "6"],
) -> Prediction:
    """A record beside its prediction, `own` of all segments; gaps are prediction less reading by signal, (S, R, k)."""
    readings: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
    scores, excited = {}, {}
    for name in gaps:
        rows = {key: value[own] for key, value in segments.arrays[name].items()}
        used = rows["used"] > 0
        t = (segments.starts()[own, None] + segments.grid.step * (rows["row"] + rows["share"]))[used]
        if len(t) == 0:
            continue
        measured, gap = rows["value"][used], gaps[name][own][used]
        measured, predicted = _angles(measured, gap) if name == "attitude" else (measured, measured + gap)
        readings[name] = (t, measured, predicted)
        window_of = np.nonzero(used)[0]
        for i, component in enumerate(SIGNALS[name][0]):
            scores[f"{name}.{component}"] = _score(measured[:, i], predicted[:, i], window_of, name)
            moved = np.std(measured[:, i]) > _MOVED * _noise(measured[:, i])
            excited[f"{name}.{component}"] = bool(moved and (name not in _AXES or pushed[_AXES[name][i]]))
    return Prediction(record.name, window, readings, scores, excited)


def pushed_axes(configuration: Float[np.ndarray, "6 n"], record: Record) -> Bool[np.ndarray, "6"]:
    """Axes along which thrusters were asked for something.

    By the root of the mean square of configuration @ command over time, against that of full command on all thrusters.

    All of them where nothing was asked for at all, as in a decay; those along which no thruster can push too.
    """
    held = np.diff(record.t_command, append=record.end)  # commands may be written when they change only
    asked = np.sqrt(held @ (record.command @ configuration.T) ** 2 / held.sum())
    full = np.abs(configuration).sum(axis=1)
    return (asked > _PUSHED * full) | (full < 1e-6) | (not np.any(record.command))


def _angles(
    measured: Float[np.ndarray, "n 4"], turn: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """zyx Euler angles of measured quaternions (n, 4), without jumps, and of the predicted ones beside them."""
    half = turn / 2.0
    real = np.sqrt(np.maximum(1.0 - np.sum(half**2, axis=1, keepdims=True), 0.0))
    predicted = jax.vmap(quaternion_multiply)(jnp.asarray(measured), jnp.asarray(np.concatenate([real, half], axis=1)))
    was, now = (np.asarray(jax.vmap(euler_from_quaternion)(jnp.asarray(q))) for q in (measured, predicted))
    smooth = np.unwrap(was, axis=0)
    return smooth, smooth + np.asarray(wrap(jnp.asarray(now - was)))


def _run(
    shooting: Shooting, segments: Segments, theta: Float[np.ndarray, " n"], offsets: dict[str, Float[np.ndarray, " _"]]
) -> Nodes:
    """Nodes at the measured state; what is not measured comes from the window before."""
    found = nodes_from_data(segments, offsets, exact=True)
    nodes = undisturbed(**found)
    before = np.flatnonzero(segments.arrays["linked"])
    if {"velocity", "position", "horizontal"} & set(segments.levers) or len(before) == 0:
        return nodes
    for _ in range(min(_PASSES, len(before) + 1)):
        path = shooting.trajectories(as_array(theta), nodes, segments.arrays)
        nu = np.array(nodes.nu)
        nu[before + 1, :3] = np.asarray(path.nu)[before, -1, :3]
        nodes = nodes._replace(nu=nu)
    return nodes


def _score(
    y: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"], window: Int[np.ndarray, " n"], name: str
) -> Score:
    gap = predicted - y
    spread = np.linalg.norm(y - y.mean())
    first = np.concatenate([[0], np.flatnonzero(np.diff(window)) + 1])
    held = y[first][np.searchsorted(first, np.arange(len(y)), side="right") - 1]
    moving = name in ("gyro", "velocity")
    return Score(
        fit=float(100 * (1 - np.linalg.norm(gap) / max(spread, 1e-12))),
        rms=float(np.sqrt(np.mean(gap**2))),
        hold=float(np.sqrt(np.mean((y - held) ** 2))),
        still=float(np.sqrt(np.mean(y**2))) if moving else float("nan"),
    )


def _noise(y: Float[np.ndarray, " n"]) -> float:
    """Of a slowly varying series, from its second differences (robust)."""
    if len(y) < 5:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(y, 2))) / np.sqrt(6))
