"""Linear unmixing: shares of a library's spectra in each cell, none negative, their sum one.

    x = s sum_k a_k e_k + noise,    a_k >= 0,    sum_k a_k = 1

The brightness s is free, as range, lamps and grain scale a spectrum (a = c / sum c of the non-negative c that fit x
best), or 1. Least squares with c >= 0 have one solution; it is reached
by exchanging the variables that break the optimality conditions, all at once, one by one where that does not end.
Cells with the same variables above 0 share one inverse.

References: Heinz and Chang (2001), IEEE Trans. Geoscience and Remote Sensing 39(3); Portugal, Judice
and Vicente (1994), Mathematics of Computation 63(208), block principal pivoting; Van Benthem and Keenan (2004),
J. Chemometrics 18(10), cells of one passive set together.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

_ROUNDS = 10  # of exchanging all at once that bring no progress, before one by one
_MOST = 500  # rounds in all


@dataclass(frozen=True)
class Shares:
    """What a block of cells is made of.

    Attributes:
        value: Shares, their sum 1; no number where a cell has no band, or is black.
        sd: Standard deviation by noise of the imager alone, as if shares could be negative: for those near 0 or 1 too
            large.
        brightness: s, 1 where it is not free.
        residual: Root mean square of what is left, over the cell's bands.
    """

    value: Float[np.ndarray, "n class"]
    sd: Float[np.ndarray, "n class"]
    brightness: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]


@dataclass(frozen=True)
class Unmixing:
    """Of cells into spectra.

    Attributes:
        spectra: Of the classes, linearly independent.
        noise: Standard deviation of a usual cell's bands.
        weight: Of each band's residual.
        free: Whether each cell's brightness is fitted.
    """

    spectra: Float[np.ndarray, "class band"]
    noise: Float[np.ndarray, " band"]
    weight: Float[np.ndarray, " band"]
    free: bool = True

    @cached_property
    def _products(self) -> tuple[np.ndarray, np.ndarray]:
        """w^2 e_k e_l and w^4 sigma^2 e_k e_l, by band."""
        outer = self.spectra[:, None] * self.spectra[None] * self.weight**2
        return outer, outer * self.weight**2 * self.noise**2

    def shares(
        self, x: Float[np.ndarray, "n band"], known: Bool[np.ndarray, "n band"], scale: Float[np.ndarray, " n"]
    ) -> Shares:
        """Of cells.

        Args:
            x: Their spectra; 0 where not known.
            known: Bands that they have.
            scale: Of each cell's noise, in units of `noise`.
        """
        value, sd = (np.full((len(x), len(self.spectra)), np.nan, np.float32) for _ in range(2))
        brightness, residual = (np.full(len(x), np.nan, np.float32) for _ in range(2))
        whole = known.all(axis=1)
        for cells, all_ in ((whole, True), (~whole & (known.sum(axis=1) > len(self.spectra)), False)):
            if not cells.any():
                continue
            some, bands = x[cells], None if all_ else known[cells]
            G, N = self._sums(bands)
            c, p = self.coefficients(some, G)
            with np.errstate(all="ignore"):
                value[cells], sd[cells] = p, self._sd(G, N, p, c.sum(axis=1)) * scale[cells, None]
            brightness[cells] = c.sum(axis=1)
            left = np.square(some - (c @ self.spectra).astype(np.float32))
            mean = left.mean(axis=1) if bands is None else np.sum(left * bands, axis=1) / bands.sum(axis=1)
            residual[cells] = np.sqrt(mean)
        return Shares(value, sd, brightness, residual)

    def _sums(self, known: Bool[np.ndarray, "n band"] | None) -> tuple[np.ndarray, np.ndarray]:
        """Of the products over the bands that each cell has; None: over all, the same for every cell."""
        if known is None:
            return self._products[0].sum(axis=2)[None], self._products[1].sum(axis=2)[None]
        some = known.astype(float)
        return np.tensordot(some, self._products[0], (1, 2)), np.tensordot(some, self._products[1], (1, 2))

    def coefficients(
        self, x: Float[np.ndarray, "n band"], G: Float[np.ndarray, "m class class"] | None = None
    ) -> tuple[Float[np.ndarray, "n class"], Float[np.ndarray, "n class"]]:
        """Of the spectra in each cell, brightness included, and shares.

        Args:
            x: Spectra, 0 where not known.
            G: Sums of products over the bands that each cell has; None: all have all.
        """
        G = self._sums(None)[0] if G is None else G
        c = nonnegative(G, x.astype(float) @ (self.weight**2 * self.spectra).T, None if self.free else 1.0)
        total = c.sum(axis=1, keepdims=True)
        with np.errstate(all="ignore"):
            return c, np.where(total > 0.0, c / total, np.nan)

    def _sd(self, G: np.ndarray, N: np.ndarray, p: np.ndarray, total: np.ndarray) -> np.ndarray:
        """Of p = c / total: J H N H' J' with H from b to c, J of the division, which does nothing where the sum is 1.

        Shares at 0 are not left out of H: which ones are is a matter of noise, too.
        """
        H = np.linalg.inv(G)
        one = H.sum(axis=2)
        if not self.free:
            H = H - one[:, :, None] * one[:, None, :] / one.sum(axis=1)[:, None, None]
        H = H @ N @ H
        one = H.sum(axis=2)
        variance = np.diagonal(H, axis1=1, axis2=2) - 2.0 * p * one + p**2 * one.sum(axis=1)[:, None]
        return np.sqrt(np.maximum(variance, 0.0)) / total[:, None]


def nonnegative(
    G: Float[np.ndarray, "m class class"], b: Float[np.ndarray, "n class"], total: float | None = None
) -> Float[np.ndarray, "n class"]:
    """c >= 0 with the least c' G c / 2 - b' c.

    Args:
        G: Positive definite, one for all (m = 1) or one for each.
        b: Of each.
        total: The sum of c; None: any.
    """
    count = b.shape[1]
    c, P = np.zeros(b.shape), np.ones(b.shape, bool)
    fewest, patience = np.full(len(b), count + 1), np.full(len(b), _ROUNDS)
    tiny = 1e-11 * np.abs(b).max(axis=1, keepdims=True, initial=0.0)
    left = np.arange(len(b))
    for _ in range(_MOST):
        own, passive = G if len(G) == 1 else G[left], P[left]
        c[left], slope = _stationary(own, b[left], passive, total)
        wrong = (passive & (c[left] < -1e-11)) | (~passive & (slope < -tiny[left]))
        still = wrong.any(axis=1)
        left, wrong = left[still], wrong[still]
        if not len(left):
            break
        number = wrong.sum(axis=1)
        better = number < fewest[left]
        fewest[left] = np.minimum(fewest[left], number)
        patience[left] = np.where(better, _ROUNDS, patience[left] - 1)
        last = count - 1 - np.argmax(wrong[:, ::-1], axis=1)
        single = np.arange(count) == last[:, None]  # Murty's rule, which ends
        P[left] ^= np.where((patience[left] > 0)[:, None], wrong, single)
    return np.maximum(c, 0.0)


def _stationary(
    G: np.ndarray, b: np.ndarray, P: np.ndarray, total: float | None
) -> tuple[Float[np.ndarray, "n class"], Float[np.ndarray, "n class"]]:
    """c of the passive variables alone, and the slope along each of the others."""
    inverse = _inverses(G, P)
    c = (inverse @ b[..., None])[..., 0]
    force = np.zeros((len(b), 1))
    if total is not None:
        one = inverse.sum(axis=2)
        force = ((total - c.sum(axis=1)) / one.sum(axis=1))[:, None]
        c = c + force * one
    return c, (G @ c[..., None])[..., 0] - b - force


def _inverses(
    G: Float[np.ndarray, "m class class"], P: Bool[np.ndarray, "n class"]
) -> Float[np.ndarray, "n class class"]:
    """Of the passive part of each, 0 elsewhere."""
    if len(G) == 1:
        codes, of = np.unique(P @ (1 << np.arange(P.shape[1])), return_inverse=True)
        sets = (codes[:, None] >> np.arange(P.shape[1]) & 1).astype(bool)
        return _inverted(G, sets)[of]
    return _inverted(G, P)


def _inverted(G: np.ndarray, P: np.ndarray) -> np.ndarray:
    both = P[:, :, None] & P[:, None, :]
    eye = np.eye(P.shape[1])
    return np.where(both, np.linalg.inv(np.where(both, G, eye)), 0.0)
