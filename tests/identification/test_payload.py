"""The predicted change of parts: the documented example, and what must hold for any tree of parts."""

import numpy as np
import pytest
from tests.identification import payloads

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.identify import identify
from rovtwin.identification.joint.result.interaction import added_mass_std
from rovtwin.identification.joint.result.payload import predicted_change
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.constants import FRESH_WATER, GRAVITY

BOX = {"name": "box", "mass": 1.0, "shape": {"box": [0.1, 0.1, 0.1]}, "pose": {"position": [0.1, 0.1, 0.25]}}
SEEDS = range(12)


def nested(library, *parts, **more):
    return vehicle_from_dict({"name": "my", "parts": [{"name": "rov", "part": library}, *parts]} | more, "my.yaml")


def flat(library, *parts):
    data = load_vehicle(library).to_dict()
    return vehicle_from_dict(data | {"parts": [*data.get("parts", []), *parts]}, "flat.yaml")


def same(one, other, rtol=1e-9):
    for a, b in zip(arrays(one), arrays(other), strict=True):
        np.testing.assert_allclose(a, b, rtol=rtol, atol=1e-9)


def arrays(model):
    fields = ("inertia", "added_mass", "damping", "weight", "buoyancy", "center_of_gravity", "center_of_buoyancy")
    return [np.asarray(getattr(model, field)) for field in fields] + [np.asarray(model.thrusters.configuration)]


# --- random trees of parts


def random_part(rng, name, depth=0):
    """A body with a shape, with parts of its own in some, some of which publish totals of themselves."""
    part = payloads.payload(rng, load_vehicle("blueye_pioneer")) | {"name": name}
    part["pose"]["attitude_deg"] = rng.uniform(-30, 30, 3).tolist()
    if depth < 2:
        part["parts"] = [random_part(rng, f"p{i}", depth + 1) for i in range(rng.integers(0, 3))]
    if rng.uniform() < 0.4:
        part["hydrodynamics"] = {"added_mass": rng.uniform(0.1, 5.0, 6).tolist(), "linear_damping": [None] * 5 + [1.0]}
        part["restoring"] = {"buoyancy": "neutral"} if rng.uniform() < 0.5 else {"net_buoyancy": rng.uniform(-2.0, 2.0)}
        part["rigid_body"] = {"mass": rng.uniform(0.5, 5.0)}
    return part


def random_vehicle(seed):
    """Of parts, with thrusters and published totals of the whole; and the generator for what comes next."""
    rng = np.random.default_rng(seed)
    parts = [random_part(rng, f"part{i}") for i in range(rng.integers(1, 4))]
    totals = {"added_mass": [40.0, 60.0, 50.0, 5.0, 5.0, 5.0], "quadratic_damping": [90.0, 120.0, None, 9.0, 9.0, 9.0]}
    data = {
        "name": "v",
        "mass": 12.0,
        "inertia": [0.3, 0.4, 0.4],
        "shape": {"box": [0.5, 0.4, 0.3]},
        "thrusters": [payloads.THRUSTER],
        "hydrodynamics": totals,
        "restoring": {"net_buoyancy": 1.5, "metacentric_height": 0.02},
    }
    return data | {"parts": parts}, rng


def with_parts(data, parts):
    return vehicle_from_dict(data | {"parts": parts}, "v.yaml")


@pytest.mark.parametrize("seed", SEEDS)
def test_a_body_that_is_added_never_lowers_a_diagonal(seed):
    data, rng = random_vehicle(seed)
    old, extra = vehicle_from_dict(data), random_part(rng, "extra")
    change = predicted_change(old, with_parts(data, [*data["parts"], extra]))
    assert all((matrix.diagonal() >= 0).all() for matrix in change.hydrodynamics.values())
    assert (change.hydrodynamics["added_mass"].diagonal() > 0).all() and (change.added_mass_std > 0).all()
    gained = np.asarray(change.model.added_mass) - np.asarray(old.model().added_mass)
    np.testing.assert_allclose(gained, change.hydrodynamics["added_mass"], atol=1e-9)


@pytest.mark.system
@pytest.mark.parametrize("seed", SEEDS)
def test_what_comes_or_goes_is_what_its_file_says(seed):
    """Beside a vehicle that is held as a part the prediction is the sum of the files.

    But for couplings of drag, which a sum of parts is given only as far as they take energy.
    """
    data, rng = random_vehicle(seed)
    parts = [random_part(rng, "extra"), random_part(rng, "other") | {"rigid_body": {"mass": 3.0}}]
    inner = {key: value for key, value in data.items() if key != "name"} | {"name": "rov", "keeps_names": True}
    more, whole = (vehicle_from_dict({"name": "my", "parts": [inner, *parts[:n]]}) for n in (1, 2))
    alone = vehicle_from_dict(data)
    for old, new in ((alone, whole), (whole, more), (more, alone)):
        for a, b in zip(arrays(predicted_change(old, new).model), arrays(new.model()), strict=True):
            own = np.tile(np.eye(6, dtype=bool), 4) if a.shape == (6, 24) else np.full(a.shape, True)
            np.testing.assert_allclose(a[own], b[own], rtol=1e-6, atol=1e-9)


