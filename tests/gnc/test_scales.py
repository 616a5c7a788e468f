"""Sizes of a vehicle, and that whatever an autopilot has by default grows with them as Froude says."""

import dataclasses

import equinox as eqx
import jax.tree_util as tree
import numpy as np
import pytest
from tests.gnc.flying import aft, thirty_kg

from rovtwin.core.numerics import as_array, jnp
from rovtwin.gnc.allocation.prioritised import PriorityAllocation
from rovtwin.gnc.control.tracking import PathReference, Tracking
from rovtwin.gnc.guidance.course_keeping import CourseKeeping
from rovtwin.gnc.guidance.crab_heading import Bow
from rovtwin.gnc.guidance.path_following import PathGuidance
from rovtwin.gnc.guidance.speed_limit import FREE
from rovtwin.gnc.navigation.state import ACCELEROMETER_BIAS, ATTITUDE, DRAG, GYRO_BIAS, POSITION, WAVE_PLACE
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.gnc.safety.contingency import Contingency
from rovtwin.gnc.safety.off_course import SETTLES, limits_of
from rovtwin.gnc.safety.thruster_diagnosis import ThrusterHealth
from rovtwin.gnc.scales import ANY, VehicleScales
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.physics.model import Model

S = 2.0  # ratio of lengths
LENGTH, TIME, MASS = S, np.sqrt(S), S**3
SPEED, RATE, ACCELERATION, FORCE, MOMENT = LENGTH / TIME, 1 / TIME, 1.0, MASS, MASS * LENGTH
NUMBER = 1.0


def froude(model: Model) -> Model:
    """The same vehicle with lengths S, masses S^3 and times sqrt(S) times as large, in the same water and gravity."""
    arm = np.repeat([1.0, LENGTH], 3)  # of a velocity or force along each axis, lengths in it
    motion = np.repeat([SPEED, RATE], 3)
    inertia = MASS * np.outer(arm, arm)
    wrench = np.repeat([FORCE, MOMENT], 3)
    t = model.thrusters
    thrusters = dataclasses.replace(
        t,
        configuration=as_array(np.asarray(t.configuration) * arm[:, None]),
        force_ahead=as_array(FORCE * np.asarray(t.force_ahead)),
        force_astern=as_array(FORCE * np.asarray(t.force_astern)),
        time_constant=as_array(TIME * np.asarray(t.time_constant)),
        rate_limit=as_array(FORCE / TIME * np.asarray(t.rate_limit)),
    )
    linear, quadratic = wrench[:, None] / motion, wrench[:, None] / motion**2
    return model.replace(
        rigid_body_mass=np.asarray(model.rigid_body_mass) * inertia,
        added_mass=np.asarray(model.added_mass) * inertia,
        linear_damping_ahead=np.asarray(model.linear_damping_ahead) * linear,
        linear_damping_astern=np.asarray(model.linear_damping_astern) * linear,
        quadratic_damping_ahead=np.asarray(model.quadratic_damping_ahead) * quadratic,
        quadratic_damping_astern=np.asarray(model.quadratic_damping_astern) * quadratic,
        weight=FORCE * np.asarray(model.weight),
        buoyancy=FORCE * np.asarray(model.buoyancy),
        displaced_mass=MASS * np.asarray(model.displaced_mass),
        center_of_gravity=LENGTH * np.asarray(model.center_of_gravity),
        center_of_buoyancy=LENGTH * np.asarray(model.center_of_buoyancy),
        thrusters=thrusters,
        hull=None,
    )


