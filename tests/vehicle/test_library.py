"""The vehicles that ship: published numbers as published, estimates that reproduce the tests they come from."""

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from rovtwin.core.block import Start
from rovtwin.core.flow import Command, Environment
from rovtwin.core.frames import euler_from_quaternion, quaternion_from_euler, rotate_to_body
from rovtwin.core.numerics import jax, jnp
from rovtwin.vehicle import list_library, load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.lint import uncontrollable
from rovtwin.vehicle.analysis.stability import (
    LATERAL,
    LONGITUDINAL,
    depth_held,
    growth,
    hang,
    linearised,
    reach,
    stability,
    steady_speed,
)
from rovtwin.vehicle.analysis.summary import sources
from rovtwin.vehicle.description.identified import fingerprint
from rovtwin.vehicle.description.thrust_curve import read_bollard_csv
from rovtwin.vehicle.description.totals.validation import driving_velocity
from rovtwin.vehicle.physics.dynamics import State, plant_step, rollout
from rovtwin.vehicle.physics.thrusters import static_force

DOCS = Path(__file__).parents[2] / "docs" / "vehicles.md"
T200 = Path(__file__).parents[2] / ".." / "shared" / "data" / "t200"

linearised_at = jax.jit(linearised)
force_of = jax.jit(static_force)


@jax.jit
def swing(model, euler):
    """Euler angles after release from rest at an attitude, every 0.02 s for 12 s, shape (600, 3)."""
    start = State.at(model, Start(jnp.zeros(3), quaternion_from_euler(euler), jnp.zeros(6)))
    states = rollout(model, start, Command(jnp.zeros((600, 6))), Environment.calm(), 0.02)
    return jax.vmap(euler_from_quaternion)(states.attitude)


def diagonal(matrix):
    return np.diag(np.asarray(matrix))


@pytest.mark.parametrize("name", list_library())
def test_every_file_is_sound(name):
    found = load_vehicle(name)
    model = found.model()
    assert np.linalg.eigvalsh(np.asarray(model.inertia))[0] > 0
    np.testing.assert_allclose(model.inertia, np.asarray(model.inertia).T, atol=1e-12)
    assert driving_velocity(found.assembly.damping()) is None
    assert all(np.isfinite(leaf).all() or (leaf == np.inf).any() for leaf in jax.tree.leaves(model))


@pytest.mark.parametrize("name", list_library())
def test_every_file_says_where_its_values_come_from(name):
    assert sources(load_vehicle(name))


@pytest.mark.parametrize("name", list_library())
def test_every_vehicle_floats_upright_moves_and_is_in_the_docs(name):
    found = load_vehicle(name)
    model = found.model()
    rest = hang(model)
    assert abs(float(rest.net_buoyancy)) < 0.05 * float(model.weight)
    assert min(rest.stiffness) > 0 and np.abs(rest.trim).max() < np.radians(2)
    top = steady_speed(model, 0, float(reach(model)[0, 1]))
    assert 0.2 < top < 3.0
    library = DOCS.read_text(encoding="utf-8").partition("\n## The library\n")[2].partition("\n## ")[0]
    rows = [line for line in library.splitlines() if line.startswith(f"| `{name}` |")]
    assert len(rows) == 2, "docs/vehicles.md: a row in the library's table and one in that of what each can do"
    # The speed printed there is the model's: `python -m docs.scripts.fleet`.
    assert rows[1].split("|")[5].strip() == f"{top:.2f}"


@pytest.mark.parametrize("name", list_library())
def test_every_thruster_and_total_has_a_source_or_is_called_an_estimate(name):
    file = load_vehicle(name).file

    def result_of(body, key):
        return bool(body.source or key in body.sources or any(key in word for word in body.sources))

    def walk(body, inherited=False):
        known = inherited or bool(body.source) or bool(body.sources)
        if body.mass is not None or body.shape is not None:
            assert known, f"{name}: mass or shape without a source"
        for thruster in body.thrusters:
            assert thruster.source or result_of(body, "thrusters"), f"{name}: {thruster.name}"
        for part in body.parts:
            walk(part, known)

    walk(file)