@pytest.mark.system
@pytest.mark.parametrize("seed", SEEDS)
def test_nested_is_flat_at_any_depth(seed):
    data, rng = random_vehicle(seed)
    old, extra = vehicle_from_dict(data), random_part(rng, "extra")
    inner = {key: value for key, value in data.items() if key != "name"} | {"name": "rov", "keeps_names": True}
    once = {"name": "my", "parts": [inner, extra]}
    twice = {"name": "again", "parts": [{"name": "was", "keeps_names": True, "parts": [inner]}, extra]}
    by_flat = predicted_change(old, with_parts(data, [*data["parts"], extra]))
    for spelling in (once, twice):
        change = predicted_change(old, vehicle_from_dict(spelling))
        same(change.model, by_flat.model)
        np.testing.assert_allclose(change.added_mass_std, by_flat.added_mass_std)
        assert (change.displaced, *change.moments) == pytest.approx((by_flat.displaced, *by_flat.moments))
    assert predicted_change(old, vehicle_from_dict({"name": "my", "parts": [inner]})).added_mass_std.max() == 0


@pytest.mark.system
@pytest.mark.parametrize("seed", SEEDS)
def test_there_and_back_nothing_changes(seed):
    """Added and removed, moved there and back, exchanged twice: what was predicted goes under the next."""
    data, rng = random_vehicle(seed)
    extra, other = random_part(rng, "extra"), random_part(rng, "extra")
    inner = {key: value for key, value in data.items() if key != "name"} | {"name": "rov", "keeps_names": True}
    moved = extra | {"pose": {"position": rng.uniform(-0.4, 0.4, 3).tolist()}}
    for here, there in (([], [extra]), ([extra], [moved]), ([extra], [other])):
        old, new = (vehicle_from_dict({"name": "my", "parts": [inner, *parts]}) for parts in (here, there))
        out, back = predicted_change(old, new), predicted_change(new, old)
        for name, matrix in out.hydrodynamics.items():
            np.testing.assert_allclose(matrix, -back.hydrodynamics[name], atol=1e-12)
        np.testing.assert_allclose(out.added_mass_std, back.added_mass_std)
        carried = predicted_change(published(new, out.model), old)
        same(carried.model, old.model(), 1e-6)


def published(vehicle, model):
    """The vehicle with the totals of a model as its own, as if somebody had identified exactly these."""
    data = vehicle.to_dict()
    sides = {key: np.asarray(getattr(model, f"{key}_damping_ahead")).tolist() for key in ("linear", "quadratic")}
    astern = {key: np.asarray(getattr(model, f"{key}_damping_astern")).tolist() for key in ("linear", "quadratic")}
    data["hydrodynamics"] = {
        "added_mass": np.asarray(model.added_mass).tolist(),
        **{f"{key}_damping": rows for key, rows in sides.items()},
        **{f"{key}_damping_astern": rows for key, rows in astern.items()},
    }
    inertia = np.asarray(model.rigid_body_mass)[3:, 3:]
    center, mass = np.asarray(model.center_of_gravity), float(model.weight) / GRAVITY
    about = inertia - mass * (center @ center * np.eye(3) - np.outer(center, center))
    data["rigid_body"] = {"mass": mass, "center_of_gravity": center.tolist(), "inertia": about.tolist()}
    data["restoring"] = {
        "buoyancy": float(model.buoyancy),
        "center_of_buoyancy": np.asarray(model.center_of_buoyancy).tolist(),
    }
    return vehicle_from_dict(data, "published.yaml")


# --- the documented example


@pytest.mark.parametrize("new", [nested("double_blueye", BOX), flat("double_blueye", BOX)], ids=["nested", "flat"])
def test_one_kilogram_on_the_double_blueye(new):
    """It "changed" added mass by -11.2 kg in sway and -1.07 kg m2 in roll where the vehicle was held as a part."""
    old = load_vehicle("double_blueye")
    change = predicted_change(old, new)
    added = change.hydrodynamics["added_mass"].diagonal()
    np.testing.assert_allclose(added[:3], 0.704, atol=0.001)  # a cube: 0.70 of what it displaces
    assert 0.05 < added[3] < 0.06 and 0.01 < added[5] < 0.02
    assert float(change.model.weight) == pytest.approx(31 * GRAVITY)
    net = float(change.model.buoyancy - change.model.weight)
    assert net == pytest.approx(GRAVITY * (FRESH_WATER * 1e-3 - 1.0), abs=1e-9)
    assert (1.96 * change.added_mass_std < 4 * added).all()


