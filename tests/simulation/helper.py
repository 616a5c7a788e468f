"""A small vehicle, seas and the statistics that the tests of the world share."""

import numpy as np
from scipy import stats

from rovtwin.core.numerics import jnp
from rovtwin.simulation.environment.airy import AirySea
from rovtwin.simulation.environment.sea import SeaState
from rovtwin.vehicle.physics.dynamics import State
from rovtwin.vehicle.physics.model import GRAVITY, Model, rigid_body_matrix
from rovtwin.vehicle.physics.thrusters import thrusters_from

LEVEL = (1.0, 0.0, 0.0, 0.0)
SMALL_SEA = AirySea.of(SeaState.of(0.27, zero_crossing_period=3.0, gamma=3.3), direction=np.pi, depth=20.0)
SHORT_CRESTED = AirySea.of(
    SeaState.of(1.5, zero_crossing_period=5.7), direction=0.4, depth=12.0, spreading=2.0, count=24
)


def one_wave(amplitude=1.0, omega=1.0, direction=0.0) -> AirySea:
    """A regular wave in deep water."""
    return AirySea([amplitude], [omega], [omega**2 / GRAVITY], [direction])


def vehicle(**changes) -> Model:
    """30 kg, neutral, six thrusters along the axes; nothing in it is zero or equal that need not be."""
    parameters = {
        "rigid_body_mass": rigid_body_matrix(30.0, np.diag([2.8, 0.9, 3.1]), (0.01, 0.0, 0.02)),
        "added_mass": np.diag([9.0, 13.0, 40.0, 2.0, 0.7, 0.9]),
        "linear_damping_ahead": np.diag([6.5, 9.0, 20.0, 3.0, 1.3, 0.5]),
        "quadratic_damping_ahead": np.diag([159.0, 200.0, 300.0, 4.0, 3.0, 18.0]),
        "weight": 30.0 * GRAVITY,
        "buoyancy": 30.0 * GRAVITY,
        "center_of_gravity": (0.01, 0.0, 0.02),
        "center_of_buoyancy": (0.01, 0.0, 0.0),
        "thrusters": thrusters_from(jnp.eye(6), jnp.full(6, 10.0), time_constant=jnp.full(6, 0.2)),
    }
    return Model(**(parameters | changes))


def state(position=(0.0, 0.0, 0.0), attitude=LEVEL, nu=(0.0,) * 6, thrusters: int = 0) -> State:
    return State(jnp.array(position), jnp.array(attitude), jnp.array(nu), jnp.zeros(thrusters))


def variance_interval(n: int, risk: float = 1e-4) -> tuple[float, float]:
    """Within which the sample variance of n independent normal numbers of unit variance lies, but for `risk`."""
    low, high = stats.chi2.ppf([risk / 2, 1 - risk / 2], n - 1) / (n - 1)
    return float(low), float(high)


def mean_interval(n: int, risk: float = 1e-4) -> float:
    """Largest |mean| of n independent normal numbers of unit variance, but for `risk`."""
    return float(stats.norm.ppf(1 - risk / 2) / np.sqrt(n))
