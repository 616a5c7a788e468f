"""The plant: 6-DOF equations of motion in matrix form, one step and a roll-out.

    eta_dot = J(eta) nu
    M nu_r_dot + C(nu_r) nu_r + D(nu_r) nu_r + g(eta) = tau + tau_d(nu_r, tau) + tau_env - M_RB a_c + m_f a_f
    nu_dot = nu_r_dot + d(nu_c)/dt

tau is T f less what an inflow takes of it (`thrusters.inflow_wrench`), where the thrusters state such a loss.
tau_d is what tests have found to be missing (`vehicle/physics/discrepancy.py`); most models have none.

M = M_RB + M_A. Writing the rigid body's part in nu_r is exact, not an approximation: the frame that moves with the
local water is inertial but for its acceleration, which the last two terms hold (a_c along the vehicle's path on the
rigid body, a_f of the water particles as the pressure gradient on the displaced mass m_f). In a steady uniform current
both vanish and what is left is Fossen's form with d(nu_c)/dt = -S(omega) nu_c. For a small body held in waves what is
left is Morison's inertia force, Froude-Krylov m_f a_f and added mass M_A a_f, and the drag of the orbital velocity.

At the surface the buoyancy of what is dry is taken off, and drag and the forces of accelerating water act in proportion
to what is wet. The inertia of the added mass stays, which is too much for a vehicle afloat.

Reference: Fossen (2021), Handbook of Marine Craft Hydrodynamics and Motion Control, ch. 6 and 8; the pressure-gradient
term Maxey and Riley (1983), eq. 46 (first term).
"""

from dataclasses import replace
from typing import Any

import equinox as eqx
from jaxtyping import Float

from rovtwin.core.arrays.integrate import rk4_step
from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import cross, quaternion_normalise, quaternion_rate, rotation_from_quaternion
from rovtwin.core.numerics import Array, jax, jnp, module_for, traced_once
from rovtwin.core.types import Matrix6, PerThruster, Quaternion, Scalar, ScalarLike, Vector3, Vector6
from rovtwin.vehicle.physics.boundaries import surroundings_wrench
from rovtwin.vehicle.physics.discrepancy import discrepancy_wrench
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import half_steps, inflow_damping, inflow_wrench, static_force

_CHANGING = ("velocity", "rate", "wrench", "place", "gradient", "head", "surface")  # of an Environment, step by step


class State(eqx.Module):
    """State of the plant.

    Attributes:
        position: CO in n [m].
        attitude: Unit quaternion R_nb.
        nu: Velocity over ground, b at CO [m/s, rad/s].
        thrust: Force of each thruster now [N].
    """

    position: Vector3
    attitude: Quaternion
    nu: Vector6
    thrust: PerThruster

    @classmethod
    def at(cls, model: Model, start: Start) -> "State":
        """At a start, thrusters at rest."""
        return cls(start.position, start.attitude, start.velocity, jnp.zeros(model.thrusters.count))


def coriolis_wrench(mass: Matrix6, nu: Vector6) -> Vector6:
    """C(nu) nu of a full inertia matrix: from the momentum, by cross products.

    Does no work: nu . C(nu) nu = 0. Fossen (2021), eq. 3.63 (Kirchhoff's parametrisation).
    """
    momentum = mass @ nu
    linear, angular = momentum[:3], momentum[3:]
    v, omega = nu[:3], nu[3:]
    return jnp.concatenate([cross(omega, linear), cross(v, linear) + cross(omega, angular)])


def damping_wrench(model: Model, nu_r: Vector6) -> Vector6:
    """Hydrodynamic damping D(nu_r) nu_r; it opposes the motion through the water, tau_D = -D(nu_r) nu_r.

    Linear plus quadratic with the sign kept (thesis 2.31 loses it), each with its own coefficients ahead and astern.
    Fossen (2021), sec. 6.4.
    """
    return model.damping @ _powers(nu_r)


def damping_force(model: Model, nu_r: Vector6) -> Vector3:
    """Rows 1 to 3 of the same, the force [N]."""
    return model.damping[:3] @ _powers(nu_r)


