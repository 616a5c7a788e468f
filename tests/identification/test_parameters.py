"""Names, transforms and the way from theta to a Model."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import jax
from rovtwin.identification.identify import default_free
from rovtwin.identification.joint.model.catalogue import catalogue, choose
from rovtwin.identification.joint.model.couplings import COUPLINGS, bound_of, place_of, shares
from rovtwin.identification.joint.model.groups import thruster_groups
from rovtwin.identification.joint.model.parameters import DELAYS, MOUNTING
from rovtwin.identification.joint.model.prior import default_prior
from rovtwin.identification.joint.solver.anchors import static_evidence
from rovtwin.identification.joint.solver.options import Options
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.totals.drag import Damping
from rovtwin.vehicle.description.totals.validation import driving_velocity
from rovtwin.vehicle.physics.dynamics import damping_wrench
from rovtwin.vehicle.physics.thrusters import static_force


@pytest.fixture(scope="module")
def vehicle():
    return load_vehicle("double_blueye")


@pytest.fixture(scope="module")
def everything(vehicle):
    return catalogue(vehicle)


@pytest.fixture(scope="module")
def alike(everything):
    """Without damping astern of its own."""
    return choose(everything, [name for name in everything.names if "damping_astern" not in name])


@pytest.fixture(scope="module")
def model_at(everything):
    return jax.jit(lambda theta: everything.model_at(theta)[0])


def test_groups_follow_names_and_directions(vehicle):
    assert thruster_groups(vehicle) == {"surge": (0, 3), "sway": (1, 4), "heave": (2, 5)}
    assert list(thruster_groups(load_vehicle("bluerov2_heavy"))) == ["horizontal", "vertical"]


def test_zero_theta_is_the_vehicle_itself(vehicle, everything, model_at):
    model, same = vehicle.model(), model_at(np.zeros(len(everything)))
    for name in ("inertia", "damping", "center_of_buoyancy", "buoyancy"):
        np.testing.assert_allclose(getattr(same, name), getattr(model, name), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(same.thrusters.force_ahead, model.thrusters.force_ahead)


def test_every_parameter_moves_the_model_and_only_it(everything, model_at):
    base = np.zeros(len(everything))
    leaves = [np.asarray(x, float) for x in jax.tree.leaves(model_at(base))]
    for i, p in enumerate(everything.free):
        if p.name in ("tether.drag", "commands.delay", *MOUNTING, *DELAYS):
            continue  # of the test, not of the vehicle
        moved = base.copy()
        moved[i] = 0.1
        changed = [np.asarray(x, float) for x in jax.tree.leaves(model_at(moved))]
        assert any(not np.array_equal(a, b) for a, b in zip(leaves, changed, strict=True)), p.name


@given(seed=st.integers(0, 10_000))
def test_any_theta_gives_inertia_that_resists_and_damping_that_takes_energy(everything, model_at, seed):
    theta = np.random.default_rng(seed).normal(scale=0.8, size=len(everything))
    model = model_at(theta)
    assert np.linalg.eigvalsh(np.asarray(model.added_mass)).min() > -1e-9
    assert driving_velocity(damping_of(model), samples=200) is None


def damping_of(model):
    parts = ("linear_damping_ahead", "linear_damping_astern", "quadratic_damping_ahead", "quadratic_damping_astern")
    return Damping(*(np.asarray(getattr(model, name)) for name in parts))


def test_values_and_thetas_are_each_others_inverse(everything):
    theta = np.linspace(-0.4, 0.4, len(everything))
    values = dict(zip(everything.names, everything.values(theta), strict=True))
    np.testing.assert_allclose(everything.thetas(values), theta, atol=1e-12)


def test_tables_scale_ahead_and_astern_apart():
    heavy = catalogue(load_vehicle("bluerov2_heavy"))
    chosen = choose(heavy, ["thrusters.horizontal.force_ahead"])
    before, after = heavy.model.thrusters, chosen.model_at(np.array([np.log(1.1)]))[0].thrusters
    table, scaled = np.asarray(before.table_force)[0], np.asarray(after.table_force)[0]
    np.testing.assert_allclose(scaled[table > 0], 1.1 * table[table > 0])
    np.testing.assert_allclose(scaled[table < 0], table[table < 0])
    np.testing.assert_allclose(after.table_force[4:], before.table_force[4:])


@pytest.mark.parametrize(
    ("patterns", "message"),
    [(["added_mas.surge"], "Did you mean 'added_mass.surge'"), (["thrusters.main.*"], "is no parameter")],
)
def test_a_pattern_that_fits_nothing_is_named(everything, patterns, message):
    with pytest.raises(IdentificationError, match=message):
        choose(everything, patterns)


@pytest.mark.parametrize(
    ("prior", "message"),
    [
        ({"added_mass.serge": {"factor": 2}}, "fits no free parameter"),
        ({"added_mass.surge": 3}, "expected {factor: 2}"),
        ({"added_mass.surge": {"factor": 0.5}}, "expected more than 1"),
        ({"added_mass.surge": {"sd": -1}}, "expected more than 0"),
        ({"added_mass.surge": {"sd": "big"}}, "expected a number"),
        ({"added_mass.surge": {"value": -4.0}}, "expected more than 0"),
    ],
)
def test_a_prior_that_makes_no_sense_is_named(vehicle, everything, prior, message):
    with pytest.raises(IdentificationError, match=message):
        default_prior(everything, vehicle, prior)


def test_a_stated_prior_has_its_width_and_no_common_cause(vehicle, everything):
    prior = default_prior(everything, vehicle, {"thrusters.surge.force_ahead": {"value": 12.0, "sd": 0.6}})
    i = everything.names.index("thrusters.surge.force_ahead")
    assert prior.mean[i] == pytest.approx(np.log(1.2))
    assert prior.covariance[i, i] == pytest.approx(0.05**2)
    assert np.count_nonzero(prior.covariance[i]) == 1
    assert np.linalg.eigvalsh(prior.covariance).min() > 0


def test_a_bollard_pull_counts_every_thruster_that_helps(everything):
    static = static_evidence(everything, [{"bollard": {"direction": "surge", "force": 20.0, "sd": 0.4}}])
    np.testing.assert_allclose(np.asarray(static(np.zeros(len(everything)))), [0.0], atol=1e-9)
    wrong = static_evidence(everything, [{"bollard": {"direction": "surge", "force": 20.4, "sd": 0.4}}])
    np.testing.assert_allclose(np.asarray(wrong(np.zeros(len(everything)))), [-1.0], atol=1e-9)


def test_a_towing_table_is_the_damping_force(everything):
    table = {
        "direction": "surge",
        "speed": [0.2, -0.2],
        "force": [6.48 * 0.2 + 158.86 * 0.04, -(0.07 * 0.2 + 189.75 * 0.04)],
    }
    static = static_evidence(everything, [{"towing": table | {"sd": 0.1}}])
    np.testing.assert_allclose(np.asarray(static(np.zeros(len(everything)))), [0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize(
    ("anchor", "message"),
    [
        ({}, "expected one of bollard, towing"),
        ({"bollard": {"direction": "pitch", "force": 1.0, "sd": 0.1}}, "no thruster pushes in pitch"),
        ({"bollard": {"direction": "surge", "force": 1.0, "sd": 0.0}}, "sd"),
        ({"bollard": {"direction": "surge", "force": 1.0, "sd": 0.1, "command": 20}}, "expected -1 to 1"),
        ({"towing": {"direction": "surge", "speed": [0.1], "force": [], "sd": 0.1}}, "1 speeds and 0 forces"),
        ({"bolard": {}}, "no such key"),
    ],
)
def test_an_anchor_that_makes_no_sense_is_named(everything, anchor, message):
    with pytest.raises(Exception, match=message):
        static_evidence(everything, [anchor])


def test_options_name_their_mistakes(vehicle):
    with pytest.raises(Exception, match="no such key. Did you mean 'segment'"):
        Options.read({"segmnet": 2})
    with pytest.raises(IdentificationError, match="every thruster is in one group"):
        Options.read({"groups": {"a": ["port.surge"]}}).groups_of(vehicle)
    with pytest.raises(IdentificationError, match="no thruster 'port.surg'"):
        Options.read({"groups": {"a": ["port.surg"]}}).groups_of(vehicle)


def test_all_forces_scaled_is_the_same_motion():
    """Thrust, inertia of body and water, damping and net buoyancy, all times 1.3, the centre of gravity off CO."""
    data = load_vehicle("double_blueye").to_dict()
    part = {"name": "camera", "mass": 2.5, "shape": {"box": [0.2, 0.12, 0.1]}}
    data["parts"].append(part | {"pose": {"position": [0.1, 0.1, 0.26]}})
    parameters = catalogue(vehicle_from_dict(data, "camera"))
    rng = np.random.default_rng(0)
    theta = 0.2 * rng.standard_normal(len(parameters))
    theta[[i for i, p in enumerate(parameters.free) if p.name.startswith("restoring.center")]] = 0.0
    one = parameters.model_at(theta)[0]
    other = parameters.model_at(np.asarray(parameters.scaled(theta, np.log(1.3))))[0]
    np.testing.assert_allclose(np.diag(other.inertia), 1.3 * np.diag(one.inertia), rtol=1e-12)
    np.testing.assert_allclose(other.inertia, 1.3 * one.inertia, atol=1e-3)
    for field in ("linear_damping_ahead", "quadratic_damping_astern"):
        np.testing.assert_allclose(np.diag(getattr(other, field)), 1.3 * np.diag(getattr(one, field)), rtol=1e-12)
    np.testing.assert_allclose(other.thrusters.force_ahead, 1.3 * one.thrusters.force_ahead)
    np.testing.assert_allclose(other.buoyancy - other.weight, 1.3 * (one.buoyancy - one.weight), rtol=1e-9)
    u = rng.uniform(-1, 1, one.thrusters.count)
    forces = [np.asarray(m.thrusters.configuration @ static_force(m.thrusters, u)) for m in (one, other)]
    np.testing.assert_allclose(forces[1], 1.3 * forces[0])


def test_a_scale_below_the_body_s_own_inertia_leaves_some_water():
    parameters = catalogue(load_vehicle("bluerov2"))
    theta = np.asarray(parameters.scaled(np.zeros(len(parameters)), -0.7))  # 17 kg in surge, of which 11.5 are the body
    assert np.all(np.isfinite(theta))
    assert 0 < parameters.model_at(theta)[0].added_mass[0, 0] < 0.01


def test_what_rotation_does_to_a_force_is_an_element_of_its_own(alike):
    before = alike.model
    after = alike.model_at(alike.thetas({"quadratic_damping.pitch_surge": 0.1}))[0]
    more = np.asarray(after.damping) - np.asarray(before.damping)
    assert set(zip(*np.nonzero(np.abs(more) > 1e-9), strict=True)) == {(0, 16), (0, 22)}  # quadratic, ahead and astern
    d_surge, d_pitch = 158.86, 0.534
    assert more[0, 16] == pytest.approx(0.1 * d_surge ** (1 / 3) * d_pitch ** (2 / 3), rel=1e-3)


@pytest.mark.parametrize("name", COUPLINGS)
def test_a_coupling_of_drag_is_a_lever(alike, name):
    """Quadratic drag that acts 2 cm off CO turns the vehicle as much as its force times 2 cm, ahead and astern."""
    i, j = COUPLINGS[name]
    lever = 0.02
    before = alike.model
    sides = np.asarray(before.quadratic_damping_ahead), np.asarray(before.quadratic_damping_astern)
    share = lever * (sides[0][i, i] / np.minimum(*sides)[j, j]) ** (1 / 3)
    after = alike.model_at(alike.thetas({f"quadratic_damping.{name}": share}))[0]
    nu = np.zeros(6)
    for nu[i], side in ((0.5, sides[0]), (-0.5, sides[1])):
        more = np.asarray(damping_wrench(after, nu) - damping_wrench(before, nu))
        assert more[j] == pytest.approx(lever * side[i, i] * abs(nu[i]) * nu[i])
        assert np.count_nonzero(np.abs(more) > 1e-9) == 1


@pytest.mark.system
def test_damping_takes_energy_whatever_its_couplings(everything, alike):
    """With shares up to their bounds, either sign, and motion in any direction."""
    rng = np.random.default_rng(0)
    for parameters, count in ((alike, 36), (everything, 72)):
        names = [p.name for p in parameters.free if "damping" in p.name and place_of(p.name)]
        assert len(names) == count
        for _ in range(5):
            expected = {n: 0.99 * bound_of(n) * sign for n, sign in zip(names, rng.choice([-1, 1], count), strict=True)}
            model = parameters.model_at(parameters.thetas(expected))[0]
            if parameters is everything:
                found = shares(model)
                assert {n: found[n] for n in names} == pytest.approx(expected)
            assert np.all(coupling_powers(model) > 0)


def coupling_powers(model):
    """Power taken in many directions of motion, each direction's own drag of the same size."""
    rng = np.random.default_rng(1)
    nu = rng.standard_normal((500, 6)) / np.diag(model.quadratic_damping_ahead) ** (1 / 3)
    small = 1e-3 * rng.standard_normal((500, 6)) / np.diag(model.linear_damping_ahead) ** (1 / 2)
    return np.array([float(v @ damping_wrench(model, v)) for v in np.concatenate([nu, small])])


