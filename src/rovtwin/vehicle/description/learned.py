"""The learned discrepancy of a vehicle file: checked, and as the arrays of a `Discrepancy`. Reading starts no JAX."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.description.schema import DiscrepancyPart, LearnedDiscrepancy

if TYPE_CHECKING:
    from rovtwin.vehicle.physics.discrepancy import Discrepancy

INPUTS = 12  # of a part: nu_r and the thrusters' wrench
JITTER = 1e-8  # added to the diagonal of kernel matrices, whose elements are at most 1
_PUSHED = 1e-3  # of the largest lever or share of a thruster, below which none pushes along an axis


def kernel_matrix(
    anchored: Float[np.ndarray, " inputs"],
    inverse_lengths: Float[np.ndarray, " inputs"],
    a: Float[np.ndarray, "m inputs"],
    b: Float[np.ndarray, "n inputs"],
) -> Float[np.ndarray, "m n"]:
    """k between two sets of places, of one part; arguments as the attributes of Discrepancy."""
    a, b = a * inverse_lengths, b * inverse_lengths
    far = np.sum((a[:, None] - b[None]) ** 2, axis=2)
    free = np.sum((1.0 - anchored) * (a[:, None] - b[None]) ** 2, axis=2)
    apart = np.sum(anchored * a**2, axis=1)[:, None] + np.sum(anchored * b**2, axis=1)[None]
    return np.exp(-0.5 * far) - np.exp(-0.5 * (free + apart))


def whitening(
    anchored: Float[np.ndarray, " inputs"],
    inverse_lengths: Float[np.ndarray, " inputs"],
    centres: Float[np.ndarray, "m inputs"],
) -> Float[np.ndarray, "m m"]:
    """L^-1 with K = L L' the kernel matrix of the centres: k turned into m independent features."""
    K = kernel_matrix(anchored, inverse_lengths, centres, centres)
    return np.linalg.inv(np.linalg.cholesky(K + JITTER * np.eye(len(K))))


def anchored_inputs(of: str) -> Float[np.ndarray, "12"]:
    """Which inputs have to vanish for a part `of` motion or thrust to."""
    return np.repeat([1.0, 0.0] if of == "motion" else [0.0, 1.0], 6)


def pushed(configuration: Float[np.ndarray, "6 n"]) -> Bool[np.ndarray, "6"]:
    """Axes along which some thruster pushes; `configuration` is T."""
    size = np.abs(configuration)
    return np.any(size > _PUSHED * size.max(initial=1e-12), axis=1) if size.size else np.zeros(6, bool)


def discrepancy_arrays(
    found: LearnedDiscrepancy, configuration: Float[np.ndarray, "6 n"], where: str, ratio: float = 1.0
) -> dict[str, np.ndarray]:
    """Fields of a Discrepancy from what a vehicle file holds.

    Args:
        found: The block `identified.discrepancy`.
        configuration: T of the vehicle's thrusters.
        where: File name, for messages.
        ratio: Density of the water over that of the file's: forces of motion grow with it.

    Raises:
        ConfigError: A part depends on thrust along an axis in which no thruster pushes, or has no distribution.
    """
    most = max(len(part.weights) for part in found.parts)
    rows = [
        _part(part, pushed(configuration), f"{where}: identified.discrepancy.parts[{i}]", most, ratio)
        for i, part in enumerate(found.parts)
    ]
    along = np.stack([np.eye(6)[AXES.index(part.axis)] for part in found.parts], axis=1)
    columns = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    return columns | {"along": along, "speeds": np.array(found.speeds)}


def _part(
    part: DiscrepancyPart, able: Bool[np.ndarray, "6"], where: str, most: int, ratio: float
) -> dict[str, np.ndarray]:
    """Fields of Discrepancy of one part, without `along`; places beyond its own are zero and count nothing."""
    of_motion = part.of == "motion"
    inverse = np.array([0.0 if length is None else 1.0 / length for length in part.lengths])
    anchored, m = anchored_inputs(part.of), len(part.weights)
    for i in np.flatnonzero(inverse[6:]):
        found, axis = f"{where}.lengths[{6 + i}]: found {part.lengths[6 + i]:g}", AXES[i]
        if of_motion:
            raise ConfigError(f"{found}, expected null: a part of motion is no function of thrust")
        if not able[i]:
            raise ConfigError(
                f"{found}, for thrust in {axis}, but no thruster of this vehicle pushes along it: it was learned with "
                "another vehicle. Identify this one again, or take the block 'discrepancy' out"
            )
    centres = np.array(part.centres)
    white = whitening(anchored, inverse, centres)
    covariance = np.array(part.covariance)
    values, vectors = np.linalg.eigh(np.eye(m) - 0.5 * (covariance + covariance.T))
    if values.min() < -1e-3 or values.max() > 1.0 + 1e-3:
        raise ConfigError(
            f"{where}.covariance: found variances from {1 - values.max():.3g} to {1 - values.min():.3g}, expected 0 to "
            "1: weights are known at least as well as before the tests, where their variance is 1"
        )
    std = part.std * (ratio if of_motion else 1.0)
    root = np.sqrt(np.clip(values, 0.0, 1.0))[:, None] * vectors.T
    fill = most - m
    return {
        "motion": np.array(float(of_motion)),
        "anchored": anchored,
        "std": np.array(std),
        "inverse_lengths": inverse,
        "centres": np.pad(centres, ((0, fill), (0, 0))),
        "coefficients": np.pad(std * (white.T @ np.array(part.weights)), (0, fill)),
        "reduction": np.pad(root @ white, ((0, fill), (0, fill))),
    }


def discrepancy_from(
    found: LearnedDiscrepancy, configuration: Float[np.ndarray, "6 n"], where: str, ratio: float
) -> "Discrepancy":
    """Arrays of what a vehicle file holds; arguments and errors as of `discrepancy_arrays`."""
    from rovtwin.core.numerics import as_array
    from rovtwin.vehicle.physics.discrepancy import Discrepancy

    return Discrepancy(
        **{name: as_array(x) for name, x in discrepancy_arrays(found, configuration, where, ratio).items()}
    )
