"""What the engine tells twenty times a second, from the last tick's output and readings."""

from collections import deque
from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv

from rovtwin.console.engine.world import TRUTH
from rovtwin.core.arrays.rotations import pose, pose_covariance, pose_rate
from rovtwin.core.datum import Datum
from rovtwin.core.flow import HEADING_GIVEN_UP, OPERATOR, PHASES, REASONS, AutopilotOutput, Measurement
from rovtwin.core.sensors import kind_of
from rovtwin.scenario.schema import Waypoint

WINDOW = 10.0  # over which innovations are compared with what the filter says of itself [s]
BY_OPERATOR = REASONS[OPERATOR]  # what the operator asked for is no alarm
HIDDEN = ("accelerometer", "gyro")  # kinds whose values nobody looks at


class SensorStatus:
    """When each sensor's last reading came, and its value; and the truth of which time, where a twin tells it.

    A twin tells the truth at the end of each of its ticks, so that readings can be sorted by the tick they are of.
    """

    def __init__(self, names: list[str]):
        self._last: dict[str, tuple[float, np.ndarray | None]] = {name: (-np.inf, None) for name in names}
        self.truth: np.ndarray | None = None
        self.truth_at = -np.inf
        self._news: list[Measurement] = []

    def receive(self, readings: list[Measurement]) -> None:
        """What has come."""
        self._news += readings

    @property
    def reported_until(self) -> float:
        """Of which time the newest truth is that came [s]."""
        return max((r.t_valid for r in reversed(self._news) if r.sensor == TRUTH), default=self.truth_at)

    def news(self, t: float, until: float = np.inf) -> list[Measurement]:
        """What came since this was last asked, for the tick of time t; of a twin only its ticks up to `until`."""
        count = len(self._news)
        if until < np.inf:
            ends = [i for i, r in enumerate(self._news) if r.sensor == TRUTH and r.t_valid <= until]
            count = ends[-1] + 1 if ends else 0
        news, self._news = self._news[:count], self._news[count:]
        for reading in news:
            if reading.sensor == TRUTH:
                self.truth, self.truth_at = reading.value, reading.t_valid
            elif reading.sensor in self._last:
                self._last[reading.sensor] = (t, reading.value)
        return news

    def report(self, t: float) -> dict[str, Any]:
        """Age [s] of every sensor and values of those that people look at; the truth and the water's velocity."""
        sensors = {}
        for name, (received, value) in self._last.items():
            shown = None if kind_of(name) in HIDDEN else value
            sensors[name] = {"age": t - received if value is not None else None, "value": shown}
        truth, current = (None, None) if self.truth is None else (self.truth[:6], self.truth[6:9])
        return {"sensors": sensors, "truth": truth, "current": current}


class Changes:
    """What of the supervisor's phase and reason is worth an event."""

    def __init__(self) -> None:
        self._before, self._gave_up = ("", ""), False

    def of(self, phase: str, reason: str, gives_up: bool = False) -> tuple[str, str] | None:
        """Level and text for each new reason, the end of a mission, and a heading that is given up or kept again."""
        gave_up, self._gave_up = self._gave_up, gives_up
        before, self._before = self._before, (phase, reason)
        if reason and reason != before[1]:
            return "warning" if reason == BY_OPERATOR else "danger", f"{phase}: {reason}"
        if phase != before[0] and phase in ("finished", "returned", "surfaced"):
            return "info", phase
        if gives_up != gave_up:
            return (
                ("warning", "heading given up to keep the place")
                if gives_up
                else ("info", "heading no longer given up")
            )
        return None


class Consistency:
    """Normalised innovations squared of each sensor over a window, beside what chance allows (95 %)."""

    def __init__(self, names: list[str]):
        self._names = sorted(names)
        self._kept: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        self._report: dict[str, Any] = {}
        self._judged = -np.inf

    def take(self, t: float, output: AutopilotOutput) -> None:
        """A tick's innovations."""
        nis, dof = np.asarray(output.estimate.nis), np.asarray(output.estimate.nis_dof)
        if np.any(dof):
            self._kept.append((t, nis, dof))

    def report(self, t: float) -> dict[str, Any]:
        """Mean per scalar innovation, their number, and the band that it should lie in; renewed once a second."""
        if t - self._judged >= 1.0 or t < self._judged:
            self._judged = t
            while self._kept and self._kept[0][0] < t - WINDOW:
                self._kept.popleft()
            if self._kept:
                _, nis, dof = zip(*self._kept, strict=True)
                self._report = judged(self._names, np.sum(nis, axis=0), np.sum(dof, axis=0))
        return self._report