def test_a_part_that_goes_leaves_its_share_where_more_would_go_than_was_found():
    """0.07 N s/m was found of linear damping astern; the formula gives the imager alone 0.40."""
    data = load_vehicle("double_blueye").to_dict()
    without = vehicle_from_dict(data | {"parts": [p for p in data["parts"] if p["name"] != "uhi"]})
    change = predicted_change(load_vehicle("double_blueye"), without)
    assert change.hydrodynamics["linear_damping_astern"][0, 0] < -0.3
    assert 0.05 < float(change.model.linear_damping_astern[0, 0]) < 0.07


def test_published_totals_of_a_part_hold_for_it_and_what_is_added_comes_on_top():
    alone, more = load_vehicle("double_blueye").model(), nested("double_blueye", BOX)
    change = predicted_change(load_vehicle("double_blueye"), more)
    same(more.model(), change.model)
    assert float(more.model().added_mass[1, 1]) > float(alone.added_mass[1, 1])


SKID = {"name": "skid", "mass": 5.0, "shape": {"box": [0.5, 0.4, 0.1]}, "pose": {"position": [0.0, 0.0, 0.3]}}


@pytest.mark.system
@pytest.mark.parametrize(
    "message", [{"restoring": {"net_buoyancy": -2.0}}, {"hydrodynamics": {"added_mass": [1, 2, 3, 0.1, 0.1, 0.1]}}, {}]
)
def test_what_a_device_publishes_of_itself_is_predicted(message):
    """Its totals were left out, and it counted by its shape: +147 N of net buoyancy for -2, 98 kg in heave for 48."""
    skid = {key: value for key, value in SKID.items() if key != "mass"} | {"rigid_body": {"mass": 5.0}} | message
    for one in (skid, SKID | message):
        change = predicted_change(load_vehicle("double_blueye"), nested("double_blueye", one))
        same(change.model, nested("double_blueye", one).model())
        flat_too = predicted_change(load_vehicle("double_blueye"), flat("double_blueye", one))
        same(change.model, flat_too.model)
    if "restoring" in message:
        assert float(change.model.buoyancy - change.model.weight) == pytest.approx(-2.0)
    assert float(change.model.weight) == pytest.approx(35 * GRAVITY)


def test_a_device_that_is_measured_again_is_another():
    first, again = (SKID | {"restoring": {"net_buoyancy": net}} for net in (-2.0, -3.0))
    change = predicted_change(nested("double_blueye", first), nested("double_blueye", again))
    assert float(change.model.buoyancy - change.model.weight) == pytest.approx(-3.0)


def test_totals_of_a_body_of_which_something_stays_say_nothing_of_what_comes():
    """A frame that was weighed with its DVL: what is bolted onto it counts, and brings what it says of itself."""
    frame = SKID | {"parts": [BOX], "restoring": {"net_buoyancy": -2.0}, "rigid_body": {"mass": 7.0}}
    lead = BOX | {"name": "lead", "restoring": {"net_buoyancy": -4.0}}
    more = frame | {"parts": [BOX, lead]}
    old = nested("double_blueye", frame)
    change = predicted_change(old, nested("double_blueye", more))
    assert float(change.model.weight - old.model().weight) == pytest.approx(GRAVITY)
    assert float(change.model.buoyancy - change.model.weight) == pytest.approx(-6.0)


def test_a_device_that_publishes_more_than_its_shape_says_is_less_sure():
    old, published = load_vehicle("double_blueye"), {"hydrodynamics": {"added_mass": [30, 30, 60, 3, 3, 3]}}
    plain, more = (predicted_change(old, nested("double_blueye", part)) for part in (SKID, SKID | published))
    assert more.added_mass_std[0] > 2 * plain.added_mass_std[0]
    weighed = {"name": "skid", "rigid_body": {"mass": 5.0}}  # as wide as one with a mass of its own
    wide = predicted_change(old, nested("double_blueye", weighed)).added_mass_std
    np.testing.assert_allclose(
        wide, predicted_change(old, nested("double_blueye", {"name": "skid", "mass": 5.0})).added_mass_std
    )


def test_what_the_new_file_states_of_the_whole_holds():
    trimmed = nested("double_blueye", BOX | {"mass": 2.0}, restoring={"net_buoyancy": 2.0})
    change = predicted_change(load_vehicle("double_blueye"), trimmed)
    assert float(change.model.buoyancy - change.model.weight) == pytest.approx(2.0)
    back = predicted_change(trimmed, load_vehicle("double_blueye"))  # says neutral, of the parts as they were
    assert float(back.model.buoyancy - back.model.weight) == pytest.approx(2.0 + GRAVITY)


