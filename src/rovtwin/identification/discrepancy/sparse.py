"""For comparison: the missing wrench as a few terms of a library, by sequentially thresholded least squares.

The library has nu_i, nu_i |nu_j|, nu_i nu_j, tau_i, tau_i nu_j and tau_i |nu_j| of all components that moved and were
pushed. Terms whose coefficient, in units of the scatter that they explain, is below a threshold are dropped, the others
fitted again, until none is dropped; the threshold is the one with the least error in fourths of the tests left out in
turn. It holds no more than its library, says nothing of its own error, and nothing keeps it passive.

Reference: Brunton, Proctor and Kutz (2016), Discovering governing equations from data by sparse identification of
nonlinear dynamical systems, PNAS 113(15).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.numerics import jnp
from rovtwin.core.types import Vector6
from rovtwin.identification.discrepancy.regression import Windows
from rovtwin.vehicle.constants import AXES

THRESHOLDS = (0.03, 0.06, 0.1, 0.2, 0.4)  # of the scatter of the missing wrench
RIDGE = 1e-3  # of the number of windows: what keeps terms apart that are nearly alike
_ROUNDS, _PARTS = 10, 4
_VELOCITIES, _FORCES = "uvwpqr", "XYZKMN"


@dataclass(frozen=True, eq=False)
class Sparse:
    """The terms of each component of the wrench.

    Attributes:
        moved: Components of nu_r in the library.
        pushing: Components of the thrusters' wrench in it.
        names: Of the terms, L of them.
        coefficients: Of the terms, zero for what was dropped.
    """

    moved: Float[np.ndarray, " a"]
    pushing: Float[np.ndarray, " b"]
    names: list[str]
    coefficients: Float[np.ndarray, "L 6"]

    def wrench(self, nu_r: Vector6, tau: Vector6) -> Vector6:
        """At one motion, b at CO [N, N m]."""
        return jnp.stack(_library(nu_r, tau, self.moved, self.pushing, jnp)) @ self.coefficients

    def lines(self) -> list[str]:
        """The wrench of each component as a formula."""
        rows = []
        for i, axis in enumerate(AXES):
            used = np.flatnonzero(self.coefficients[:, i])
            if len(used):
                rows.append(f"{axis}: " + " ".join(f"{self.coefficients[k, i]:+.3g} {self.names[k]}" for k in used))
        return rows


def sparse(windows: Windows) -> Sparse:
    """Terms for the missing wrench of all components that were seen."""
    moved = np.flatnonzero(windows.moved)
    pushing = np.flatnonzero(windows.thrust > 1e-3 * max(float(windows.thrust.max()), 1e-9))
    library = np.stack(_library(windows.nu_r, windows.tau, moved, pushing, np), axis=-1).mean(axis=1)
    names = _names(moved, pushing)
    size = np.maximum(np.sqrt(np.mean(library**2, axis=0)), 1e-12)
    found = np.zeros((len(names), 6))
    for axis in range(6):
        used = windows.seen[:, axis]
        if used.sum() > len(names) // 2:
            y = windows.missing[used, axis]
            found[:, axis] = _chosen(library[used] / size, y - np.median(y)) / size
    return Sparse(moved, pushing, names, found)


def _chosen(F: Float[np.ndarray, "W L"], y: Float[np.ndarray, " W"]) -> Float[np.ndarray, " L"]:
    """Coefficients at the best threshold; none at all where that predicts best."""
    part = np.arange(len(y)) * _PARTS // len(y)
    errors = [float(np.sum(y**2))]
    for threshold in THRESHOLDS:
        left = [
            y[part == k] - F[part == k] @ _thresholded(F[part != k], y[part != k], threshold) for k in range(_PARTS)
        ]
        errors.append(float(np.sum(np.concatenate(left) ** 2)))
    best = int(np.argmin(errors))
    return np.zeros(F.shape[1]) if best == 0 else _thresholded(F, y, THRESHOLDS[best - 1])


def _thresholded(F: Float[np.ndarray, "W L"], y: Float[np.ndarray, " W"], threshold: float) -> Float[np.ndarray, " L"]:
    """Coefficients of unit terms F."""
    kept, out = np.ones(F.shape[1], bool), np.zeros(F.shape[1])
    for _ in range(_ROUNDS):
        A = F[:, kept]
        out[:] = 0.0
        out[kept] = np.linalg.solve(A.T @ A + RIDGE * len(y) * np.eye(A.shape[1]), A.T @ y)
        small = np.abs(out) < threshold * np.std(y)
        if not np.any(small & kept):
            break
        kept &= ~small
        if not kept.any():
            return np.zeros_like(out)
    return out


def _library(
    nu: Any,
    tau: Any,
    moved: Sequence[int] | Int[np.ndarray, " a"],
    pushing: Sequence[int] | Int[np.ndarray, " b"],
    xp: Any,
) -> list:
    """Terms, each of the shape of one component of nu; the last axis of nu and tau is that of components."""
    v, f = [nu[..., j] for j in moved], [tau[..., j] for j in pushing]
    terms = [*v, *(a * xp.abs(b) for a in v for b in v)]
    terms += [v[i] * v[j] for i in range(len(v)) for j in range(i + 1, len(v))]
    return [*terms, *f, *(a * b for a in f for b in v), *(a * xp.abs(b) for a in f for b in v)]


def _names(moved: Int[np.ndarray, " a"], pushing: Int[np.ndarray, " b"]) -> list[str]:
    v, f = [_VELOCITIES[j] for j in moved], [_FORCES[j] for j in pushing]
    names = [*v, *(f"{a}|{b}|" for a in v for b in v)]
    names += [f"{v[i]}{v[j]}" for i in range(len(v)) for j in range(i + 1, len(v))]
    return [*names, *f, *(f"{a} {b}" for a in f for b in v), *(f"{a}|{b}|" for a in f for b in v)]