SIX_ANGLES = np.repeat([SPEED, RATE], 3)
WRENCH = np.repeat([FORCE, MOMENT], 3)
# How each default grows. What stays the same needs a reason why no vehicle's size is in it.
GROWS = {
    "guidance.acceleration": ACCELERATION,
    "guidance.sideways": ACCELERATION,
    "guidance.turn_rate": RATE,
    "guidance.lag": TIME,
    "guidance.onset": TIME,
    "guidance.patience": LENGTH,
    "guidance.depth_tolerance": LENGTH,
    "guidance.rest": SPEED,
    "guidance.depth_step": LENGTH,
    "guidance.tightest": LENGTH,
    "contingency.speed": SPEED,
    "contingency.acceleration": ACCELERATION,
    "contingency.settling": TIME,
    "contingency.surface": LENGTH,
    "contingency.near": LENGTH,
    "contingency.afloat": LENGTH,
    "contingency.fastest": np.array([SPEED, SPEED, SPEED, RATE]),
    "contingency.leash": LENGTH,
    "bow.lag": TIME,
    "bow.patience": TIME,
    "bow.strongest": SPEED,
    "course.gain": RATE,
    "course.cruise": SPEED,
    "course.acceleration": ACCELERATION,
    "course.lag": TIME,
    "course.slack": LENGTH,
    "course.aside": SPEED,
    "reference.model.frequency": RATE,
    "reference.model.speed_limit": SIX_ANGLES,
    "control.K_p": RATE**2,
    "control.K_d": RATE,
    "control.K_i": MOMENT / TIME,
    "control.reach": LENGTH,
    "control.limits.lower": WRENCH,
    "control.limits.upper": WRENCH,
    "control.allowance.bandwidth": RATE,
    "control.tilting.speeds": SPEED,
    "control.tilting.gains": FORCE * np.array([1 / LENGTH, 1 / SPEED, TIME, TIME, 1.0, 1.0]),
    "control.tilting.lever": LENGTH,
    "control.tilting.stiffness": MOMENT,
    "control.tilting.munk": MASS,
    "allocation.lowest": FORCE,
    "allocation.highest": FORCE,
    "allocation.least_wrench": WRENCH,
    "allocation.greatest_wrench": WRENCH,
    "allocation.weight": 1 / WRENCH,
    "allocation.slew": FORCE / TIME,
    "monitor.bandwidth": RATE,
    "monitor.window": TIME,
    "monitor.memory": TIME,
    "monitor.patience": TIME,
    "monitor.weight": WRENCH**-2.0,
    "monitor.force_std": FORCE,
    "monitor.signed": np.repeat([1.0, LENGTH], 3)[:, None],
    "navigation.acceleration_memory": TIME,
    "sustained.linear": FORCE / SPEED,
    "sustained.quadratic": FORCE / SPEED**2,
    "sustained.most": SPEED,
    "sustained.axes": SPEED,
    "sustained.push": ACCELERATION,
    "sustained.mass": MASS,
}
# Entries of the filter's error state that the size says, and those that sensors and the sea do.
SAME = {
    "guidance.heading_tolerance": "an angle",
    "contingency.lead": "an angle",
    "reference.model.damping_ratio": "a ratio",
    "control.limits.shared": "which axes",
    "control.allowance.trim": "an angle",
    "allocation.start": "a share of the force",
    "allocation.stop": "a share of the force",
    "allocation.preferred": "a share of the force",
    "monitor.lost": "which thrusters",
    "monitor.distinguishable": "which thrusters",
    "monitor.least": "squared signal over noise",
    "monitor.share": "a share of the force",
    "monitor.certainty": "a share of what is seen",
    "navigation.acceleration_noise": "vibration that the accelerometer hears, not the vehicle's size",
    "navigation.acceleration_share": "a share",
    "navigation.turn_noise": "stands for a gyro that is silent",
    "navigation.wave_damping": "the sea's",
    "navigation.wave_slip": "a share",
    "navigation.gate": "chi-square",
    "navigation.mounts": "the sensors'",
    "navigation.max_age": "the link's",
}
WHOLE = ("model", "thrusters")  # the vehicle itself, which is what was scaled


def blocks(model):
    return {
        "guidance": PathGuidance.of(model, steered=True),
        "contingency": Contingency.of(model),
        "bow": Bow.of(model),
        "course": CourseKeeping.of(model),
        "reference": PathReference.of(model),
        "control": Tracking.of(model),
        "allocation": PriorityAllocation.of(model),
        "monitor": ThrusterHealth.of(model),
        "navigation": Tuning.of(model),
    }


def leaves(model, changed=lambda blocks: blocks):
    """All numbers of the blocks by their path, without the vehicle itself; `changed` is done to the blocks first."""
    found = {}
    for path, value in tree.tree_flatten_with_path(changed(blocks(model)))[0]:
        parts = [getattr(p, "name", getattr(p, "key", None)) for p in path]
        name = ".".join(str(p) for p in parts)
        if parts[1] in WHOLE:
            continue
        if "sustained" in parts:
            name = "sustained." + str(parts[-1])
        found[name] = np.asarray(value, dtype=float)
    return found


def key_of(name):
    return next((k for k in (name, ".".join(name.split(".")[:2])) if k in GROWS or k in SAME), None)