def test_the_library_differs_in_kind():
    """Masses over nearly three decades; vehicles without sway, without pitch, with all six directions; a mesh."""
    fleet = [load_vehicle(name) for name in list_library()]
    masses = [vehicle.assembly.solid.mass for vehicle in fleet]
    missing = [set(uncontrollable(np.asarray(vehicle.model().thrusters.configuration))) for vehicle in fleet]
    assert len(fleet) >= 13 and min(masses) < 5 and max(masses) > 1000
    assert {"sway (Y)"} in missing and {"pitch (M)"} in missing and {"roll (K)"} in missing and set() in missing
    assert any(vehicle.file.shape is not None and vehicle.file.shape.mesh for vehicle in fleet)


def test_the_thesis_vehicle_is_as_printed():
    model = load_vehicle("double_blueye_thesis").model()
    np.testing.assert_allclose(diagonal(model.rigid_body_mass), [30, 30, 30, 2.69, 3.88, 2.99])  # (3.2)
    np.testing.assert_allclose(diagonal(model.added_mass), [21.2, 8.95, 291.8, 2.16, 0.54, 0.855])  # (3.3), table 3.7
    np.testing.assert_allclose(
        diagonal(model.linear_damping_ahead), [55.76, 44.8, 20.848, 3.78, 1.35, 0.178]
    )  # table 3.7
    np.testing.assert_allclose(diagonal(model.quadratic_damping_ahead), [23.67, 0, 1197.91, 0, 0, 8.5])  # table 3.7
    assert float(model.weight) == float(model.buoyancy) == pytest.approx(294.3)
    np.testing.assert_allclose(hang(model).stiffness, 5.1, rtol=1e-6)  # behind (3.15) and (3.19)
    np.testing.assert_allclose(model.thrusters.time_constant, 0.2)  # (5.1)
    np.testing.assert_allclose(model.thrusters.force_ahead, [10, 5, 11, 10, 5, 11])  # table 5.3
    np.testing.assert_allclose(model.thrusters.exponent, 1.0)  # (3.6)
    d = 0.28
    T = [[1, 0, 0, 1, 0, 0], [0, 1, 0, 0, 1, 0], [0, 0, 1, 0, 0, 1], [0, 0, -d, 0, 0, d], [0] * 6, [d, 0, 0, -d, 0, 0]]
    np.testing.assert_allclose(model.thrusters.configuration, T, atol=1e-15)  # (5.2)


def test_the_thesis_vehicle_decays_as_its_formulas_say():
    """(2.28): omega^2 + (b/2)^2 = k / I_total and b = D / I_total, with the printed stiffness and inertias."""
    model = load_vehicle("double_blueye_thesis").model()
    k, I, D = 5.1, 2.69 + 2.16, 3.78
    assert 2 * np.pi / hang(model).periods[0] == pytest.approx(np.sqrt(k / I), rel=1e-3)
    assert D / I / 2 == pytest.approx(0.39, rel=2e-3)
    assert np.sqrt(k / I - (D / I / 2) ** 2) == pytest.approx(0.95, rel=5e-3)


def test_the_double_blueye_adds_up():
    found = load_vehicle("double_blueye")
    solid = found.assembly.solid
    assert solid.mass == pytest.approx(30.0)
    np.testing.assert_allclose(solid.center_of_gravity, 0.0, atol=1e-12)
    # I_x and I_z of the thesis's CAD (3.2), I_y as errata 16 corrects it.
    np.testing.assert_allclose(np.diag(solid.inertia), [2.69, 0.85, 2.99], atol=2e-3)
    model = found.model()
    assert float(model.buoyancy - model.weight) == pytest.approx(0.0, abs=1e-9)
    assert found.thruster_names[:3] == ["port.surge", "port.sway", "port.heave"]
    assert float(model.thrusters.configuration[5, 0]) == pytest.approx(0.28)  # port ahead turns the nose to starboard