def judged(names: list[str], nis: Float[np.ndarray, " n"], dof: Float[np.ndarray, " n"]) -> dict[str, Any]:
    """Mean per scalar innovation of each sensor, their number, and the band that the mean should lie in.

    Args:
        names: Of the sensors.
        nis: Sum of the normalised innovations squared of each.
        dof: How many scalar innovations are in each sum.
    """
    found = {}
    for name, total, count in zip(names, nis, dof, strict=False):
        if count > 0:
            found[name] = [total / count, count, *band(float(count))]
    return found


@lru_cache(maxsize=4096)
def band(count: float) -> tuple[float, float]:
    """Where the mean of so many squared standard normals is with 95 %."""
    low, high = 2.0 * gammaincinv(0.5 * count, [0.025, 0.975]) / count  # chi square; scipy.stats takes long to load
    return float(low), float(high)


def flown(output: AutopilotOutput, waypoints: int) -> dict[str, Any]:
    """The autopilot's estimate, set-point and command."""
    estimate, setpoint, reference = output.estimate, output.setpoint, output.reference
    eta = pose(estimate.position, estimate.attitude)
    variance = np.diagonal(pose_covariance(estimate.covariance, estimate.attitude))[:6]
    on_leg, leg_end = bool(setpoint.on_leg), np.asarray(setpoint.leg_end)
    to_go = float(np.linalg.norm(leg_end - estimate.position))
    length = float(np.linalg.norm(leg_end - np.asarray(setpoint.leg_start)))
    return {
        "phase": PHASES[int(setpoint.phase)],
        "reason": REASONS[int(setpoint.reason)],
        "gives_up_heading": int(setpoint.progress.state) == HEADING_GIVEN_UP,
        "eta": eta,
        "nu": estimate.nu,
        "sd": np.sqrt(np.maximum(variance, 0.0)),
        "ellipse": estimate.covariance[:2, :2],
        "wave": estimate.wave,
        "bias": estimate.bias,
        "reference": pose(reference.position, reference.attitude),
        "reference_rate": pose_rate(reference.velocity, reference.angular_velocity, reference.attitude),
        "setpoint": pose(setpoint.position, setpoint.attitude),
        "leg": [setpoint.leg_start, leg_end],
        "on_leg": on_leg,
        "waypoint": int(setpoint.waypoint),
        "count": waypoints,
        "to_go": to_go,
        "u": output.command.u,
        "health": output.health,
        "tau": output.wrench.tau,
        "progress": progress(PHASES[int(setpoint.phase)], int(setpoint.waypoint), waypoints, to_go, length),
    }


def progress(phase: str, waypoint: int, waypoints: int, to_go: float, length: float) -> float:
    """Share of the mission that is done: way-points behind, and of the leg what is behind of its length [m]."""
    if phase == "finished":
        return 1.0
    if not waypoints or phase == "idle":
        return 0.0
    along = min(max(1.0 - to_go / length, 0.0), 1.0) if length > 0.0 else 0.0
    return min((waypoint + along) / waypoints, 1.0)


def counted(waypoints: int) -> str:
    """So many way-points, in words."""
    return "1 way-point" if waypoints == 1 else f"{waypoints} way-points"


def plan_message(waypoints: list[Waypoint], submitted: bool, datum: Datum) -> dict[str, Any]:
    """The message about a plan; places on the map are reported in metres, too."""
    rows = [
        waypoint.model_dump(exclude_none=True, exclude={"geodetic"}) | {"position": waypoint.placed(datum)}
        for waypoint in waypoints
    ]
    return {"kind": "flown", "submitted": submitted, "waypoints": rows}
