import equinox as eqx
import numpy as np
import pytest
from tests.gnc.flying import DT, estimate_of, thirty_kg, truth_of

from rovtwin.core.block import Start
from rovtwin.core.flow import Environment, Reference
from rovtwin.core.frames import euler_rate_matrix, quaternion_from_euler, rotation_from_euler
from rovtwin.core.numerics import jax, jnp
from rovtwin.gnc.interfaces import ControlInput
from rovtwin.gnc.thesis.allocation import Allocation
from rovtwin.gnc.thesis.pid import Pid, body_error, linearised_damping
from rovtwin.vehicle.physics.dynamics import State, acceleration, plant_step
from rovtwin.vehicle.physics.linearisation import restoring_stiffness

KEY = jax.random.key(0)
START = Start.at()
AXES = np.array([0, 1, 2, 3, 5])  # those that six thrusters of two bodies control


def reference_of(eta, eta_dot=np.zeros(6)):
    return Reference.from_euler(jnp.asarray(eta, dtype=float), jnp.asarray(eta_dot, dtype=float), jnp.zeros(6))


def given(estimate, reference, shortfall=np.zeros(6)):
    return ControlInput(estimate, reference, jnp.asarray(shortfall, dtype=float))


def hold(pid, model, target, n, force=(0, 0, 0, 0, 0, 0), reported=1.0):
    """Truth after each of n ticks under a PID with perfect feedback and a constant force, b (6,).

    `reported` scales the shortfall that the controller hears of: 0 keeps the allocation's limits from it.
    """
    return np.asarray(
        _hold(pid, model, Allocation.of(model), target, n, jnp.asarray(force, dtype=float), jnp.asarray(reported))
    )


@eqx.filter_jit
def _hold(pid, model, allocate, target, n, force, reported):
    environment = eqx.tree_at(lambda e: e.wrench, Environment.calm(), force)

    def tick(carry, _):
        memory, state, shortfall = carry
        truth = truth_of(state)
        memory, wrench = pid.step(
            memory, ControlInput(estimate_of(truth[:6], truth[6:]), target, reported * shortfall), DT
        )
        command, allocated = allocate(wrench.tau)
        return (memory, plant_step(model, state, command, environment, DT), wrench.tau - allocated), truth

    begin = pid.init(KEY, START), State.at(model, START), jnp.zeros(6)
    return jax.lax.scan(tick, begin, None, length=n)[1]


# The error