def test_the_double_blueye_is_dragged_as_towed():
    """Thesis (4.3), (4.4): both signs of surge, and sway."""
    model = load_vehicle("double_blueye").model()
    for axis, force, expected in [
        (0, 6.48 * 0.3 + 158.86 * 0.09, 0.3),
        (0, -(0.07 * 0.3 + 189.75 * 0.09), 0.3),
        (1, 3.12 * 0.2 + 146.38 * 0.04, 0.2),
    ]:
        assert steady_speed(model, axis, force) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("axis", "angle", "half_b", "omega"), [(0, 33.42, 0.39, 0.95), (1, 39.95, 0.50, 1.87)])
def test_the_double_blueye_decays_as_measured(axis, angle, half_b, omega):
    """Released from rest, fitted as the thesis did with phi0 exp(-b t / 2) cos(omega t): (3.13) and (3.17)."""
    euler = np.zeros(3)
    euler[axis] = np.radians(angle)
    seen = np.asarray(swing(load_vehicle("double_blueye").model(), euler))[:, axis]
    t = 0.02 * np.arange(1, len(seen) + 1)
    fit = least_squares(lambda p: np.radians(angle) * np.exp(-p[0] * t) * np.cos(p[1] * t) - seen, [0.4, 1.3]).x
    np.testing.assert_allclose(fit, [half_b, omega], rtol=0.01)


def test_bluerov2_is_wu_2018():
    model = load_vehicle("bluerov2").model()
    assert (float(model.weight), float(model.buoyancy)) == pytest.approx((112.8, 114.8), abs=0.05)
    np.testing.assert_allclose(diagonal(model.added_mass), [5.5, 12.7, 14.57, 0.12, 0.12, 0.12])
    np.testing.assert_allclose(diagonal(model.linear_damping_ahead), [4.03, 6.22, 5.18, 0.07, 0.07, 0.07])
    np.testing.assert_allclose(diagonal(model.quadratic_damping_ahead), [18.18, 21.66, 36.99, 1.55, 1.55, 1.55])
    np.testing.assert_allclose(model.center_of_gravity, [0, 0, 0.02])
    # ArduSub's frame "vectored": signs of forward, lateral, throttle (down is positive output), yaw and roll.
    T = np.sign(np.round(np.asarray(model.thrusters.configuration), 9))
    np.testing.assert_array_equal(T[0], [-1, -1, 1, 1, 0, 0])
    np.testing.assert_array_equal(T[1], [1, -1, 1, -1, 0, 0])
    np.testing.assert_array_equal(T[2], [0, 0, 0, 0, 1, 1])
    np.testing.assert_array_equal(T[3, 4:], [1, -1])
    np.testing.assert_array_equal(T[5], [1, -1, -1, 1, 0, 0])


def test_bluerov2_heavy_is_von_benzon_2022():
    model = load_vehicle("bluerov2_heavy").model()
    np.testing.assert_allclose(diagonal(model.rigid_body_mass), [13.5, 13.5, 13.5, 0.26, 0.23, 0.37])
    np.testing.assert_allclose(diagonal(model.added_mass), [6.36, 7.12, 18.68, 0.189, 0.135, 0.222])
    np.testing.assert_allclose(diagonal(model.linear_damping_ahead), [13.7, 0, 33, 0, 0.8, 0.07])  # yaw: Wu (2018)
    np.testing.assert_allclose(diagonal(model.quadratic_damping_ahead), [141, 217, 190, 1.19, 0.47, 1.5])
    assert float(model.buoyancy) == pytest.approx(1000 * 9.81 * 0.0134)
    s, yaw = np.sqrt(0.5), 0.1888
    T = np.zeros((6, 8))
    T[:2, :4] = [[s, s, -s, -s], [-s, s, -s, s]]
    T[2, 4:] = -1
    T[3, 4:] = [0.218, 0.218, -0.218, -0.218]
    T[4, 4:] = [0.12, -0.12, 0.12, -0.12]
    T[5, :4] = [-yaw, yaw, yaw, -yaw]
    np.testing.assert_allclose(model.thrusters.configuration, T, atol=5e-5)
    assert np.linalg.matrix_rank(T) == 6
    u = np.array([-1, -0.7, -0.2, 0, 0.1, 0.5, 0.9, 1.0])
    polynomial = -140.3 * u**9 + 389.9 * u**7 - 404.1 * u**5 + 176.0 * u**3 + 8.9 * u
    np.testing.assert_allclose(force_of(model.thrusters, u), polynomial, atol=1e-3)


