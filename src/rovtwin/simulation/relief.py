"""A floor that is not level: one for altimeters, collision, cameras and imagers.

depth(x) = depth + slope . x + sum_i a_i sin(k_i . x + phi_i) + r sin(2 pi (x_north + bend(x_east)) / L)

The sum has waves of sand and hills, the last term ripples whose crests bend.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.types import Scalar, Vector2

RIPPLES = (0.012, 0.75)  # half-height and length [m]
_OCTAVES, _WAVES = 4, 5  # of hills: of each length, half the one before, so many waves of any direction
_FINEST = 0.25  # of the grid on which the height of hills is taken [m]


class Ripples(eqx.Module):
    """Small waves whose crests run east and bend.

    Attributes:
        height: Half of it [m].
        length: From crest to crest [m].
        bend: Amplitude [m], wave number east [rad/m] and phase [rad] of each sine of `bend`.
    """

    height: Scalar = eqx.field(converter=as_array)
    length: Scalar = eqx.field(converter=as_array)
    bend: Float[Array, "j 3"] = eqx.field(converter=as_array)


class Relief(eqx.Module):
    """The depth of the floor by place, smooth.

    Attributes:
        depth: At the origin of n, without the waves [m].
        slope: By how much it gets deeper per metre north and east.
        amplitude: Half-height of each wave [m].
        wave_number: Of each, north and east [rad/m].
        phase: Of each at the origin [rad].
        ripples: None: none.
    """

    depth: Scalar = eqx.field(converter=as_array)
    slope: Vector2 = eqx.field(converter=as_array)
    amplitude: Float[Array, " k"] = eqx.field(converter=as_array)
    wave_number: Float[Array, "k 2"] = eqx.field(converter=as_array)
    phase: Float[Array, " k"] | None = None
    ripples: Ripples | None = None

    @classmethod
    def of(
        cls, depth: float, slope: Sequence[float] = (0.0, 0.0), waves: Sequence[tuple[float, float, float]] = ()
    ) -> "Relief":
        """From waves of (amplitude [m], length [m], direction of their crests' normal [rad, from north])."""
        rows = [
            (2.0 * np.pi / length * np.cos(along), 2.0 * np.pi / length * np.sin(along)) for _, length, along in waves
        ]
        amplitude, number = [wave[0] for wave in waves], np.reshape(rows, (len(rows), 2))
        return cls(as_array(depth), as_array(slope), as_array(amplitude), as_array(number))

    def with_hills(self, height: float, length: float, seed: int, size: float = 80.0) -> "Relief":
        """With ripples on hills besides, the same for the same seed.

        Args:
            height: Of the hills, trough to crest [m].
            length: From hill to hill [m].
            seed: Of their directions and phases.
            size: Side of the square about the origin in which they are as high as that [m].
        """
        rng = np.random.default_rng(seed)
        number, phase = np.zeros((_OCTAVES * _WAVES, 2)), np.zeros(_OCTAVES * _WAVES)
        share = np.repeat(0.5 ** np.arange(_OCTAVES), _WAVES)
        for i in range(len(share)):
            heading, phase[i] = rng.uniform(0, 2 * np.pi, 2)
            number[i] = 2 * np.pi / (length * share[i]) * np.array([np.cos(heading), np.sin(heading)])
        amplitude = share * 0.5 * height / _highest(share, number, phase, size)
        bend = [[0.6, 0.35, rng.uniform(0, 6)], [0.3, 0.9, 0.0]]
        before = np.zeros(len(self.amplitude)) if self.phase is None else np.asarray(self.phase)
        return Relief(
            self.depth,
            self.slope,
            as_array(np.concatenate([np.asarray(self.amplitude), amplitude])),
            as_array(np.concatenate([np.asarray(self.wave_number), number])),
            as_array(np.concatenate([before, phase])),
            Ripples(*(as_array(x) for x in (*RIPPLES, bend))),
        )

    def under(self, place: Vector2) -> tuple[Scalar, Vector2]:
        """Depth of the floor [m] below a place, north and east [m], and its slope there."""
        return _floor(self, place, jnp)

    def depth_and_slope(
        self, place: Float[np.ndarray, "*n 2"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n 2"]]:
        """The same below many places, in NumPy: this is a `Floor` of `imaging`."""
        return _floor(_in_numpy(self), place, np)


def _floor(relief: Any, place: Any, xp: Any) -> tuple[Any, Any]:
    """Depth and slope; the fields of the relief are arrays of `xp`, NumPy or that of JAX."""
    angle = place @ relief.wave_number.T
    if relief.phase is not None:
        angle = angle + relief.phase
    depth = relief.depth + place @ relief.slope + xp.sin(angle) @ relief.amplitude
    slope = relief.slope + (relief.amplitude * xp.cos(angle)) @ relief.wave_number
    if relief.ripples is None:
        return depth, slope
    height, length, bend = relief.ripples.height, relief.ripples.length, relief.ripples.bend
    sway = place[..., 1, None] * bend[:, 1] + bend[:, 2]
    number = 2.0 * np.pi / length
    along = number * (place[..., 0] + xp.sin(sway) @ bend[:, 0])
    rise = height * number * xp.cos(along)
    steeper = xp.stack([rise, rise * (xp.cos(sway) @ (bend[:, 0] * bend[:, 1]))], axis=-1)
    return depth + height * xp.sin(along), slope + steeper


class _Bare:
    def __init__(self, source: Any, names: Sequence[str]) -> None:
        for name in names:
            value = getattr(source, name)
            setattr(self, name, None if value is None else np.asarray(value))


def _in_numpy(relief: Relief) -> Any:
    bare: Any = _Bare(relief, ("depth", "slope", "amplitude", "wave_number", "phase"))
    bare.ripples = None if relief.ripples is None else _Bare(relief.ripples, ("height", "length", "bend"))
    return bare


def _highest(
    share: Float[np.ndarray, " k"], number: Float[np.ndarray, "k 2"], phase: Float[np.ndarray, " k"], size: float
) -> float:
    """Largest height of the sum of waves over a square about the origin."""
    axis = grid_axis(size)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    total = np.zeros_like(x)
    for i in range(len(share)):
        total += share[i] * np.sin(number[i, 0] * x + number[i, 1] * y + phase[i])
    return float(np.abs(total).max())


def grid_axis(size: float) -> Float[np.ndarray, " n"]:
    """Places along a side of a square about the origin at which its floor is drawn [m]."""
    count = int(np.clip(size / _FINEST, 8, 320)) + 1
    return np.linspace(-0.5 * size, 0.5 * size, count)
