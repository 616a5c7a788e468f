"""Least squares with a chain of nodes and a common border: solved in time linear in the number of nodes.

The matrix is block tridiagonal in the nodes (each is tied to the next) with a dense border of parameters that all
share. References: Rauch, Tung and Striebel (1965) for the chain; Golub and Van Loan (2013), sec. 4.5.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve


@dataclass(eq=False)
class Arrow:
    """H z = b with z = (x_1 ... x_S, theta): blocks of size d, border of size n.

    Attributes:
        own: H_ss.
        next: H_{s,s+1}; the last is zero.
        border: H_{s,theta}.
        corner: H_{theta,theta}.
        b: Right-hand side of the nodes.
        b_corner: Of the border.
    """

    own: Float[np.ndarray, "S d d"]
    next: Float[np.ndarray, "S d d"]
    border: Float[np.ndarray, "S d n"]
    corner: Float[np.ndarray, "n n"]
    b: Float[np.ndarray, "S d"]
    b_corner: Float[np.ndarray, " n"]

    def gain(self) -> float:
        """b' H^-1 b: by how much the sum of squares falls at z, were it quadratic."""
        factored = self.factor()
        theta = factored.border()
        return float(self.b_corner @ theta + np.sum(self.b * factored.nodes(theta)))

    def factor(self) -> "Factored":
        """Raises LinAlgError where H is not positive definite."""
        S, d = self.b.shape
        n = len(self.b_corner)
        # Columns of what each node is solved for: the next node, the border, the right-hand side.
        columns = np.concatenate([self.next, self.border, self.b[:, :, None]], axis=2)
        half, roots, own = np.empty_like(columns), np.empty((S, d, d)), self.own[0]
        for s in range(S):
            if s > 0:
                tie = half[s - 1, :, :d].T
                own = self.own[s] - tie @ tie.T
                columns[s, :, d:] -= tie @ half[s - 1, :, d:]
            # LAPACK's triangular solvers start threads even for 12 rows, and wait for them on a busy machine.
            roots[s] = np.linalg.inv(np.linalg.cholesky(own))
            half[s] = roots[s] @ columns[s]
        back = np.swapaxes(roots, 1, 2)
        gains, inverses = back @ half, back @ roots
        eliminated = half[:, :, d:-1].reshape(S * d, n).T @ half[:, :, d:].reshape(S * d, n + 1)
        corner = self.corner - eliminated[:, :-1]
        return Factored(gains, inverses, 0.5 * (corner + corner.T), self.b_corner - eliminated[:, -1])


@dataclass(eq=False)
class Factored:
    """The chain eliminated: what is left is `corner` theta = b_corner, the information on the parameters alone."""

    gains: Float[np.ndarray, "S d _"]
    inverses: Float[np.ndarray, "S d d"]
    corner: Float[np.ndarray, "n n"]
    b_corner: Float[np.ndarray, " n"]

    def border(self, damping: Float[np.ndarray, " n"] | None = None) -> Float[np.ndarray, " n"]:
        """theta, with something added to the diagonal of what is known of it (Levenberg-Marquardt)."""
        corner = self.corner if damping is None else self.corner + np.diag(damping)
        return cho_solve(cho_factor(corner), self.b_corner)

    def border_std(self) -> Float[np.ndarray, " n"]:
        """Standard deviations of theta."""
        return np.sqrt(np.diag(cho_solve(cho_factor(self.corner), np.eye(len(self.b_corner)))))

    def nodes(self, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, "S d"]:
        """x at a theta."""
        S, d, _ = self.gains.shape
        x = np.zeros((S, d))
        for s in reversed(range(S)):
            x[s] = self.gains[s, :, -1] - self.gains[s, :, d:-1] @ theta
            if s + 1 < S:
                x[s] -= self.gains[s, :, :d] @ x[s + 1]
        return x

    def follow(self) -> Float[np.ndarray, "S d n"]:
        """How the nodes move with theta while each stays where it is best."""
        S, d, _ = self.gains.shape
        x = -self.gains[:, :, d:-1]
        for s in reversed(range(S - 1)):
            x[s] -= self.gains[s, :, :d] @ x[s + 1]
        return x

    def covariance(
        self,
    ) -> tuple[
        Float[np.ndarray, "S d d"], Float[np.ndarray, "S d d"], Float[np.ndarray, "S d n"], Float[np.ndarray, "n n"]
    ]:
        """Blocks of H^-1: nodes, node and next, node and theta, theta."""
        S, d, _ = self.gains.shape
        n = len(self.b_corner)
        corner = cho_solve(cho_factor(self.corner), np.eye(n))
        own, following, border = np.empty((S, d, d)), np.zeros((S, d, d)), np.empty((S, d, n))
        for s in reversed(range(S)):
            G, T = self.gains[s, :, :d], self.gains[s, :, d:-1]
            border[s] = -T @ corner
            own[s] = self.inverses[s]
            if s + 1 < S:
                border[s] -= G @ border[s + 1]
                following[s] = -G @ own[s + 1] - T @ border[s + 1].T
                own[s] = own[s] - following[s] @ G.T
            own[s] = own[s] - border[s] @ T.T
            own[s] = 0.5 * (own[s] + own[s].T)
        return own, following, border, corner