# --- thrust tables as Blue Robotics publishes them


@pytest.fixture(scope="module")
def t200():
    if not T200.is_dir():
        pytest.skip("no shared/data/t200 beside the repository: Blue Robotics' tables are not shipped")
    return T200.resolve()


def with_tables(folder, **keys):
    thruster = {"name": "t", "direction": [1, 0, 0], "curve": {"table": [str(p) for p in sorted(folder.glob("*.csv"))]}}
    return vehicle_from_dict(
        {"name": "v", "description": "d", "mass": 1.0, "shape": {"sphere": 0.1}, "thrusters": [thruster], **keys}
    )


def test_bollard_tables_are_read_and_interpolated_over_voltage(t200):
    found = with_tables(t200, supply_voltage=16)
    voltage, points = read_bollard_csv(t200 / "16V.csv")
    assert voltage == 16
    u = np.array([-1.0, -0.5, 0.0, 0.05, 0.5, 1.0])
    expected = np.interp(u, *points.T)
    thrusters = found.model().thrusters
    seen = [float(force_of(thrusters, np.array([x]))[0]) for x in u]
    # Smoothing to a rising curve moves a point by no more than the noise of the test.
    np.testing.assert_allclose(seen, expected, atol=0.3)
    forces = [float(force_of(found.model(supply_voltage=v).thrusters, np.ones(1))[0]) for v in (14, 15, 16)]
    assert forces[1] == pytest.approx(0.5 * (forces[0] + forces[2]), rel=2e-3)  # but for the smoothing
    assert forces[0] < forces[2]


def test_the_power_law_of_the_library_fits_the_bollard_test(t200):
    """Exponent 1.33, dead band 0.07: 1.1 % rms of the largest force at 16 V, 4 % at worst."""
    _, points = read_bollard_csv(t200 / "16V.csv")
    command, force = points.T
    curve = load_vehicle("blueye_pioneer").model().thrusters
    shape = [float(force_of(curve, np.full(3, u))[0]) / 10.0 for u in command[::4]]
    error = np.array(shape) - (force / np.where(command > 0, force[-1], -force[0]))[::4]
    assert np.sqrt(np.mean(error**2)) < 0.0125
    assert np.abs(error).max() < 0.045


# --- the Munk moment


@pytest.fixture(scope="module")
def thesis():
    return load_vehicle("double_blueye_thesis").model()


def test_munk_speed_of_the_thesis_vehicle_is_the_static_formula(thesis):
    """sqrt(5.1 / (291.8 - 21.2)) = 0.137 m/s, and the eigenvalues change sign there when depth is held."""
    found = stability(thesis)
    assert found.munk_pitch == pytest.approx(291.8 - 21.2)
    assert found.pitch_static == pytest.approx(0.1373, abs=1e-4)
    assert found.pitch_depth_held == pytest.approx(found.pitch_static, rel=1e-4)
    for speed, grows in ((0.13, False), (0.145, True)):
        A = np.asarray(linearised_at(thesis, speed))
        assert (growth(depth_held(thesis, A, speed), LONGITUDINAL) > 1e-4) is grows