def test_error_is_seen_from_the_body():
    east = estimate_of([1, 1, 0, 0, 0, np.pi / 2])
    e, _ = body_error(east, reference_of([3, 1, 0.5, 0, 0, np.pi / 2]))  # 2 m north of a vehicle that looks east
    np.testing.assert_allclose(e, [0, -2, 0.5, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("expected", "now", "error"), [(179, -179, -2), (-179, 179, 2), (170, -20, -170), (10, -10, 20)]
)
def test_heading_error_is_the_short_way_round(expected, now, error):
    def heading(degrees):
        return np.array([0, 0, 0, 0, 0, np.radians(degrees)])

    inputs = given(estimate_of(heading(now)), reference_of(heading(expected)))
    e, _ = body_error(inputs.estimate, inputs.reference)
    assert np.degrees(e[5]) == pytest.approx(error)
    pid = Pid.table_7_1(thirty_kg())
    assert np.sign(pid.step(pid.init(KEY, START), inputs, DT)[1].tau[5]) == np.sign(error)


def test_error_rate_is_the_velocity_that_is_missing():
    euler = jnp.array([0.3, -0.4, 2.0])
    nu = np.array([0.3, -0.1, 0.2, 0.05, -0.02, 0.1])
    R = np.asarray(jax.jit(lambda e: jnp.linalg.inv(euler_rate_matrix(e)))(euler))
    estimate = estimate_of(np.append(np.zeros(3), euler), nu)
    eta_dot = np.concatenate(
        [np.asarray(rotation_from_euler(euler)) @ nu[:3], np.asarray(euler_rate_matrix(euler)) @ nu[3:]]
    )
    _, e_dot = body_error(estimate, reference_of(np.append(np.zeros(3), euler), eta_dot))
    np.testing.assert_allclose(e_dot, 0.0, atol=1e-12)
    e, _ = body_error(estimate, reference_of(np.append(np.zeros(3), np.asarray(euler) + [0.01, 0.02, -0.03])))
    np.testing.assert_allclose(e[3:], R @ [0.01, 0.02, -0.03], atol=1e-12)


# Gains


def closed_loop_matrix(pid, model):
    """Of [position, euler, nu, integral], about rest: d/dt by automatic differentiation of the true equations."""

    def rate(x):
        eta, nu, integral = x[:6], x[6:12], x[12:]
        e, e_dot = body_error(estimate_of(eta, nu), reference_of(np.zeros(6)))
        tau = pid.K_p * e + integral + pid.K_d * e_dot
        nu_dot = acceleration(model, eta[:3], quaternion_from_euler(eta[3:]), nu, tau, Environment.calm())
        return jnp.concatenate([nu, nu_dot, pid.K_i * e])

    return np.asarray(jax.jacfwd(rate)(jnp.zeros(18)))


def block(A, axes):
    """Rows and columns of some axes."""
    keep = np.concatenate([axes, axes + 6, axes + 12])
    return A[np.ix_(keep, keep)]


def at_co(**changes):
    """Gravity at CO would leave roll unstable; a buoyant centre above it keeps M diagonal and the restoring moment."""
    return thirty_kg(
        rigid_body_mass=np.diag([30.0, 30, 30, 2.83, 0.9, 3.11]),
        center_of_gravity=[0, 0, 0],
        center_of_buoyancy=[0, 0, -0.03],
        **changes,
    )


@pytest.mark.system
@pytest.mark.parametrize("zeta", [0.8, 1.0])
def test_pole_placement_places_the_poles(zeta):
    w = np.array([0.7, 0.8, 0.6, 2.5, 1.0, 0.9])  # fast enough that no gain is cut off at zero
    model = at_co()
    pid = Pid.pole_placement(model, w, zeta)
    A = closed_loop_matrix(pid, model)
    for axis in AXES:
        got = np.sort_complex(np.linalg.eigvals(block(A, np.array([axis]))))
        expected = np.sort_complex(np.roots([1, 2 * zeta * w[axis], w[axis] ** 2, 0.1 * w[axis] ** 3]))
        np.testing.assert_allclose(got, expected, atol=1e-6)
    without = eqx.tree_at(lambda p: p.K_i, pid, jnp.zeros(6))
    got = np.linalg.eigvals(closed_loop_matrix(without, model)[:12, :12])
    for axis in AXES:  # the complex pair -zeta w +- w sqrt(zeta^2 - 1) is among the eigenvalues of the whole
        pole = -zeta * w[axis] + w[axis] * np.sqrt(complex(zeta**2 - 1))
        assert np.min(np.abs(got - pole)) < 1e-6 ** (0.5 if zeta == 1 else 1)


@pytest.mark.system
def test_coupled_vehicle_is_stable_with_default_gains():
    model = thirty_kg()
    A = closed_loop_matrix(Pid.pole_placement(model), model)
    keep = np.delete(np.arange(18), 16)  # pitch has no integral
    assert np.linalg.eigvals(A[np.ix_(keep, keep)]).real.max() < -0.01


def test_pole_placement_leaves_out_what_thrusters_cannot_do_and_never_pushes_the_wrong_way():
    pid = Pid.pole_placement(thirty_kg(), 0.2)
    assert pid.K_p[4] == pid.K_i[4] == pid.K_d[4] == 0
    assert pid.K_p[3] == 0  # the restoring moment alone is stiffer than asked for
    assert all(np.all(np.asarray(gain) >= 0) for gain in (pid.K_p, pid.K_i, pid.K_d))


def test_slopes_of_damping_and_restoring_are_those_of_the_model():
    model = thirty_kg()

    @jax.jit
    def wrench(euler, nu):
        nu_dot = acceleration(model, jnp.zeros(3), quaternion_from_euler(euler), nu, jnp.zeros(6), Environment.calm())
        return model.inertia @ nu_dot

    level, h, axes = jnp.zeros(3), 1e-6, np.eye(6)
    for axis in range(6):
        drag = (wrench(level, (0.2 + h) * axes[axis]) - wrench(level, (0.2 - h) * axes[axis]))[axis] / (2 * h)
        assert linearised_damping(model, 0.2)[axis] == pytest.approx(float(-drag), rel=1e-6)
    for axis in (3, 4):
        tilt = h * axes[axis, 3:]
        stiffness = -(wrench(tilt, jnp.zeros(6)) - wrench(-tilt, jnp.zeros(6)))[axis] / (2 * h)
        assert restoring_stiffness(model)[axis] == pytest.approx(float(stiffness), rel=1e-6)


def test_tables_are_as_printed():
    for_guidance, free_running = Pid.table_7_1(thirty_kg()), Pid.table_3_2()
    np.testing.assert_array_equal(for_guidance.K_p[AXES], [1.5, 1.0, 1.0, 3.0, 0.6])
    np.testing.assert_array_equal(for_guidance.K_i[AXES], [0, 0, 0, 2.0, 0])
    np.testing.assert_array_equal(for_guidance.K_d[AXES], [1.0, 1.0, 1.0, 0.0, 1.0])
    np.testing.assert_array_equal(free_running.upper, [0, 0, 22, 0, 0, 5.5])
    _, wrench = free_running.step(
        free_running.init(KEY, START), given(estimate_of(np.zeros(6)), reference_of([5, 5, 5, 1, 1, -3.0])), 0.05
    )
    np.testing.assert_allclose(wrench.tau, [0, 0, 22.0, 0, 0, -(1.2 + 0.1 * 0.05) * 3.0], atol=1e-12)
    np.testing.assert_array_equal(wrench.saturated, [False, False, True, False, False, False])


# Behaviour on the plant


@pytest.fixture(scope="module")
def model():
    return thirty_kg()


def test_step_of_every_controlled_axis(model):
    target = reference_of([0.1, -0.1, 0.1, 0.0, 0.0, 0.2])
    path = hold(Pid.pole_placement(model), model, target, 3000)
    np.testing.assert_allclose(path[-1, [0, 1, 2, 5]], [0.1, -0.1, 0.1, 0.2], atol=2e-3)
    over = np.max(path[:, [0, 1, 2, 5]] / [0.1, -0.1, 0.1, 0.2], axis=0)
    assert np.all(over < 1.25)  # what the integral adds to critical damping


def test_table_7_1_leaves_the_error_of_a_constant_force():
    """No K_i in surge, sway, heave: 2 N of buoyancy are 2 m of depth (1 N/m); roll has K_i and comes back."""
    model = thirty_kg(linear_damping_ahead=np.diag([6.5, 5.0, 10.0, 3.78, 1.0, 0.2]))  # roll as the thesis has it
    force = (0.3, 0.2, -2.0, 0.3, 0, 0.06)
    path = hold(Pid.table_7_1(model), model, reference_of(np.zeros(6)), 20000, force)
    off = np.array([0.3 / 1.5, 0.2 / 1.0, -2.0 / 1.0])  # in b, which the yaw moment has turned
    np.testing.assert_allclose(path[-1, 5], 0.06 / 0.6, rtol=0.01)
    np.testing.assert_allclose(path[-1, :3], rotation_from_euler(path[-1, 3:6]) @ off, rtol=0.01)
    assert abs(path[-1, 3]) < 1e-3 < 0.01 < np.abs(path[:, 3]).max()


def test_integral_takes_the_error_of_a_constant_force_away(model):
    force = (1.0, 1.0, -2.0, 0.3, 0, 0.2)
    path = hold(Pid.pole_placement(model), model, reference_of(np.zeros(6)), 6000, force)
    assert np.abs(path[:, 2]).max() > 0.04
    np.testing.assert_allclose(path[-1, [0, 1, 2, 3, 5]], 0.0, atol=2e-3)


@pytest.mark.parametrize("limited_by", ["its own limit", "the allocation"])
def test_no_windup(model, limited_by):
    """8 m of surge, most of it at full thrust. The integral is to grow as little as it does in a step without limits
    (a fifth of a 2 m step), and not through the whole way, which throws the vehicle metres past.
    """
    pid = Pid.pole_placement(model)
    wide = eqx.tree_at(lambda p: (p.lower, p.upper), pid, (jnp.full(6, -1e6), jnp.full(6, 1e6)))
    target = reference_of([8.0, 0, 0, 0, 0, 0])
    path = hold(pid if limited_by == "its own limit" else wide, model, target, 6000)
    assert path[:, 0].max() < 8.0 + 0.7
    assert path[-1, 0] == pytest.approx(8.0, abs=0.05)

    unaware = hold(wide, model, target, 6000, reported=0.0)
    assert unaware[:, 0].max() > 8.0 + 2.0


def test_integral_comes_back_from_a_limit_at_once(model):
    pid = Pid.pole_placement(model)
    full = jnp.full(6, 3.0)
    pushed, _ = pid.step(full, given(estimate_of(np.zeros(6)), reference_of([50.0, 0, 0, 0, 0, 0])), DT)
    assert pushed[0] == 3.0  # at its limit it grows no further ...
    back, _ = pid.step(
        full, given(estimate_of(np.zeros(6)), reference_of([-0.1, 0, 0, 0, 0, 0]), [5.0, 0, 0, 0, 0, 0]), DT
    )
    assert back[0] < 3.0  # ... but shrinks, even while short of thrust
    short, _ = pid.step(
        full, given(estimate_of(np.zeros(6)), reference_of([0.1, 0.1, 0, 0, 0, 0]), [5.0, 0, 0, 0, 0, 0]), DT
    )
    assert short[0] == 3.0 and short[1] > 3.0
