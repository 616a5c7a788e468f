"""The equations of motion once more, in plain NumPy and textbook form: the oracle of the physics tests.

Written independently of `rovtwin.vehicle.physics.dynamics` and on purpose in another form: explicit scalar matrices
C_RB and C_A, rigid body in the velocity over ground (so nothing relies on moving C_RB to nu_r), Euler angles for the
attitude. It is also the plain NumPy side of the benchmarks.

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 2, 3, 4, 6; thesis (2.4)-(2.12)
with the corrections of its errata.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import cos, sin, tan
from typing import Any

import numpy as np


@dataclass
class Plant:
    """Parameters as a textbook lists them; SI, body frame at CO."""

    m: float
    I_b: np.ndarray  # inertia tensor about CO
    r_g: np.ndarray
    r_b: np.ndarray
    W: float
    B: float
    M_A: np.ndarray
    linear_ahead: np.ndarray
    linear_astern: np.ndarray
    quadratic_ahead: np.ndarray
    quadratic_astern: np.ndarray
    displaced_mass: float
    T: np.ndarray = field(default_factory=lambda: np.zeros((6, 0)))
    force_ahead: np.ndarray = field(default_factory=lambda: np.zeros(0))
    force_astern: np.ndarray = field(default_factory=lambda: np.zeros(0))
    exponent: np.ndarray = field(default_factory=lambda: np.ones(0))
    dead_band: np.ndarray = field(default_factory=lambda: np.zeros(0))
    time_constant: np.ndarray = field(default_factory=lambda: np.zeros(0))
    M_inv: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.M_RB = rigid_body_matrix(self.m, self.I_b, self.r_g)
        self.M_inv = np.linalg.inv(self.M_RB + self.M_A)


def plant_of(model: Any) -> Plant:
    """The same vehicle for the oracle; reads arrays of a `Model` only."""
    M_RB, thrusters = np.asarray(model.rigid_body_mass), model.thrusters
    return Plant(
        m=float(M_RB[0, 0]),
        I_b=M_RB[3:, 3:],
        r_g=np.asarray(model.center_of_gravity),
        r_b=np.asarray(model.center_of_buoyancy),
        W=float(model.weight),
        B=float(model.buoyancy),
        M_A=np.asarray(model.added_mass),
        linear_ahead=np.asarray(model.linear_damping_ahead),
        linear_astern=np.asarray(model.linear_damping_astern),
        quadratic_ahead=np.asarray(model.quadratic_damping_ahead),
        quadratic_astern=np.asarray(model.quadratic_damping_astern),
        displaced_mass=float(model.displaced_mass),
        T=np.asarray(thrusters.configuration),
        force_ahead=np.asarray(thrusters.force_ahead),
        force_astern=np.asarray(thrusters.force_astern),
        exponent=np.asarray(thrusters.exponent),
        dead_band=np.asarray(thrusters.dead_band),
        time_constant=np.asarray(thrusters.time_constant),
    )


def rigid_body_matrix(m: float, I_b: np.ndarray, r_g: np.ndarray) -> np.ndarray:
    """M_RB at CO. Fossen (2021), eq. 3.49; thesis (2.6)."""
    x, y, z = r_g
    M = np.zeros((6, 6))
    M[:3, :3] = m * np.eye(3)
    M[3:, 3:] = I_b
    M[:3, 3:] = m * np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    M[3:, :3] = M[:3, 3:].T
    return M


def rigid_body_coriolis(m: float, I_b: np.ndarray, r_g: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """C_RB(nu), shape (6, 6), element by element. Fossen (1994), eq. 2.93; thesis (2.7)-(2.8)."""
    (x_g, y_g, z_g), (u, v, w, p, q, r) = r_g, nu
    I_x, I_y, I_z = I_b[0, 0], I_b[1, 1], I_b[2, 2]
    I_xy, I_xz, I_yz = -I_b[0, 1], -I_b[0, 2], -I_b[1, 2]
    C = np.zeros((6, 6))
    C[3:, :3] = m * np.array(
        [
            [-(y_g * q + z_g * r), y_g * p + w, z_g * p - v],
            [x_g * q - w, -(z_g * r + x_g * p), z_g * q + u],
            [x_g * r + v, y_g * r - u, -(x_g * p + y_g * q)],
        ]
    )
    C[:3, 3:] = -C[3:, :3].T
    C[3:, 3:] = np.array(
        [
            [0, -I_yz * q - I_xz * p + I_z * r, I_yz * r + I_xy * p - I_y * q],
            [I_yz * q + I_xz * p - I_z * r, 0, -I_xz * r - I_xy * q + I_x * p],
            [-I_yz * r - I_xy * p + I_y * q, I_xz * r + I_xy * q - I_x * p, 0],
        ]
    )
    return C


def added_mass_coriolis(M_A: np.ndarray, nu_r: np.ndarray) -> np.ndarray:
    """C_A(nu_r), shape (6, 6), of a full M_A. Fossen (2021), eq. 6.43-6.44; thesis (2.10) with w_r for omega_r."""
    a1, a2, a3, b1, b2, b3 = -M_A @ nu_r
    return np.array(
        [
            [0, 0, 0, 0, -a3, a2],
            [0, 0, 0, a3, 0, -a1],
            [0, 0, 0, -a2, a1, 0],
            [0, -a3, a2, 0, -b3, b2],
            [a3, 0, -a1, b3, 0, -b1],
            [-a2, a1, 0, -b2, b1, 0],
        ]
    )


def damping(plant: Plant, nu_r: np.ndarray) -> np.ndarray:
    """D(nu_r) nu_r: per column the coefficients of the direction in which that velocity points."""
    ahead = nu_r >= 0
    linear = np.where(ahead, plant.linear_ahead, plant.linear_astern)
    quadratic = np.where(ahead, plant.quadratic_ahead, plant.quadratic_astern)
    return (linear + quadratic * np.abs(nu_r)) @ nu_r


def restoring(plant: Plant, phi: float, theta: float) -> np.ndarray:
    """g(eta), shape (6,), element by element. Fossen (2021), eq. 4.6; thesis (2.12) in full."""
    (x_g, y_g, z_g), (x_b, y_b, z_b), W, B = plant.r_g, plant.r_b, plant.W, plant.B
    sf, cf, st, ct = sin(phi), cos(phi), sin(theta), cos(theta)
    return np.array(
        [
            (W - B) * st,
            -(W - B) * ct * sf,
            -(W - B) * ct * cf,
            -(y_g * W - y_b * B) * ct * cf + (z_g * W - z_b * B) * ct * sf,
            (z_g * W - z_b * B) * st + (x_g * W - x_b * B) * ct * cf,
            -(x_g * W - x_b * B) * ct * sf - (y_g * W - y_b * B) * st,
        ]
    )


def rotation(phi: float, theta: float, psi: float) -> np.ndarray:
    """R_nb, shape (3, 3), element by element. Fossen (2021), eq. 2.31; thesis (2.4) as the errata mend it."""
    sf, cf, st, ct, sp, cp = sin(phi), cos(phi), sin(theta), cos(theta), sin(psi), cos(psi)
    return np.array(
        [
            [cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st],
            [sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf],
            [-st, ct * sf, ct * cf],
        ]
    )


def pose_rate(eta: np.ndarray, nu: np.ndarray) -> np.ndarray:
    """eta_dot = J(eta) nu with zyx Euler angles. Fossen (2021), eq. 2.53."""
    phi, theta, psi = eta[3:]
    p, q, r = nu[3:]
    sf, cf, ct, tt = sin(phi), cos(phi), cos(theta), tan(theta)
    angles = [p + (q * sf + r * cf) * tt, q * cf - r * sf, (q * sf + r * cf) / ct]
    return np.concatenate([rotation(phi, theta, psi) @ nu[:3], angles])


def acceleration(
    plant: Plant,
    eta: np.ndarray,
    nu: np.ndarray,
    tau: np.ndarray,
    v_c: np.ndarray | None = None,
    a_f: np.ndarray | None = None,
    gradient: np.ndarray | None = None,
) -> np.ndarray:
    """nu_dot: M_RB nu_dot + C_RB(nu) nu + M_A nu_r_dot + C_A(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau + m_f a_f.

    The rigid body obeys Newton in the frame that stands still, whatever the water does. The water seen at CO changes
    by its particles' acceleration a_f and by what CO leaves them behind with, G (v - v_c); both count in d(nu_c)/dt.

    Args:
        plant: The vehicle.
        eta: Pose, Euler angles.
        nu: Velocity over ground.
        tau: Wrench on the vehicle.
        v_c: Current in n [m/s].
        a_f: Acceleration of the water particles in n [m/s2].
        gradient: G, d v_c,i / d x_j in n [1/s].
    """
    R = rotation(*eta[3:])
    nu_c, nu_c_dot, pressure = np.zeros(6), np.zeros(6), np.zeros(6)
    if v_c is not None:
        p, q, r = nu[3:]
        S = np.array([[0, -r, q], [r, 0, -p], [-q, p, 0]])
        nu_c[:3] = R.T @ v_c
        nu_c_dot[:3] = -S @ nu_c[:3]
        if gradient is not None:
            nu_c_dot[:3] += R.T @ (gradient @ (R @ nu[:3] - v_c))
    if a_f is not None:
        a = R.T @ a_f
        nu_c_dot[:3] += a
        pressure = plant.displaced_mass * np.concatenate([a, np.cross(plant.r_b, a)])
    nu_r = nu - nu_c
    right = (
        tau
        + pressure
        + plant.M_A @ nu_c_dot
        - rigid_body_coriolis(plant.m, plant.I_b, plant.r_g, nu) @ nu
        - added_mass_coriolis(plant.M_A, nu_r) @ nu_r
        - damping(plant, nu_r)
        - restoring(plant, eta[3], eta[4])
    )
    return plant.M_inv @ right


def rk4(derivative: Callable[[float, np.ndarray], np.ndarray], t: float, x: np.ndarray, dt: float) -> np.ndarray:
    """One classical Runge-Kutta step."""
    k1 = derivative(t, x)
    k2 = derivative(t + dt / 2, x + dt / 2 * k1)
    k3 = derivative(t + dt / 2, x + dt / 2 * k2)
    k4 = derivative(t + dt, x + dt * k3)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def thruster_force(plant: Plant, u: np.ndarray) -> np.ndarray:
    """Settled force of each thruster: dead band, power law, limits ahead and astern."""
    u = np.clip(u, -1, 1)
    x = np.maximum(np.abs(u) - plant.dead_band, 0) / (1 - plant.dead_band)
    return np.where(u >= 0, plant.force_ahead, -plant.force_astern) * x**plant.exponent


def step(
    plant: Plant, x: np.ndarray, thrust: np.ndarray, u: np.ndarray, dt: float, v_c: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """State [eta, nu], shape (12,), and thruster forces dt later, for a held command in a steady current.

    A thruster with time constant zero has its new force at once.
    """
    target = thruster_force(plant, u)
    tau_T = np.where(plant.time_constant > 0, plant.time_constant, 1.0)
    distance = np.where(plant.time_constant > 0, thrust - target, 0.0)

    def force(t: float) -> np.ndarray:
        return target + distance * np.exp(-t / tau_T)

    def derivative(t: float, x: np.ndarray) -> np.ndarray:
        eta, nu = x[:6], x[6:]
        return np.concatenate([pose_rate(eta, nu), acceleration(plant, eta, nu, plant.T @ force(t), v_c)])

    return rk4(derivative, 0.0, x, dt), force(dt)