def test_left_free_the_thesis_vehicle_is_stable_until_its_top_speed(thesis):
    """Routh-Hurwitz of (I s^2 + d_q s + k)(m_w s + d_w) - (m_w - m_u) m_u u^2 s, by hand."""
    I, d_q, k = 3.88 + 0.54, 1.35, 5.1
    m_u, m_w, d_w = 30 + 21.2, 30 + 291.8, 20.848
    a3, a2, a0 = I * m_w, I * d_w + d_q * m_w, k * d_w
    critical = np.sqrt((d_q * d_w + k * m_w - a3 * a0 / a2) / ((m_w - m_u) * m_u))
    assert stability(thesis).pitch_free == pytest.approx(critical, rel=1e-3)
    assert critical == pytest.approx(0.316, abs=1e-3)
    assert steady_speed(thesis, 0, 20.0) == pytest.approx(0.3162, abs=1e-4)


def test_pitch_of_the_thesis_vehicle_diverges_in_the_plant(thesis):
    """The same in the nonlinear plant: a heave force that holds the depth, surge thrust for the speed, pitch 1 deg."""

    def step(state, thrust):
        down = rotate_to_body(state.attitude, jnp.array([0.0, 0.0, 1.0]))
        # A stiff spring and damper on depth, through CO: no moment of its own.
        hold = -4000.0 * (state.position[2] + down @ state.nu[:3]) * down
        wrench = jnp.concatenate([hold, jnp.zeros(3)]).at[0].add(thrust)
        water = Environment.calm(wrench=wrench)
        after = plant_step(thesis, state, Command(jnp.zeros(6)), water, 0.04)
        return after, euler_from_quaternion(after.attitude)[1]

    @jax.jit
    def pitch(speed):
        tilted = quaternion_from_euler(jnp.array([0.0, np.radians(1.0), 0.0]))
        start = State(jnp.zeros(3), tilted, jnp.zeros(6).at[0].set(speed), jnp.zeros(6))
        thrust = (55.76 + 23.67 * speed) * speed
        return jax.lax.scan(lambda state, _: step(state, thrust), start, None, length=2000)[1]

    slow, fast = (np.abs(np.degrees(np.asarray(pitch(speed)))) for speed in (0.11, 0.20))
    assert slow[-1] < 0.2
    assert fast[-1] > 10


def test_the_best_estimate_is_stable_in_pitch_at_all_its_speeds():
    model = load_vehicle("double_blueye").model()
    top = steady_speed(model, 0, reach(model)[0, 1])
    found = stability(model)
    assert min(found.pitch_depth_held, found.pitch_free) > 1.5 * top
    # Heading is another matter: a wide bluff body turns away from its course, as ROVs do.
    assert found.yaw_free < top


def test_eigenvalues_are_those_of_the_nonlinear_equations():
    """`linearised` is straight in u, which `stability` relies on."""
    model = load_vehicle("double_blueye").model()
    A = [np.asarray(linearised_at(model, u)) for u in (0.2, 0.6, 1.0)]
    np.testing.assert_allclose(A[1], 0.5 * (A[0] + A[2]), atol=1e-12)
    assert growth(A[0], LONGITUDINAL) < 0 < growth(A[0], LATERAL)


def test_natural_periods():
    """A pendulum by hand, with coupling: M_A couples roll and sway in neither vehicle here."""
    model = load_vehicle("double_blueye").model()
    M, k = np.asarray(model.inertia), 294.3 * 0.025
    np.testing.assert_allclose(hang(model).periods, 2 * np.pi * np.sqrt([M[3, 3] / k, M[4, 4] / k]), rtol=1e-6)


# As they were before parts had power, mesh shapes and sensor figures: what was identified then still holds.
MADE_WITH = {
    "bluerov2": "60781fa6c52e83f9",
    "blueye_pioneer": "d22547e9b62b463c",
    "double_blueye": "4fbfe472b2aab434",
    "double_blueye_thesis": "9a242fe4d2e20e2c",
}


@pytest.mark.parametrize("name", MADE_WITH)
def test_what_was_identified_before_still_fits_its_parts(name):
    assert fingerprint(load_vehicle(name).file) == MADE_WITH[name]