def _powers(nu_r: Vector6) -> Float[Array, "24"]:
    """What the columns of `Model.damping` multiply: velocities ahead and astern, and their squares."""
    ahead, astern = jnp.maximum(nu_r, 0.0), jnp.maximum(-nu_r, 0.0)
    return jnp.concatenate([ahead, astern, ahead * ahead, astern * astern])


def speed_of_drag(linear: Any, quadratic: Any, force: Any) -> Any:
    """Speed at which linear v + quadratic v^2 is a force >= 0, any shapes; NaN of no force where no linear drag is.

    In a form that holds without quadratic damping and whose gradient at zero force is finite.
    """
    return 2.0 * force / (linear + module_for(linear, quadratic, force).sqrt(linear**2 + 4.0 * quadratic * force))


def learned_wrench(model: Model, nu_r: Vector6, tau: Vector6, drag: Vector6 | None = None) -> Vector6 | float:
    """What the model was found to lack, b at CO [N, N m]; 0.0, and no work, for a model without.

    Args:
        model: Uses `discrepancy`, and the damping.
        nu_r: Velocity through the water, b at CO [m/s, rad/s].
        tau: Wrench of the thrusters, b at CO.
        drag: D(nu_r) nu_r where it is known already.
    """
    if model.discrepancy is None:
        return 0.0
    return discrepancy_wrench(model.discrepancy, nu_r, tau, damping_wrench(model, nu_r) if drag is None else drag)


def restoring_wrench(model: Model, down_b: Vector3) -> Vector6:
    """g(eta) from the direction of gravity seen in b. Fossen (2021), eq. 4.6."""
    weight, buoyancy = model.weight * down_b, model.buoyancy * down_b
    moment = cross(model.center_of_gravity, weight) - cross(model.center_of_buoyancy, buoyancy)
    return -jnp.concatenate([weight - buoyancy, moment])


def restoring_lever(weight: Any, buoyancy: Any, r_g: Any, r_b: Any) -> Any:
    """W r_g - B r_b [N m], shape (3,): at rest it points down, and its z is the stiffness of roll and pitch when level.

    Args:
        weight: W [N].
        buoyancy: B [N].
        r_g: Centre of gravity, b [m], shape (3,).
        r_b: Centre of buoyancy, b [m], shape (3,).
    """
    return weight * r_g - buoyancy * r_b


@traced_once
def acceleration(
    model: Model,
    position: Vector3,
    attitude: Quaternion,
    nu: Vector6,
    tau: Vector6,
    environment: Environment,
    elapsed: ScalarLike = 0.0,
    inflow: PerThruster | None = None,
) -> Vector6:
    """nu_dot: the equations of motion solved for the acceleration.

    Args:
        model: The vehicle.
        position: CO in n [m].
        attitude: Quaternion R_nb.
        nu: Velocity over ground, b at CO.
        tau: Wrench of the thrusters, b at CO.
        environment: Water and external wrench.
        elapsed: Time into the step for which the environment is given [s].
        inflow: Force that each thruster loses for each m/s of inflow [N s/m]; None: none does.
    """
    R_nb = rotation_from_quaternion(attitude)
    R_bn, down_b, omega = R_nb.T, R_nb[2], nu[3:]
    edges, wet = surroundings_wrench(model, position, R_nb, nu, environment)
    force = tau + environment.wrench + edges - restoring_wrench(model, down_b)
    v_c, a_fluid, a_path = (R_bn @ x for x in _water_at(environment, position, R_nb @ nu[:3], elapsed))
    nu_r = jnp.concatenate([nu[:3] - v_c, omega])
    pressure = model.displaced_mass * jnp.concatenate([a_fluid, cross(model.center_of_buoyancy, a_fluid)])
    carried = model.rigid_body_mass[:, :3] @ a_path
    if environment.surface is not None:
        carried = carried + (1.0 - wet) * (model.added_mass[:, :3] @ a_path)  # the dry part carries no water along
    drag = damping_wrench(model, nu_r)
    water = learned_wrench(model, nu_r, tau, drag) - drag
    if inflow is not None:
        force = force + inflow_wrench(model.thrusters.configuration, inflow, nu_r)
    force = force + wet * pressure - carried - coriolis_wrench(model.inertia, nu_r) + wet * water
    nu_r_dot = model.inertia_inverse @ force
    return nu_r_dot.at[:3].add(a_path - cross(omega, v_c))