def test_a_dead_band_stays_below_full_command(everything):
    dead = next(p for p in everything.free if p.name == "thrusters.surge.dead_band")
    assert dead.value(0.0) == pytest.approx(dead.base) and 0.99 < dead.value(8.0) < 1.0
    h = 1e-6
    assert (dead.value(h) - dead.value(-h)) / (2 * h) == pytest.approx(dead.slope(dead.base), rel=1e-6)
    with pytest.raises(IdentificationError, match="found 1.2, expected between 0 and 1"):
        dead.theta(1.2)


def test_a_coupling_beyond_its_bound_is_named(everything):
    coupling = next(p for p in everything.free if p.name == "added_mass.surge_pitch")
    with pytest.raises(IdentificationError, match="added_mass.surge_pitch: found 0.6, expected between -0.37 and 0.37"):
        coupling.theta(0.6)
    assert -0.37 < coupling.value(-4.0) < coupling.value(4.0) < 0.37


def test_astern_couplings_move_the_astern_side_alone(everything, alike):
    """And the couplings ahead move both, as far as astern has none of its own."""
    expected = {"quadratic_damping.surge_pitch": 0.1, "quadratic_damping_astern.surge_pitch": -0.05}
    expected |= {"linear_damping.surge_pitch": 0.02, "linear_damping_astern.surge_pitch": -0.03}
    both = everything.model_at(everything.thetas(expected))[0]
    found = shares(both)
    assert {n: found[n] for n in expected} == pytest.approx(expected)
    ahead = alike.model_at(alike.thetas(expected))[0]
    np.testing.assert_allclose(ahead.quadratic_damping_ahead, both.quadratic_damping_ahead)
    np.testing.assert_allclose(ahead.linear_damping_ahead, both.linear_damping_ahead)
    levers = [
        np.asarray(D)[4, 0] / np.asarray(D)[0, 0]
        for D in (ahead.quadratic_damping_ahead, ahead.quadratic_damping_astern)
    ]
    assert levers[0] == pytest.approx(levers[1]) and levers[0] > 0.01


