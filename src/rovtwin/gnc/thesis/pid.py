"""Control: decoupled PID controllers on the pose error seen from the body.

    e = J(eta)^-1 (eta_ref - eta),   tau = K_p e + K_i int e dt + K_d de/dt        (thesis 7.4-7.6)

The Euler angles' difference is wrapped first. de/dt is taken as the reference's velocity seen from b minus the
measured nu; the term that comes from the turning of b is left out, as usual (Fossen 2021, sec. 15.2).
"""

from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.core.arrays.filters import integrated
from rovtwin.core.block import Block, Start
from rovtwin.core.flow import Estimate, Reference, Wrench
from rovtwin.core.frames import body_rates_from_euler_rates, wrap
from rovtwin.core.numerics import as_array, jnp
from rovtwin.core.types import PRNGKey, Vector6
from rovtwin.gnc.interfaces import ControlInput
from rovtwin.vehicle.physics.actuation import pushed_axes, wrench_limits
from rovtwin.vehicle.physics.linearisation import damping_jacobian, restoring_stiffness
from rovtwin.vehicle.physics.model import Model


class Pid(Block):
    """Six decoupled PIDs, one per axis of b; memory is the integral term [N, N m].

    Anti-windup: an axis does not integrate in the direction in which it is already cut short, by its own limit
    or by the allocation.

    Attributes:
        K_p: Of the pose error [N/m, N m/rad].
        K_i: Of its integral [N/(m s), N m/(rad s)].
        K_d: Of its rate [N s/m, N m s/rad].
        lower: Least output [N, N m].
        upper: Greatest output [N, N m].
    """

    K_p: Vector6 = eqx.field(converter=as_array)
    K_i: Vector6 = eqx.field(converter=as_array)
    K_d: Vector6 = eqx.field(converter=as_array)
    lower: Vector6 = eqx.field(converter=as_array)
    upper: Vector6 = eqx.field(converter=as_array)

    def init(self, key: PRNGKey, start: Start) -> Vector6:
        return jnp.zeros(6)

    def step(self, memory: Vector6, input: ControlInput, dt: float) -> tuple[Vector6, Wrench]:
        e, e_dot = body_error(input.estimate, input.reference)
        growth = self.K_i * e * dt
        unlimited = self.K_p * e + memory + growth + self.K_d * e_dot
        tau = jnp.clip(unlimited, self.lower, self.upper)
        cut = unlimited - tau
        return integrated(memory, growth, cut, input.shortfall), Wrench(tau, cut != 0.0)

    @classmethod
    def table_7_1(cls, model: Model) -> "Pid":
        """The thesis's gains for guidance, table 7.1: errors in metres and radians, outputs in newtons.

        Without K_i in surge, sway and heave a constant force F leaves an error of F / K_p (2 N: 2 m of depth).
        """
        return cls(
            K_p=[1.5, 1.0, 1.0, 3.0, 0.0, 0.6],
            K_i=[0.0, 0.0, 0.0, 2.0, 0.0, 0.0],
            K_d=[1.0, 1.0, 1.0, 0.0, 0.0, 1.0],
            **_limits(model),
        )

    @classmethod
    def table_3_2(cls) -> "Pid":
        """The thesis's gains of the free-running tests, table 3.2: depth and heading are held, the rest is free."""
        limit = np.array([0.0, 0.0, 22.0, 0.0, 0.0, 5.5])
        return cls(
            K_p=[0.0, 0.0, 30.0, 0.0, 0.0, 1.2],
            K_i=[0.0, 0.0, 0.0, 0.0, 0.0, 0.1],
            K_d=[0.0, 0.0, 1.0, 0.0, 0.0, 5.0],
            lower=-limit,
            upper=limit,
        )

    @classmethod
    def pole_placement(
        cls,
        model: Model,
        bandwidth: Any = (0.5, 0.5, 0.6, 1.0, 1.0, 0.8),
        damping_ratio: Any = 1.0,
        integral: Any = 0.1,
        speed: Any = 0.0,
    ) -> "Pid":
        """Gains from the model: the error of each axis moves as a second-order system of chosen frequency.

        K_p = m w^2 - g, K_d = 2 zeta w m - d, K_i = 0.1 w m w^2, with m, d and g the diagonals of inertia, linearised
        damping and restoring stiffness. Where the water alone damps or stiffens more than asked for, the gain is
        zero, never negative. Axes along which thrusters can do little get no gain.

        Args:
            model: The vehicle.
            bandwidth: Natural frequency w of each axis [rad/s], shape (6,).
            damping_ratio: zeta, scalar or shape (6,).
            integral: Share of w that the integral's rate is, scalar or shape (6,); 0 is no integral. The 0.1 of the
                algorithm makes a step overshoot by a fifth: let the reference model keep errors small.
            speed: |nu| at which damping is linearised [m/s, rad/s], scalar or shape (6,).

        Reference: Fossen (2021), algorithm 15.1 and eqs. 15.74-15.76.
        """
        w, zeta = as_array(bandwidth), as_array(damping_ratio)
        m, d, g = jnp.diagonal(model.inertia), linearised_damping(model, speed), restoring_stiffness(model)
        able = as_array(pushed_axes(model))
        return cls(
            K_p=able * jnp.maximum(m * w**2 - g, 0.0),
            K_i=able * as_array(integral) * m * w**3,
            K_d=able * jnp.maximum(2.0 * zeta * w * m - d, 0.0),
            **_limits(model),
        )


def body_error(estimate: Estimate, reference: Reference) -> tuple[Vector6, Vector6]:
    """Pose error seen from b and its rate: J^-1 (eta_ref - eta), wrapped, and J^-1 eta_ref_dot - nu."""
    eta, eta_dot = estimate.eta, reference.eta_dot
    R_bn, W = estimate.R_nb.T, body_rates_from_euler_rates(eta[3:])
    away = reference.eta - eta
    e = jnp.concatenate([R_bn @ away[:3], W @ wrap(away[3:])])
    nu_ref = jnp.concatenate([R_bn @ eta_dot[:3], W @ eta_dot[3:]])
    return e, nu_ref - estimate.nu


def linearised_damping(model: Model, speed: Any = 0.0) -> Vector6:
    """Slope of the damping of each axis at a speed, mean of ahead and astern [N s/m, N m s/rad]."""
    nu = jnp.broadcast_to(as_array(speed), 6)
    return 0.5 * jnp.diagonal(damping_jacobian(model, nu) + damping_jacobian(model, -nu))


def _limits(model: Model) -> dict[str, Vector6]:
    lower, upper = wrench_limits(model.thrusters)
    return {"lower": lower, "upper": upper}
