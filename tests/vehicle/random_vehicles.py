"""Random vehicles that nature allows, all of one shape so that each function compiles once.

The mass distribution is drawn, not the inertia tensor, so the triangle inequality of inertias holds by construction;
the added mass is a full symmetric positive definite matrix; the damping may couple and differ ahead and astern, but
takes energy out for every velocity.
"""

import numpy as np
from hypothesis import strategies as st

from rovtwin.core.numerics import jnp
from rovtwin.vehicle.physics.dynamics import State
from rovtwin.vehicle.physics.model import GRAVITY, Model, rigid_body_matrix
from rovtwin.vehicle.physics.thrusters import Thrusters

THRUSTERS = 8  # columns; those a vehicle does not have give no force

seeds = st.integers(0, 2**32 - 1)


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def correlation(rng: np.random.Generator, strength: float) -> np.ndarray:
    """Positive definite with ones on the diagonal, shape (6, 6)."""
    a = rng.normal(size=(6, 9))
    c = a @ a.T
    d = np.sqrt(np.diag(c))
    return (1 - strength) * np.eye(6) + strength * c / np.outer(d, d)


def random_inertia(rng: np.random.Generator, mass: float, size: float) -> np.ndarray:
    """About the centre of gravity, from the second moments of a mass distribution in random axes."""
    moments = mass * (size * rng.uniform(0.2, 0.6, 3)) ** 2
    R = rotation(rng)
    return R @ np.diag(moments.sum() - moments) @ R.T


def random_quadratic(rng: np.random.Generator, size: np.ndarray, coupled: bool) -> np.ndarray:
    """Columns j times |nu_j| nu_j; the diagonal dominates so that nu . D(nu) nu >= 0 for every nu.

    By Young's inequality |a| b^2 <= |a|^3 / 3 + 2 |b|^3 / 3, so d_k >= sum_j |D_kj| / 3 + 2 sum_i |D_ik| / 3 suffices.
    """
    if not coupled:
        return np.diag(size)
    off = rng.uniform(-0.2, 0.2, (6, 6)) * np.sqrt(np.outer(size, size))
    np.fill_diagonal(off, 0)
    need = np.abs(off).sum(1) / 3 + 2 * np.abs(off).sum(0) / 3
    return off + np.diag(np.maximum(size, need))


def random_thrusters(rng: np.random.Generator, count: int, largest: float) -> Thrusters:
    direction = rng.normal(size=(3, THRUSTERS))
    direction /= np.linalg.norm(direction, axis=0)
    place = rng.uniform(-0.4, 0.4, (3, THRUSTERS))
    there = np.arange(THRUSTERS) < count
    force = rng.uniform(0.2, 1.0, (2, THRUSTERS)) * largest * there
    return Thrusters(
        configuration=jnp.asarray(np.vstack([direction, np.cross(place, direction, axis=0)])),
        force_ahead=jnp.asarray(force[0]),
        force_astern=jnp.asarray(force[1]),
        exponent=jnp.asarray(rng.uniform(1.0, 2.0, THRUSTERS)),
        dead_band=jnp.asarray(rng.uniform(0.0, 0.1, THRUSTERS)),
        time_constant=jnp.asarray(rng.uniform(0.05, 0.4, THRUSTERS) * (rng.random(THRUSTERS) < 0.8)),
        rate_limit=jnp.full(THRUSTERS, jnp.inf),
        quantisation=jnp.zeros(THRUSTERS),
        health=jnp.ones(THRUSTERS),
        table_command=jnp.array([-1.0, 1.0]),
        table_force=jnp.zeros((THRUSTERS, 2)),
        tabulated=jnp.zeros(THRUSTERS, dtype=bool),
    )


def build(
    seed: int,
    *,
    neutral: bool = False,
    centred: bool = False,
    drag: bool = True,
    coupled: bool = True,
    astern: bool = True,
    count: int = 6,
) -> Model:
    """One vehicle.

    Args:
        seed: Of everything that is not said below.
        neutral: W = B.
        centred: CG = CB (not at CO).
        drag: Whether there is damping.
        coupled: Whether damping couples.
        astern: Whether damping differs ahead and astern.
        count: Thrusters, up to THRUSTERS.
    """
    rng = np.random.default_rng(seed)
    mass = 5.0 * 20.0 ** rng.random()
    size = (mass / 1000.0) ** (1 / 3) * rng.uniform(1.5, 3.0)
    r_g = rng.uniform(-0.05, 0.05, 3)
    scale = np.sqrt(mass * np.array([1, 1, 1, size**2 / 6, size**2 / 6, size**2 / 6]) * rng.uniform(0.2, 3.0, 6))
    reach = np.array([1, 1, 1, size, size, size])
    half = correlation(rng, 0.6 if coupled else 0.0) * np.outer(reach, reach)
    linear = half * np.outer(*2 * [np.sqrt(rng.uniform(2.0, 15.0, 6))]) * drag
    quadratic = random_quadratic(rng, rng.uniform(10.0, 60.0, 6) * reach**3, coupled) * drag
    more_linear, more_quadratic = (np.diag(rng.uniform(0.0, 10.0, 6) * reach**k) * drag * astern for k in (2, 3))
    weight = mass * GRAVITY
    buoyancy = weight * (1.0 if neutral else rng.uniform(0.95, 1.05))
    return Model(
        rigid_body_mass=rigid_body_matrix(mass, random_inertia(rng, mass, size), r_g),
        added_mass=correlation(rng, 0.7) * np.outer(scale, scale),
        linear_damping_ahead=linear,
        linear_damping_astern=linear + more_linear,
        quadratic_damping_ahead=quadratic,
        quadratic_damping_astern=quadratic + more_quadratic,
        weight=weight,
        buoyancy=buoyancy,
        center_of_gravity=r_g,
        center_of_buoyancy=r_g if centred else r_g + rng.uniform(-0.05, 0.05, 3),
        thrusters=random_thrusters(rng, count, 0.3 * mass),
    )


def vehicles(**fixed):
    """Strategy of vehicles; what is not fixed (see `build`) varies."""
    free = {
        "neutral": st.booleans(),
        "centred": st.booleans(),
        "coupled": st.booleans(),
        "astern": st.booleans(),
        "count": st.integers(3, THRUSTERS),
    }
    return st.builds(
        build, seeds, **{k: v for k, v in free.items() if k not in fixed}, **{k: st.just(v) for k, v in fixed.items()}
    )


def random_quaternion(rng: np.random.Generator) -> np.ndarray:
    q = rng.normal(size=4)
    return q / np.linalg.norm(q)


def random_nu(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, 6) * np.array([1, 1, 1, 0.8, 0.8, 0.8])


def random_state(seed: int) -> State:
    """Any place, any attitude, moving, thrusters at rest."""
    rng = np.random.default_rng(seed)
    parts = rng.uniform(-5, 5, 3), random_quaternion(rng), random_nu(rng), np.zeros(THRUSTERS)
    return State(*map(jnp.asarray, parts))


states = st.builds(random_state, seeds)
vectors = st.builds(lambda seed: np.random.default_rng(seed).uniform(-0.5, 0.5, 3), seeds)
velocities = st.builds(lambda seed: random_nu(np.random.default_rng(seed)), seeds)
rotations = st.builds(lambda seed: random_quaternion(np.random.default_rng(seed)), seeds)
