"""The linear decay formulae, as printed and as they hold: for published curves of which only the fit is left.

The thesis fits angle = A exp(-b t / 2) cos(omega t) and takes inertia and damping from b and omega, (2.27)-(2.29). A
vehicle released from rest has a phase: angle = A / cos(eps) exp(-b t / 2) cos(omega t - eps), eps = atan(b / 2 omega);
without it the fit reports a swing that is slower and more damped than the vehicle's.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.decay.motion import swing

DURATION, DT = 12.0, 0.01  # of the simulated decay [s]: the thesis's figures 3.13 and 3.14 show about as much


@dataclass(frozen=True, eq=False)
class Cosine:
    """A damped cosine through a decay.

    Attributes:
        amplitude: [rad].
        half_b: b / 2 [1/s].
        omega: Damped frequency [rad/s].
        phase: eps [rad].
        covariance: Of (half_b, omega) [1/s2].
    """

    amplitude: float
    half_b: float
    omega: float
    phase: float
    covariance: Float[np.ndarray, "2 2"]

    @property
    def rest_phase(self) -> float:
        """The phase of a release from rest with this damping and frequency [rad]."""
        return float(np.arctan2(self.half_b, self.omega))


def fit_cosine(t: Float[np.ndarray, " n"], angle: Float[np.ndarray, " n"], *, phase: bool) -> Cosine:
    """Fit thesis (2.27) to a decay that begins with its release and ends at 0.

    Args:
        t: Times from the release [s].
        angle: [rad].
        phase: False as the thesis fitted it: no phase, the first angle as amplitude; True: both free.

    Raises:
        IdentificationError: No damped cosine fits.
    """
    start = float(angle[0])

    def error(p: Float[np.ndarray, " p"]) -> Float[np.ndarray, " n"]:
        amplitude, eps = (p[2], p[3]) if phase else (start, 0.0)
        return amplitude * np.exp(-p[0] * t) * np.cos(p[1] * t - eps) - angle

    below = np.flatnonzero(angle * np.sign(start) < 0)
    if not len(below):
        raise IdentificationError("decay: the angle never passes through 0, so no frequency can be seen")
    omega = np.pi / 2 / float(t[below[0]] - t[0])
    found = least_squares(error, [0.3 * omega, omega, *((start, 0.2) if phase else ())])
    n, k = found.jac.shape
    variance = float(found.fun @ found.fun) / max(n - k, 1)
    covariance = np.linalg.pinv(found.jac.T @ found.jac)[:2, :2] * variance
    amplitude, eps = (float(found.x[2]), float(found.x[3])) if phase else (start, 0.0)
    return Cosine(amplitude, float(found.x[0]), float(found.x[1]), eps, covariance)


def inertia_and_damping(half_b: float, omega: float, stiffness: float) -> tuple[float, float]:
    """Thesis (2.28) and (2.29): inertia with added mass [kg m2] and linear damping [N m s/rad].

    Args:
        half_b: b / 2 [1/s].
        omega: [rad/s].
        stiffness: W BG [N m/rad], W a force. The thesis puts 30 kg x 0.17 m here, which lacks g.
    """
    inertia = stiffness / (omega**2 + half_b**2)
    return inertia, 2 * half_b * inertia


def from_rest(angle: float, half_b: float, omega: float, quadratic: float = 0.0) -> tuple[float, float]:
    """The vehicle behind a printed fit without phase: the swing from rest to which just that cosine would be fitted.

    Args:
        angle: At the release [rad].
        half_b: As printed, b / 2 [1/s].
        omega: As printed [rad/s].
        quadratic: D_Q / k, where it is known from elsewhere [s2/rad2].

    Returns:
        c = k / J [1/s2] and b = D_L / J [1/s] of J x'' + D_L x' + D_Q |x'| x' + k sin(x) = 0.

    Raises:
        IdentificationError: No such vehicle.
    """
    t = np.arange(0.0, DURATION, DT)

    def error(p: Float[np.ndarray, "2"]) -> Float[np.ndarray, "2"]:
        c = float(np.exp(p[0]))
        found = fit_cosine(t, swing(t, (angle, 0.0), c, p[1], quadratic * c, 0.05 / np.sqrt(c)), phase=False)
        return np.array([found.half_b - half_b, found.omega - omega])

    guess = [np.log(omega**2 + half_b**2), 1.5 * half_b]
    solved = least_squares(error, guess, diff_step=1e-4)
    if np.abs(solved.fun).max() > 1e-4:
        raise IdentificationError(
            f"decay: no vehicle released from rest at {np.degrees(angle):.3g} deg is fitted by b/2 {half_b:g} 1/s, "
            f"omega {omega:g} rad/s"
        )
    return float(np.exp(solved.x[0])), float(solved.x[1])