def test_damping_astern_is_free_where_it_differs():
    """With what that motion does to others."""
    data = load_vehicle("bluerov2").to_dict()
    everything = catalogue(vehicle_from_dict(data, "like"))
    assert not [name for name in default_free(everything, []) if "_damping_astern" in name]
    model = everything.model
    astern = model.linear_damping_astern.at[5, 5].add(0.2), model.quadratic_damping_astern.at[0, 0].add(5.0)
    unlike = model.replace(linear_damping_astern=astern[0], quadratic_damping_astern=astern[1])
    free = [n for n in default_free(catalogue(vehicle_from_dict(data, "unlike"), model=unlike), []) if "_astern." in n]
    both = ("linear_damping_astern.yaw", "quadratic_damping_astern.surge")
    expected = {n for n in catalogue(vehicle_from_dict(data, "all")).names if n.startswith(both)}
    assert set(free) == expected and {"linear_damping_astern.yaw", "quadratic_damping_astern.surge_pitch"} < expected


@pytest.mark.system
def test_a_file_whose_couplings_leave_no_room_keeps_them_and_stays_a_vehicle(vehicle):
    """0.6 of what its diagonals allow, in added mass and, one way only, in drag: shares that nobody estimates."""
    model = vehicle.model()
    M, Q = np.array(model.added_mass), np.array(model.quadratic_damping_ahead)
    M[0, 4] = M[4, 0] = 0.6 * np.sqrt(M[0, 0] * M[4, 4])
    Q[4, 0] = 0.6 * np.cbrt(Q[0, 0] ** 2 * Q[4, 4])
    data = vehicle.to_dict()
    data["hydrodynamics"] = data["hydrodynamics"] | {"added_mass": M.tolist(), "quadratic_damping": Q.tolist()}
    skewed = vehicle_from_dict(data, "skewed.yaml")
    everything = catalogue(skewed)
    parameters = choose(everything, default_free(everything, []))
    assert not {"added_mass.surge_pitch", "quadratic_damping.surge_pitch"} & set(parameters.names)
    L = np.linalg.cholesky(default_prior(parameters, skewed).covariance)
    for seed in range(12):
        drawn = parameters.model_at(L @ np.random.default_rng(seed).standard_normal(len(parameters)))[0]
        M = np.asarray(drawn.added_mass)
        assert M[4, 0] == pytest.approx(0.6 * np.sqrt(M[0, 0] * M[4, 4]))
        assert np.linalg.eigvalsh(M)[0] > 0
        assert driving_velocity(damping_of(drawn), samples=1000) is None
