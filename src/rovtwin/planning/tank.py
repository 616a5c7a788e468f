"""The tank that a planned test has to fit."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import jax
from rovtwin.planning.rehearsal import Rehearsed
from rovtwin.vehicle import Model, Vehicle
from rovtwin.vehicle.analysis.performance import performance
from rovtwin.vehicle.description.instruments import carries

STOPS, HULLS = 12.0, 3.5  # of a tank that nobody gave: its length over stopping distances, its sizes over the hull's
# What measures positions in a tank, where nobody says: an assumption.
MOTION_CAPTURE = {"noise": 0.03, "rate_hz": 15, "errors": "none", "dropout": 0.0, "position": [0.0, 0.0, 0.0]}
HULL_EVERY = 5  # ticks between looks at the hull
# Standard deviations of a position between a path and the fence that watches over it, and from there to the wall.
ERRS = 2.5
HALF = 0.5  # of the way from the paths to where the hull touches: there a fence ends a test


def positions_in_tank(vehicle: Vehicle) -> dict[str, Any]:
    """`sensors.position` of a scenario in a tank: motion capture, but for a vehicle that measures positions itself."""
    return {} if carries(vehicle, "position") else dict(MOTION_CAPTURE)


def counted_on(vehicle: Vehicle) -> list[str]:
    """In words, what measures positions in a tank where nobody says and no part of the vehicle does."""
    if carries(vehicle, "position"):
        return []
    return [
        f"counted on: motion capture that gives the position of CO to {MOTION_CAPTURE['noise']:g} m, "
        f"{MOTION_CAPTURE['rate_hz']} times a second, as no part of {vehicle.name} measures it: fly the test with "
        "--sensor qtm://HOST/BODY. Where something else measures it, add that to the vehicle's file and plan again"
    ]


@dataclass(frozen=True)
class Tank:
    """Length (along the start's heading, north), width and depth of the water [m]."""

    length: float
    width: float
    depth: float

    @classmethod
    def parse(cls, text: str) -> "Tank":
        """Of `6x3x1.5`.

        Raises:
            ConfigError: Something else.
        """
        try:
            sizes = [float(piece) for piece in text.lower().replace("m", "").split("x")]
        except ValueError:
            sizes = []
        if len(sizes) != 3 or min(sizes) <= 0 or max(sizes) > 1000:
            raise ConfigError(f"--tank: found {text!r}, expected length x width x depth in metres, such as 6x3x1.5")
        return cls(*sizes)

    @classmethod
    def of(cls, model: Model) -> "Tank":
        """For a vehicle where nobody says which: 12 stopping distances long, half as wide, a quarter as deep.

        That is room to pull on every axis to half of the top speed and back. At least the thesis's 6 x 3 x 1.5 m, and
        3.5 hulls in each direction.
        """
        stop = performance(model)["surge"]["ahead"].stopping_distance
        length = max(6.0, STOPS * stop) if np.isfinite(stop) else 6.0
        hull = 2.0 * np.abs(np.asarray(model.hull.corners)).max(axis=0)
        own = np.maximum([length, 0.5 * length, 0.25 * length], HULLS * hull)
        return cls(*(float(np.ceil(10.0 * size) / 10.0) for size in own))

    @property
    def middle(self) -> list[float]:
        """Where tests start [m]."""
        return [0.0, 0.0, 0.5 * self.depth]

    def room(self, vehicle: Vehicle, flown: Rehearsed) -> tuple[float, float]:
        """Least distance of the hull from walls, floor and surface on a path [m], and when [s]."""
        room, at = self.nearest(self._hull(vehicle, flown))
        return room, float(flown.t[::HULL_EVERY][at])

    def near(self, vehicle: Vehicle, flown: Rehearsed, least: float) -> Float[np.ndarray, " k"]:
        """When the hull is nearer than `least` [m] to walls, floor or surface, up to an abort [s]."""
        t = flown.t[::HULL_EVERY]
        end = np.inf if flown.aborted_at is None else flown.aborted_at
        return t[(self._clear(self._hull(vehicle, flown)) <= least) & (t <= end)]

    def touches(self, model: Model, flown: Rehearsed) -> Float[np.ndarray, "2"]:
        """Way of CO north and east of the middle at which the hull touches a wall, turned as anywhere on a path [m]."""
        reach = np.abs(self._reach(model, flown)[..., :2]).max(axis=(0, 1))
        return 0.5 * np.array(self.sizes[:2]) - reach

    def reaches_down(self, model: Model, flown: Rehearsed) -> float:
        """Depth of the hull's lowest corner below CO, turned as anywhere on a path [m]."""
        return float(self._reach(model, flown)[..., 2].max())

    def past_a_fence(self, model: Model, flown: Rehearsed, errs: float) -> Float[np.ndarray, " k"]:
        """When CO is so far out that no fence can stand between it and where the hull touches [s].

        Args:
            model: With its hull.
            flown: The path.
            errs: Standard deviation of a measured position [m].
        """
        away = np.abs(flown.position[:, :2])
        end = np.inf if flown.aborted_at is None else flown.aborted_at
        return flown.t[(away > self.touches(model, flown) - 2.0 * ERRS * errs).any(axis=1) & (flown.t <= end)]

    def left(self, model: Model, flown: Rehearsed, errs: float) -> Float[np.ndarray, " k"]:
        """When a test ends before its time, as the vehicle tips over or is past a fence [s]; the floor does not count.

        Args:
            model: With its hull.
            flown: The path.
            errs: Standard deviation of a measured position [m].
        """
        aborted = [] if flown.aborted_at is None else [flown.aborted_at]
        return np.concatenate([self.past_a_fence(model, flown, errs), aborted])

    def fence(self, model: Model, flights: Sequence[Rehearsed]) -> Float[np.ndarray, "3"]:
        """How far CO may be from the tank's middle to north and east, and how deep [m], before a test is ended.

        Args:
            model: With its hull.
            flights: Paths that stay between the walls, see `past_a_fence`; the first one, which is planned, also above
                the floor: in a shallow tank hardly a test keeps all vehicles that may be off the floor.
        """
        away = np.max([np.abs(one.position[:, :2]).max(axis=0) for one in flights], axis=0)
        touches = np.min([self.touches(model, one) for one in flights], axis=0)
        deepest, grounds = float(flights[0].position[:, 2].max()), self.depth - self.reaches_down(model, flights[0])
        return np.append(away + HALF * np.maximum(touches - away, 0.0), deepest + HALF * max(grounds - deepest, 0.0))

    def require_fence(self, model: Model, errs: float) -> None:
        """Raises ConfigError where positions err [m] by too much for a fence about the middle."""
        reach = np.abs(np.asarray(model.hull.corners)[:, :2]).max(axis=0)
        if np.any(2.0 * ERRS * errs > 0.5 * np.array(self.sizes[:2]) - reach):
            raise ConfigError(
                f"positions err by {errs:.2g} m (one standard deviation): in a tank of {self} no fence can end a test "
                "before a wall. Use motion capture (--sensor qtm://HOST/BODY), or a larger --tank"
            )

    def needed(self, vehicle: Vehicle, flown: Rehearsed, margin: float) -> "Tank":
        """The tank that keeps a margin [m] on every side of the hull on a path, with the start in its middle."""
        size = 2.0 * (np.abs(self._hull(vehicle, flown) - np.array(self.middle)).max(axis=(0, 1)) + margin)
        return Tank(*(max(float(np.ceil(10.0 * s) / 10.0), own) for s, own in zip(size, self.sizes, strict=True)))

    @property
    def sizes(self) -> tuple[float, float, float]:
        """Length, width, depth [m]."""
        return self.length, self.width, self.depth

    def __str__(self) -> str:
        return "x".join(f"{size:.4g}" for size in self.sizes)

    def _hull(self, vehicle: Vehicle, flown: Rehearsed) -> Float[np.ndarray, "n m 3"]:
        """Corners of the hull along a path [m]."""
        return flown.position[::HULL_EVERY, None, :] + self._reach(vehicle.model(), flown)

    @staticmethod
    def _reach(model: Model, flown: Rehearsed) -> Float[np.ndarray, "n m 3"]:
        """From CO to corners of the hull, NED [m]."""
        R_nb = np.asarray(_rotations(flown.attitude[::HULL_EVERY]))
        return np.einsum("tij,mj->tmi", R_nb, np.asarray(model.hull.corners))

    def nearest(self, corners: Float[np.ndarray, "n m 3"]) -> tuple[float, int]:
        """Least distance of points on a path from walls, floor and surface [m], and the row where."""
        room = self._clear(corners)
        return float(room.min()), int(room.argmin())

    def _clear(self, corners: Float[np.ndarray, "n m 3"]) -> Float[np.ndarray, " n"]:
        half = 0.5 * np.array(self.sizes)
        return (half - np.abs(corners - np.array(self.middle))).min(axis=(1, 2))


_rotations = jax.jit(jax.vmap(rotation_from_quaternion))