def test_water_of_another_density():
    """Held in a file for the sea: the old one floats there, and the box with it."""
    sea = nested("double_blueye", BOX, water_density=1025.0)
    here = nested("double_blueye", BOX).in_water(1025.0).model()
    change = predicted_change(load_vehicle("double_blueye"), sea)
    np.testing.assert_allclose(change.model.added_mass, here.added_mass, atol=1e-9)
    assert float(change.model.buoyancy) == pytest.approx(float(here.buoyancy))


def test_a_part_without_a_shape_makes_the_interval_wide():
    old = load_vehicle("double_blueye")
    bare = {key: value for key, value in BOX.items() if key != "shape"}
    shaped, unknown = (predicted_change(old, nested("double_blueye", part)) for part in (BOX, bare))
    assert unknown.hydrodynamics["added_mass"].max() == 0
    assert (unknown.added_mass_std[:3] > 0.8 * shaped.added_mass_std[:3]).all()


def test_far_from_the_others_only_the_formula_is_in_doubt():
    near, far = ({"position": [0.0, 0.0, z]} for z in (0.25, 50.0))
    std = [
        added_mass_std(load_vehicle("double_blueye").file, nested("double_blueye", BOX | {"pose": pose}).file, 1000.0)
        for pose in (near, far)
    ]
    assert std[0][0] > 0.4 and 0.14 < std[1][0] < 0.2  # 0.2 of 0.70 kg


def test_a_vehicle_that_is_held_elsewhere_has_another_origin():
    moved = {"name": "my", "parts": [{"name": "rov", "part": "double_blueye", "pose": {"position": [0.1, 0, 0]}}, BOX]}
    with pytest.raises(IdentificationError, match=r"my.yaml: part 'rov' holds the vehicle, found its pose \[0.1, 0"):
        predicted_change(load_vehicle("double_blueye"), vehicle_from_dict(moved, "my.yaml"))


def test_couplings_that_a_published_diagonal_never_had_cannot_make_added_mass_negative():
    far = BOX | {"name": "far", "shape": {"box": [0.3, 0.3, 0.3]}, "pose": {"position": [0.0, 0.0, 1.5]}}
    data = {"name": "v", "mass": 5.0, "shape": {"sphere": 0.2}, "inertia": [1, 1, 1], "thrusters": [payloads.THRUSTER]}
    old = vehicle_from_dict(data | {"parts": [far], "hydrodynamics": {"added_mass": [40, 40, 40, 45, 45, 1]}})
    change = predicted_change(old, vehicle_from_dict(data))
    assert np.linalg.eigvalsh(np.asarray(change.model.added_mass))[0] > -1e-9


def test_more_cannot_go_than_there_is():
    data = {"name": "v", "thrusters": [payloads.THRUSTER], "parts": [BOX, BOX | {"name": "second"}]}
    data |= {"restoring": {"buoyancy": 1.0}}
    with pytest.raises(IdentificationError, match="has no mass"):
        predicted_change(vehicle_from_dict(data), vehicle_from_dict(data | {"parts": [BOX]}))


# --- against the panel method


@pytest.mark.system
def test_a_thruster_is_not_known_to_be_tomorrow_what_it_is_today():
    """A fit that tells two forces to 1e-5 took their next difference for the scale of all forces, 8 widths off."""
    vehicle = load_vehicle("double_blueye")
    sure = identify(vehicle, []).file()
    sure["identified"]["estimate"]["covariance"] = (
        1e-10 * np.array(sure["identified"]["estimate"]["covariance"])
    ).tolist()
    old = vehicle_from_dict(sure, "identified.yaml")
    found = identify(nested("double_blueye", BOX), [], old=old)
    at = [i for i, name in enumerate(found.parameters.names) if ".force_" in name]
    np.testing.assert_allclose(found.covariance[np.ix_(at, at)] / 0.01**2, np.eye(len(at)), atol=1e-3)
    unchanged = identify(vehicle, [], old=old)
    assert unchanged.std[list(unchanged.parameters.names).index("thrusters.surge.force_ahead")] < 1e-4


@pytest.mark.slow
def test_intervals_hold_the_panel_method():
    """Eight payloads on the smallest vehicle; `python -m tests.identification.payloads` runs hundreds on five."""
    pytest.importorskip("capytaine", reason="needs the extra 'panel'")
    found = payloads.campaign(payloads.vehicles()["nosway"], range(30_000, 30_008))
    assert found["held"].mean() > 0.9
    assert np.median(found["half"][:, :3] / found["own"][:, :3]) < 2.5  # no wider than what it does
