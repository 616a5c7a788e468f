"""Where to start: parameters from the balance of forces along the smoothed path, before anything is integrated.

Velocities and attitude come from the readings, smoothed; the model says how the velocity should change over a second at
those states, and least squares makes it agree with how it did. That is the equation-error method (Klein and Morelli
2006, Aircraft System Identification, ch. 5): noise in the states biases it, so that it is no estimate, but most
parameters enter linearly, and it brings the shooting into the valley it belongs to.
"""

from collections.abc import Callable
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.frames import rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Vector6
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.loads import WRENCH, accelerated, thrust_history
from rovtwin.identification.joint.model.nodes import Nodes
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.joint.solver.path import KERNEL, smoothed_path
from rovtwin.identification.joint.solver.segments import Grid, Segments
from rovtwin.vehicle.physics.model import Model

WINDOW = 1.0  # over which the change of velocity is compared [s]
_STEP = 0.1  # between the states at which the model is asked, at most [s]
FEWEST = 50  # changes, all components counted, below which the prior says more
_MOST = 300  # windows, evenly chosen from long records: enough for a start
_STEPS, _SMALL = 40, 0.01  # the cost falls by less than this share: done
_HUBER = 2.0
# A dead band that is too small sees no slope towards a large one: it is tried at these values too, in widths of the
# prior, with the rest of the curve back at the prior.
_CURVE, _TRIED = ("dead_band", "exponent"), (1.5, 2.5)

Linear = Callable[[Any], tuple[Any, Any]]
"""theta to whitened residuals of static evidence, shape (k,), and their derivatives (k, n)."""