@pytest.fixture(scope="module", params=["sway", "no sway", "heave aft of CG"])
def pair(request):
    small = thirty_kg()
    if request.param == "no sway":
        small = thirty_kg(T=np.delete(np.asarray(small.thrusters.configuration), [1, 4], axis=1))
    elif request.param == "heave aft of CG":
        small = aft()
    return leaves(small), leaves(froude(small))


def test_every_default_is_declared(pair):
    """A new constant has to be the vehicle's, or to say why not."""
    own = {"navigation.initial_std", "navigation.walk"}
    assert [name for name in pair[0] if key_of(name) is None and name not in own] == []


def require_growth(small, large):
    """The walk: AssertionError, with its name, where a default does not grow as declared."""
    for name, value in small.items():
        key = key_of(name)
        if key is None:
            continue
        grows = np.broadcast_to(np.asarray(GROWS.get(key, NUMBER)), value.shape)
        finite = np.isfinite(value) & (np.abs(value) < FREE)  # FREE stands for no limit
        np.testing.assert_allclose(large[name][finite], (value * grows)[finite], rtol=1e-3, atol=1e-12, err_msg=name)


def test_every_default_grows_with_the_vehicle(pair):
    require_growth(*pair)


def test_what_the_filter_assumes_of_forces_and_currents_grows_with_the_vehicle(pair):
    """Sensors, attitude and waves are not the vehicle's; forces and speeds through the water are."""
    small, large = pair
    same = np.zeros(31, dtype=bool)
    for part in (POSITION, ATTITUDE, WAVE_PLACE, GYRO_BIAS, ACCELEROMETER_BIAS, DRAG):
        same[part] = True
    same[12:15] = True  # waves' velocity
    for name, force, speed in (
        ("navigation.initial_std", FORCE, SPEED),
        ("navigation.walk", FORCE / np.sqrt(TIME), SPEED / np.sqrt(TIME)),
    ):
        ratio = np.where(small[name] > 0.0, large[name] / np.where(small[name] > 0.0, small[name], 1.0), 1.0)
        grows = np.where(same, 1.0, speed)
        grows[21:26] = force
        # A random walk of nothing stays nothing.
        np.testing.assert_allclose(ratio, np.where(small[name] > 0.0, grows, 1.0), rtol=1e-6, err_msg=name)


@pytest.mark.system
@pytest.mark.parametrize("name", ["guidance.patience", "contingency.leash", "control.reach"])
def test_a_constant_that_does_not_scale_is_found(name):
    """One leaf of a block is the same number for every vehicle, the small one's own: the walk raises, and names it."""
    block, leaf = name.split(".")
    small = thirty_kg()
    constant = getattr(blocks(small)[block], leaf)

    def with_constant(found):
        return found | {block: eqx.tree_at(lambda b: getattr(b, leaf), found[block], constant)}

    with pytest.raises(AssertionError, match=name):
        require_growth(leaves(small, with_constant), leaves(froude(small), with_constant))
    require_growth(leaves(small, with_constant), leaves(froude(small)))  # nothing else is at fault


def test_the_double_blueye_has_what_it_was_tuned_with():
    scales = VehicleScales.of(load_vehicle("double_blueye").model())
    np.testing.assert_allclose(scales.bandwidth[[0, 1, 2, 3, 5]], [0.5, 0.5, 0.8, 1.0, 1.0])
    assert scales.length == pytest.approx(0.31, abs=0.01) and scales.crabs
    assert scales.force_walk == pytest.approx(0.03, rel=0.01)
    assert scales.dive_speed == pytest.approx(0.2, rel=0.05)
    assert np.degrees(scales.turn_rate) == pytest.approx(33, abs=1)


def test_thrusters_lag_bounds_the_bandwidth():
    slow, quick = (VehicleScales.of(thirty_kg(lag=lag)).bandwidth for lag in (2.0, 0.01))
    axes = [0, 1, 2, 3, 5]  # no thruster acts in pitch
    np.testing.assert_allclose(slow[axes], np.array([0.1, 0.1, 0.16, 0.2, 0.2]) / 2.0)
    assert np.all(quick >= slow) and np.all(quick < 2.0), "without lag the thrust is what bounds it"