def _water_at(
    environment: Environment, position: Vector3, velocity: Vector3, elapsed: ScalarLike
) -> tuple[Vector3, Vector3, Vector3]:
    """The water at CO, in n: velocity v_c, acceleration of its particles, rate of v_c along the path.

    Args:
        environment: The water.
        position: CO in n [m].
        velocity: Of CO over ground, in n [m/s].
        elapsed: Time into the step [s].
    """
    v_c = environment.velocity + elapsed * environment.rate
    if environment.gradient is None:
        return v_c, environment.rate, environment.rate
    G = environment.gradient
    v_c = v_c + G @ (position - environment.place)
    return v_c, environment.rate + G @ v_c, environment.rate + G @ velocity


def inflow_of(model: Model, thrust: PerThruster) -> PerThruster | None:
    """What each thruster loses for each m/s of inflow [N s/m], at forces [N]; None where none does."""
    return None if model.thrusters.inflow_loss is None else inflow_damping(model.thrusters, thrust)


def plant_step(model: Model, state: State, command: Command, environment: Environment, dt: float) -> State:
    """The plant `dt` seconds later: exact thruster lag, RK4 for the rigid body.

    Args:
        model: The vehicle.
        state: Where it is.
        command: Thruster commands, held over the step.
        environment: Water and external wrench over the step.
        dt: Step [s].
    """
    before, halfway, after = half_steps(model.thrusters, state.thrust, static_force(model.thrusters, command.u), dt)
    T = model.thrusters.configuration
    # RK4 asks for the wrench at three instants only; they are known exactly.
    forces = {0.0: before, 0.5 * dt: halfway, dt: after}
    wrenches = {elapsed: T @ force for elapsed, force in forces.items()}
    inflows = {elapsed: inflow_of(model, force) for elapsed, force in forces.items()}

    def derivative(elapsed: float, x: tuple[Vector3, Quaternion, Vector6]) -> tuple[Vector3, Quaternion, Vector6]:
        p, q, nu = x
        nu_dot = acceleration(model, p, q, nu, wrenches[elapsed], environment, elapsed, inflows[elapsed])
        return rotation_from_quaternion(q) @ nu[:3], quaternion_rate(q, nu[3:]), nu_dot

    position, q, nu = rk4_step(derivative, (state.position, state.attitude, state.nu), dt)
    return State(position, quaternion_normalise(q), nu, after)


def rollout(model: Model, state: State, commands: Command, environment: Environment, dt: float) -> State:
    """States after each step, leading axis n_steps.

    Args:
        model: The vehicle.
        state: Start.
        commands: Of all steps, along a leading axis.
        environment: Each field for all steps, or with a leading axis n_steps; walls stay where they are.
        dt: Step [s].
    """
    steps = commands.u.shape[0]
    one_step = Environment.calm(gradient=jnp.zeros((3, 3)), head=jnp.zeros(()), surface=jnp.zeros(()))
    changes = {}
    for name in _CHANGING:
        given, one = getattr(environment, name), getattr(one_step, name)
        if given is not None:
            changes[name] = given if given.ndim > one.ndim else jnp.broadcast_to(given, (steps, *given.shape))

    def step(carry: State, inputs: tuple[Command, dict[str, Array]]) -> tuple[State, State]:
        command, now = inputs
        after = plant_step(model, carry, command, replace(environment, **now), dt)
        return after, after

    return jax.lax.scan(jax.checkpoint(step), state, (commands, changes))[1]


def kinetic_energy(model: Model, nu_r: Vector6) -> Scalar:
    """Energy of body and surrounding water, 1/2 nu_r' M nu_r [J]."""
    return 0.5 * nu_r @ model.inertia @ nu_r


def potential_energy(model: Model, position: Vector3, attitude: Quaternion) -> Scalar:
    """Of weight and buoyancy [J], zero with CO at the surface and level CG and CB offsets counted along down."""
    down_b = rotation_from_quaternion(attitude)[2]
    net = model.weight - model.buoyancy
    lever = restoring_lever(model.weight, model.buoyancy, model.center_of_gravity, model.center_of_buoyancy)
    return -net * position[2] - lever @ down_b