class Balance:
    """Change of nu over windows by the model at smoothed states, less the change that the readings show."""

    def __init__(self, parameters: Parameters, grid: Grid):
        """Nothing is compiled before the first call."""
        self.parameters = parameters
        self.every = max(k for k in range(1, grid.steps + 1) if grid.steps % k == 0 and k * grid.step < _STEP + 1e-9)
        self.grid = Grid(grid.step * self.every, grid.steps // self.every)
        self.window = max(1, round(WINDOW / self.grid.step))
        self._kernel = _gauss(KERNEL / self.grid.step)
        self.gaps = jax.jit(self._gaps)
        self.missing = jax.jit(self._missing)
        self.linearised = jax.jit(lambda *a: (self._gaps(*a), jax.jacfwd(self._gaps)(*a)))

    def arrays_of(self, segments: Segments) -> dict[str, Any]:
        """Smoothed states and what else the compiled part needs; `used` (W, 6) is 1 where a component was seen."""
        path, seen = smoothed_path(segments, self.grid)
        steps, span, count = self.grid.steps, self.window, segments.count
        fresh = np.asarray(segments.arrays["fresh"])[:, :: self.every]
        begin = np.arange(0, count * steps // span * span, span)
        begin = begin[np.linspace(0, len(begin) - 1, min(len(begin), _MOST)).round().astype(int)]
        rows = (begin[:, None] + np.arange(span)).ravel()
        end = np.minimum(begin + span, count * steps - 1)
        # A window that runs into the next record, or to the end of all, says nothing.
        record = np.cumsum(fresh.ravel())
        whole = (record[begin] == record[end]) & (begin + span < count * steps)
        missed = np.concatenate([np.zeros((1, 6)), np.cumsum(1.0 - seen, axis=0)])
        clear = missed[end + 1] - missed[begin] < 0.5
        own = ("current", "tether", "ballast", "ballast_mass")
        # Close enough for a start: the mean command of a window, one in each of its steps.
        command = np.einsum("skm,skmn->skn", *(np.asarray(segments.arrays[key]) for key in ("held", "command")))
        return {
            "path": jax.tree.map(lambda x: x[rows], path),
            "own": {k: np.asarray(segments.arrays[k])[rows // steps] for k in own if k in segments.arrays},
            "command": command.reshape(count, steps, self.every, -1).mean(axis=2, keepdims=True),
            "fresh": fresh,
            "rows": rows,
            "change": path.nu[end] - path.nu[begin],
            "used": (whole[:, None] & clear).astype(float),
        }

    def padded(self, arrays: dict[str, Any], segments: int) -> dict[str, Any]:
        """The same with room for so many segments, so that a log that grows needs no other program.

        Raises:
            IdentificationError: There are more already.
        """
        windows = min(_MOST, segments * self.grid.steps // self.window)
        more, spare = segments - len(arrays["command"]), windows - len(arrays["used"])
        if more < 0 or spare < 0:
            raise IdentificationError(f"found {len(arrays['command'])} segments, expected {segments} at most")

        def longer(x: Float[np.ndarray, " n *axes"], count: int) -> Float[np.ndarray, " m *axes"]:
            return np.concatenate([x, np.repeat(x[-1:], count, axis=0)])

        by_row = {key: arrays[key] for key in ("path", "own", "rows")}
        by_row = jax.tree.map(lambda x: longer(x, spare * self.window), by_row)
        out = arrays | by_row | {key: longer(arrays[key], more) for key in ("command", "fresh")}
        unused = np.zeros((spare, 6))
        return out | {key: np.concatenate([arrays[key], unused]) for key in ("change", "used")}

    def _gaps(self, theta: Float[Array, " n"], arrays: dict[str, Any]) -> Float[Array, "W 6"]:
        """Zero where something was not seen."""
        model, extras = self.parameters.model_at(theta)
        tau = self._thrust(model, arrays)

        def rate(x: Nodes, tau: Float[Array, " _"], own: dict[str, Array]) -> Vector6:
            heavier = model
            if "ballast_mass" in own:
                heavier = model.replace(rigid_body_mass=model.rigid_body_mass + own["ballast_mass"])
            return accelerated(heavier, extras, own, x, tau)

        rates = jax.vmap(rate)(arrays["path"], tau, arrays["own"])
        change = self.grid.step * rates.reshape(-1, self.window, 6).sum(axis=1)
        return arrays["used"] * (change - arrays["change"])

    def _thrust(self, model: Model, arrays: dict[str, Any]) -> Float[Array, "N _"]:
        """Thrust at the path's states (`thrust_history`), through the kernel that these went through."""
        command = arrays["command"]
        held = jnp.ones(command.shape[:-1])  # a delay is well below what a window tells
        history = thrust_history(model.thrusters, command, held, arrays["fresh"], self.grid.step)
        return _through(self._kernel, history[:, :, 0].reshape(-1, history.shape[-1]))[arrays["rows"]]

    def _missing(
        self, theta: Float[Array, " n"], arrays: dict[str, Any]
    ) -> tuple[Float[Array, "W 6"], Float[Array, "W window 6"], Float[Array, "W window 6"]]:
        """What moves the vehicle beside the model's forces, mean over windows, and nu_r and thrust there.

        Where a component was not seen, nothing is missing along it.
        """
        model, _ = self.parameters.model_at(theta)
        path, window = arrays["path"], (-1, self.window, 6)
        missing = -self._gaps(theta, arrays) @ model.inertia.T / (self.window * self.grid.step)
        flow = jax.vmap(lambda q, c: rotation_from_quaternion(q).T @ c)(path.attitude, arrays["own"]["current"])
        nu_r = jnp.concatenate([path.nu[:, :3] - flow, path.nu[:, 3:]], axis=1)
        return missing, nu_r.reshape(window), self._thrust(model, arrays)[:, :WRENCH].reshape(window)


def balanced(
    balance: Balance, segments: Segments, prior: Gaussian, static: Linear | None = None
) -> Float[np.ndarray, " n"]:
    """theta at which forces balance best; the prior's mean where too little was seen.

    Args:
        balance: Compiled once for all segments of one shape.
        segments: With the readings.
        prior: Holds what they do not tell.
        static: Evidence that is no motion.
    """
    fit = Fit(balance, balance.arrays_of(segments), prior, static)
    return prior.mean.copy() if fit.used.sum() < FEWEST else lowest(fit, balance.parameters, prior)[0]


def lowest(
    fit: "Fit", parameters: Parameters, prior: Gaussian
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "6"]]:
    """theta of the lowest cost that is found, and the scatter there."""
    best, sigma = fit.descend(prior.mean)
    names, width = parameters.names, np.sqrt(np.diag(prior.covariance))
    for i in (i for i, name in enumerate(names) if name.endswith(".dead_band")):
        group = names[i].removesuffix("dead_band")
        curve = [j for j, name in enumerate(names) if any(fnmatchcase(name, group + c) for c in _CURVE)]
        for widths in _TRIED:
            trial = best.copy()
            trial[curve] = prior.mean[curve]
            trial[i] += widths * width[i]
            found, spread = fit.descend(trial, sigma)
            if fit.cost(found, sigma) < fit.cost(best, sigma):
                best, sigma = found, spread
    return best, sigma


class Fit:
    """Robust least squares with a prior; the scatter of each component follows from its own residuals."""

    def __init__(self, balance: Balance, arrays: dict[str, Any], prior: Gaussian, static: Linear | None):
        self._balance, self._arrays, self._static = balance, jax.tree.map(jnp.asarray, arrays), static
        self._mean, self._information = prior.mean, prior.information
        self.used = np.asarray(arrays["used"])

    def descend(
        self, theta: Float[np.ndarray, " n"], sigma: Float[np.ndarray, "6"] | None = None
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "6"]]:
        """theta and the scatter there, by steps damped in the measure of the prior."""
        damping = 1.0
        for _ in range(_STEPS):
            gaps, J = (np.asarray(x) for x in self._balance.linearised(theta, self._arrays))
            sigma = self._scatter(gaps) if sigma is None else np.minimum(sigma, self._scatter(gaps))
            H, b = self._normal(theta, gaps / sigma, J / sigma[:, None])
            cost, step, found = self.cost(theta, sigma), np.zeros_like(theta), False
            while not found and damping < 1e9:
                step = np.linalg.solve(H + damping * self._information, b)
                found = self.cost(theta + step, sigma) < cost
                damping *= 0.1 if found else 10.0
            if not found:
                break
            theta = theta + step
            if self.cost(theta, sigma) > (1.0 - _SMALL) * cost:
                break
        assert sigma is not None
        return theta, sigma

    def information(self, theta: Float[np.ndarray, " n"], sigma: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n n"]:
        """Of the changes of velocity alone, as if each window's were independent."""
        gaps, J = (np.asarray(x) for x in self._balance.linearised(theta, self._arrays))
        return self._normal(theta, gaps / sigma, J / sigma[:, None])[0] - self._information

    def cost(self, theta: Float[np.ndarray, " n"], sigma: Float[np.ndarray, "6"]) -> float:
        """Sum of squares, infinite where the model has no answer."""
        far = np.abs(np.asarray(self._balance.gaps(theta, self._arrays)) / sigma)
        off = theta - self._mean
        total = float(np.sum(np.where(far > _HUBER, 2 * _HUBER * far - _HUBER**2, far**2)))
        total += float(off @ self._information @ off)
        if self._static is not None:
            total += float(np.sum(np.asarray(self._static(theta)[0]) ** 2))
        return total if np.isfinite(total) else np.inf

    def _normal(
        self, theta: Float[np.ndarray, " n"], gaps: Float[np.ndarray, "W 6"], J: Float[np.ndarray, "W 6 n"]
    ) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]]:
        far = np.abs(gaps)
        weight = self.used * np.where(far > _HUBER, _HUBER / np.maximum(far, 1e-12), 1.0)
        H = np.einsum("wi,wia,wib->ab", weight, J, J, optimize=True) + self._information
        b = -np.einsum("wi,wia,wi->a", weight, J, gaps, optimize=True) - self._information @ (theta - self._mean)
        if self._static is not None:
            r, Jr = (np.asarray(x) for x in self._static(theta))
            H, b = H + Jr.T @ Jr, b - Jr.T @ r
        return H, b

    def _scatter(self, gaps: Float[np.ndarray, "W 6"]) -> Float[np.ndarray, "6"]:
        """Robust standard deviation of each component."""
        seen = [np.abs(g[u > 0]) for g, u in zip(gaps.T, self.used.T, strict=True)]
        return np.array([1.4826 * np.median(g) + 1e-4 if len(g) else 1.0 for g in seen])


def _through(kernel: Float[np.ndarray, " _"], series: Float[Array, "N k"]) -> Float[Array, "N k"]:
    """Weighted sums of neighbours, by adding shifted series: XLA's convolution crashes on some shapes."""
    reach = len(kernel) // 2
    wide = jnp.pad(series, ((reach, reach), (0, 0)), mode="edge")
    total = jnp.zeros_like(series)
    for i, weight in enumerate(kernel):
        total = total + weight * wide[i : i + len(series)]
    return total


def _gauss(width: float) -> Float[np.ndarray, " _"]:
    reach = np.arange(-int(4 * width), int(4 * width) + 1)
    kernel = np.exp(-0.5 * (reach / width) ** 2)
    return kernel / kernel.sum()