def test_a_vehicle_that_cannot_turn_or_has_no_drag_gets_finite_numbers():
    single = thirty_kg(T=np.eye(6)[:, [0, 2]])
    free = thirty_kg().replace(quadratic_damping_ahead=np.zeros((6, 6)), linear_damping_ahead=np.zeros((6, 6)))
    for model in (single, free, thirty_kg(T=np.zeros((6, 0)))):
        scales = VehicleScales.of(model)
        for value in dataclasses.astuple(scales):
            assert np.all(np.isfinite(value))
        assert np.all(scales.bandwidth > 0.0)
    assert VehicleScales.of(single).turn_rate == 0.0 and not VehicleScales.of(single).crabs


def test_an_own_bandwidth_is_kept():
    model = thirty_kg()
    given = Tracking.of(model, bandwidth=(0.3, 0.3, 0.6, 2.0, 2.0, 2.0))
    assert eqx.tree_equal(given.K_p[:3], jnp.array([0.09, 0.09, 0.36]))


def test_munks_moment_turns_a_body_across_its_larger_added_mass():
    flat = load_vehicle("bluerov2").model()  # heave has the most added mass: it is stable when it dives, not ahead
    upright = VehicleScales.of(flat).upright
    assert upright[0] < 0.5 and upright[2] == ANY
    tall = flat.replace(added_mass=as_array(np.diag([14.57, 12.7, 5.5, 0.12, 0.12, 0.12])))
    upright = VehicleScales.of(tall).upright
    assert upright[0] == ANY and upright[2] < 1.0


def test_what_nothing_rights_comes_up_all_the_same():
    model = load_vehicle("bluerov2").model()
    tall = model.replace(
        added_mass=as_array(np.diag([14.57, 12.7, 5.5, 0.12, 0.12, 0.12])),
        center_of_buoyancy=model.center_of_gravity,
    )
    scales = VehicleScales.of(tall)
    assert scales.upright[2] < 0.1 * scales.cruise[2], "only the control of roll is left"
    assert scales.dive_speed == pytest.approx(0.1 * scales.cruise[2])
    assert float(Contingency.of(tall).speed) > 0.0


def test_a_pilot_gets_no_more_than_keeps_the_vehicle_level_with_thrust_to_spare():
    for name in ("double_blueye", "bluerov2", "gladius_mini"):
        scales = VehicleScales.of(load_vehicle(name).model())
        fastest = np.asarray(Contingency.of(load_vehicle(name).model()).fastest)[:2]
        assert np.all(fastest <= 0.95 * scales.top[:2] + 1e-12) and fastest[0] <= 1.42 * scales.upright[0]


def test_thrusters_whose_lag_nobody_stated_are_not_taken_to_have_none():
    """A disc of 12 kg with such thrusters was controlled at 2.2 rad/s in sway and 4.9 in yaw, and tipped over."""
    model = load_vehicle("bluerov2_heavy").model()
    quick = eqx.tree_at(lambda m: m.thrusters.time_constant, model, jnp.zeros(model.thrusters.count))
    stated, counted = VehicleScales.of(model), VehicleScales.of(quick)
    assert np.all(counted.bandwidth >= stated.bandwidth), "less than those of a real vehicle"
    assert np.all(counted.bandwidth[3:] <= 0.2 / (0.55 * np.sqrt(counted.length / 9.81)) + 1e-9)


@pytest.mark.parametrize("dropped", [[], [1, 4]], ids=["sway", "no sway"])
def test_how_far_off_course_and_for_how_long_grows_with_the_vehicle(dropped):
    """Twice as far for sqrt(2) times as long; what cannot push sideways may take a turn to come back."""
    whole = np.asarray(thirty_kg().thrusters.configuration)
    model = thirty_kg(T=np.delete(whole, dropped, axis=1))
    small, large = limits_of(model), limits_of(froude(model))
    np.testing.assert_allclose(large.limit, LENGTH * small.limit, rtol=1e-3)
    assert np.all(small.after > SETTLES), "else it is the sea's time"
    np.testing.assert_allclose(large.after, TIME * small.after, rtol=1e-3)
    assert large.step == pytest.approx(LENGTH * small.step, rel=1e-3)
    if dropped:
        crabbing = limits_of(thirty_kg())
        assert small.limit[0] > crabbing.limit[0] and small.after[0] > crabbing.after[0]
    no_heave = limits_of(thirty_kg(T=whole[:, np.abs(whole[2]) < 1e-9]))
    assert no_heave.limit[1] == np.inf and np.isfinite(no_heave.limit[0])
