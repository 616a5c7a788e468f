"""Ballast: what is written floats as requested, with the least mass; what cannot be is said with what can."""

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.analysis.extent import bounding_box
from rovtwin.vehicle.analysis.stability import hang
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.outfitting.ballast import LEAD, BallastTarget, Stock, pieces_for, places_around
from rovtwin.vehicle.outfitting.ballasted import Materials, ballast

GRAVITY = 9.81

BOX = {
    "name": "hull",
    "mass": 10.2,
    "center_of_gravity": [0.012, -0.004, 0.01],
    "volume": 0.01,
    "center_of_buoyancy": [0.0, 0.0, -0.01],
    "shape": {"box": [0.5, 0.3, 0.3]},
}


def written(folder: Path, **keys) -> Path:
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump({"name": "mine", "parts": [BOX], **keys}))
    return path


def require(path: Path, density: float | None, net=None, level=False, bg=None) -> None:
    """The file, loaded again, is as requested: to 1e-6 N and 1e-6 m."""
    rest = hang(load_vehicle(path).model(water_density=density))
    if net is not None:
        assert rest.net_buoyancy == pytest.approx(net, abs=1e-6)
    if level:
        np.testing.assert_allclose(rest.trim, 0.0, atol=1e-6)
    if bg is not None:
        assert rest.metacentric_height == pytest.approx(bg, abs=1e-6)


def around(vehicle: Vehicle) -> np.ndarray:
    box = bounding_box(vehicle.file)
    assert box is not None
    return places_around(*box)


# Vehicles whose totals the parts give, and such that override them at several levels.
OVERRIDES = [
    {},
    {"water_density": 1025},
    {"restoring": {"buoyancy": "neutral", "metacentric_height": 0.015}},
    {"restoring": {"net_buoyancy": -4.0, "center_of_buoyancy": [0.01, 0.002, -0.03]}, "water_density": 1010},
    {"rigid_body": {"mass": 11.0, "center_of_gravity": [0.0, 0.01, 0.03]}},
]


@pytest.mark.parametrize("keys", OVERRIDES, ids=str)
@pytest.mark.parametrize("density", [None, 1000.0, 1025.0])
def test_what_is_written_floats_as_requested(keys, density, tmp_path):
    path, out = written(tmp_path, **keys), tmp_path / "out.yaml"
    found = ballast(path, BallastTarget(2.0, True, 0.02), water_density=density, out=out)
    assert 1 <= len(found["pieces"]) <= 4
    require(out, density, 2.0, True, 0.02)
    require(out, None, 2.0, True, 0.02)  # the file is written for that water
    assert found["after"]["net_buoyancy_N"] == pytest.approx(2.0, abs=1e-6)
    was = hang(load_vehicle(path).model(water_density=density))
    assert found["before"]["net_buoyancy_N"] == pytest.approx(was.net_buoyancy, abs=1e-9)
    assert found["before"]["metacentric_height_m"] == pytest.approx(was.metacentric_height, abs=1e-12)


@pytest.mark.parametrize("name", ["double_blueye", "blueye_pioneer", "uhi"])
def test_vehicles_of_the_library(name, tmp_path):
    out = tmp_path / "out.yaml"
    ballast(name, BallastTarget(1.5, True, 0.022), water_density=1025.0, out=out)
    require(out, None, 1.5, True, 0.022)
    assert f"part: {name}" in out.read_text()


def test_without_shapes_places_are_around_the_thrusters_or_named(tmp_path):
    out = tmp_path / "around.yaml"
    ballast("bluerov2", BallastTarget(1.0, True), out=out)
    require(out, None, 1.0, True, None)
    (tmp_path / "bare.yaml").write_text("{name: bare, mass: 1, volume: 0.001, inertia: [1, 1, 1]}")
    with pytest.raises(ConfigError, match="neither a part with a shape nor a thruster.*--at"):
        ballast(str(tmp_path / "bare.yaml"), BallastTarget(1.0))
    out = tmp_path / "out.yaml"
    places = [(x, y, z) for x in (-0.2, 0.2) for y in (-0.15, 0.15) for z in (-0.1, 0.1)]
    ballast("bluerov2", BallastTarget(1.0, True, 0.03), Materials(places=places), out=out)
    require(out, None, 1.0, True, 0.03)


@pytest.mark.parametrize("seed", range(40))
def test_no_other_pieces_weigh_less(seed):
    """Against every set of four candidates, each solved as four equations; the oracle of the linear programme."""
    rng = np.random.default_rng(seed)
    hull = BOX | {
        "mass": 10.0 + rng.uniform(-0.4, 0.4),
        "center_of_gravity": rng.uniform(-0.01, 0.01, 3).tolist(),
        "center_of_buoyancy": rng.uniform(-0.01, 0.01, 3).tolist(),
    }
    total = vehicle_from_dict({"name": "v", "parts": [hull]}).assembly
    net, bg = rng.uniform(-3, 3), rng.uniform(0.005, 0.03)
    places = rng.uniform(-0.25, 0.25, (7, 3))
    command, stock = BallastTarget(net, True, bg), Stock(places, 30.0)
    try:
        pieces = pieces_for(total, command, stock)
    except ConfigError:
        pytest.skip("out of reach")  # random places need not surround the hull
    mass = sum(p.mass for p in pieces)
    volume = sum(p.volume for p in pieces)
    z_b = (0.01 * total.center_of_buoyancy[2] + sum(p.volume * p.position[2] for p in pieces)) / (0.01 + volume)
    lever = total.solid.mass * total.solid.center_of_gravity - 10.0 * total.center_of_buoyancy
    wet = 1 - 1000 / np.repeat([200.0, LEAD], 7)
    p = np.concatenate([places, places])
    A = np.stack([wet, wet * p[:, 0], wet * p[:, 1], wet * p[:, 2] - bg])
    b = np.array([10.0 - total.solid.mass - net / GRAVITY, -lever[0], -lever[1], 0.0])
    b[3] = bg * total.solid.mass - net / GRAVITY * z_b - lever[2]
    sets = np.array(list(itertools.combinations(range(14), 4)))
    sub = A[:, sets].transpose(1, 0, 2)
    regular = np.abs(np.linalg.det(sub)) > 1e-12
    x = np.linalg.solve(sub[regular], np.broadcast_to(b[:, None], (int(regular.sum()), 4, 1)))[..., 0]
    lightest = x[(x > -1e-9).all(axis=1)].sum(axis=1).min()
    # Ties are broken by a ten-thousandth of the mass.
    assert lightest * (1 - 1e-9) <= mass <= lightest * 1.0003


@pytest.mark.parametrize("seed", range(60))
def test_what_some_pieces_do_is_found_with_no_more_mass(seed):
    """Pieces drawn at random, however heavy and buoyant: what they do can be wished for."""
    rng = np.random.default_rng(seed)
    hull = BOX | {"mass": float(rng.uniform(5, 15)), "center_of_gravity": rng.uniform(-0.03, 0.03, 3).tolist()}
    total = vehicle_from_dict({"name": "v", "parts": [hull]}).in_water(float(rng.uniform(990, 1030))).assembly
    places = rng.uniform(-0.3, 0.3, (int(rng.integers(2, 12)), 3))
    stock = Stock(places, 1e3, float(rng.uniform(100, 600)))
    drawn = rng.exponential(rng.choice([0.05, 0.5, 3.0]), 2 * len(places)) * (rng.random(2 * len(places)) < 0.5)

    z_g, z_b = total.solid.center_of_gravity[2], total.center_of_buoyancy[2]

    def floats(mass, density, position):
        weight = total.solid.mass + mass.sum()
        volume = total.volume + (mass / density).sum()
        high = (total.volume * z_b + (mass / density) @ position[:, 2]) / volume
        low = (total.solid.mass * z_g + mass @ position[:, 2]) / weight
        return GRAVITY * (total.density * volume - weight), low - high

    net, bg = floats(drawn, stock.densities, stock.positions)
    pieces = pieces_for(total, BallastTarget(net, False, bg), stock)
    mass = np.array([p.mass for p in pieces])
    found = floats(mass, np.array([p.density for p in pieces]), np.array([p.position for p in pieces]).reshape(-1, 3))
    assert found == pytest.approx((net, bg), abs=1e-6)
    assert mass.sum() <= drawn.sum() * 1.0003 + 1e-9 and len(pieces) <= 3


def test_one_weight_by_hand():
    """A neutral body made 3 N heavy: lead that weighs 3 N in water, low and in the middle."""
    hull = {"name": "hull", "mass": 8.0, "volume": 0.008, "shape": {"box": [0.4, 0.2, 0.1]}}
    vehicle = vehicle_from_dict({"name": "v", "parts": [hull]})
    (piece,) = pieces_for(vehicle.assembly, BallastTarget(-3.0, True), Stock(around(vehicle), 2.0))
    assert piece.material == "lead" and piece.position == (0.0, 0.0, 0.05)
    assert piece.mass == pytest.approx(3.0 / GRAVITY / (1 - 1000 / LEAD), rel=1e-12)


def test_foam_goes_up_and_the_rest_stays():
    vehicle = load_vehicle("blueye_pioneer")
    stock = Stock(around(vehicle), 2.0)
    (foam,) = pieces_for(vehicle.assembly, BallastTarget(4.0), stock)
    assert foam.material == "foam" and foam.position[2] < 0
    assert foam.volume == pytest.approx(4.0 / GRAVITY / (1000 - 200), rel=1e-12)
    assert pieces_for(vehicle.assembly, BallastTarget(0.0, True, 0.025), stock) == []


@pytest.mark.parametrize("seed", range(12))
def test_what_is_reported_reachable_is(seed, tmp_path):
    """Just inside the limit that the message names there is an answer, just outside there is none."""
    rng = np.random.default_rng(seed)
    path = written(tmp_path, restoring={"net_buoyancy": float(rng.uniform(-2, 2))})
    total, command = load_vehicle(path).assembly, BallastTarget(float(rng.uniform(-4, 4)), bool(rng.integers(2)))
    stock = Stock(around(load_vehicle(path)), float(rng.uniform(1.0, 4.0)))
    with pytest.raises(ConfigError, match="at most [0-9.]+ mm can be reached") as caught:
        pieces_for(total, replace(command, metacentric_height=0.5), stock)
    limit = float(str(caught.value).split(" mm can be reached")[0].split()[-1]) / 1000
    assert pieces_for(total, replace(command, metacentric_height=limit * 0.999), stock)
    with pytest.raises(ConfigError):
        pieces_for(total, replace(command, metacentric_height=limit * 1.001), stock)
    with pytest.raises(ConfigError, match=r"net buoyancy 5000 N: .* to [0-9.]+ N can be reached") as caught:
        pieces_for(total, BallastTarget(5000.0), stock)
    limit = float(str(caught.value).split(" N can be reached")[0].split()[-1])
    assert pieces_for(total, BallastTarget(limit - 0.1), stock)


def test_one_place_cannot_level(tmp_path):
    with pytest.raises(ConfigError, match=r"level: with 1 place .* the best is roll .* pitch .* deg"):
        ballast(written(tmp_path), BallastTarget(level=True), Materials(places=[(0.2, 0.0, 0.0)]))


@pytest.mark.parametrize(
    ("command", "keys", "message"),
    [
        (BallastTarget(), {}, "nothing is asked for"),
        (BallastTarget(metacentric_height=-0.01), {}, "capsizes"),
        (BallastTarget(metacentric_height=20.0), {}, "did you mean 20mm"),
        (BallastTarget(1.0), {"water_density": 1.025}, "expected 900 to 1100"),
        (BallastTarget(1.0), {"materials": Materials(foam_density=1100.0)}, "expected foam that floats"),
        (BallastTarget(1.0), {"materials": Materials(weight_density=900.0)}, "weights that sink"),
        (BallastTarget(1.0), {"materials": Materials(places=[(200.0, 0, 0)])}, "did you mean 200mm"),
    ],
)
def test_targets_that_make_no_sense(command, keys, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        ballast(written(tmp_path), command, **keys)


def test_nothing_is_overwritten_and_the_part_is_found_from_elsewhere(tmp_path):
    path = written(tmp_path)
    before = path.read_text()
    for out, message in (
        (path, "exists already"),
        (tmp_path / "x.txt", ".yaml"),
        (tmp_path / "no" / "x.yaml", "folder"),
    ):
        with pytest.raises(ConfigError, match=message):
            ballast(path, BallastTarget(1.0), out=out)
    assert path.read_text() == before and list(tmp_path.iterdir()) == [path]
    (tmp_path / "deeper").mkdir()
    ballast(path, BallastTarget(1.0), out=tmp_path / "deeper" / "x.yaml")
    require(tmp_path / "deeper" / "x.yaml", None, 1.0)


def test_a_file_beside_that_shadows_the_library_is_not_taken(tmp_path):
    (tmp_path / "uhi.yaml").write_text(yaml.safe_dump({"name": "other", "parts": [BOX]}))
    ballast("uhi", BallastTarget(1.0), out=tmp_path / "x.yaml")
    require(tmp_path / "x.yaml", None, 1.0)
    assert load_vehicle(tmp_path / "x.yaml").assembly.solid.mass < 6.0


def test_rounded_pieces_are_in_steps_and_say_what_remains(tmp_path):
    path, out = written(tmp_path), tmp_path / "out.yaml"
    command = BallastTarget(2.0, True, 0.02)
    exact, rounded = ballast(path, command), ballast(path, command, step=0.01, out=out)
    for piece in rounded["pieces"]:
        steps = piece["mass_kg"] / 0.01 if piece["material"] == "lead" else piece["volume_m3"] / 1e-5
        assert steps == pytest.approx(round(steps), abs=1e-9) and steps >= 1
    assert rounded["after"] == exact["rounded"] and rounded["rounded"] is None
    require(out, None, rounded["after"]["net_buoyancy_N"])
    # At most half a step per piece.
    assert abs(rounded["after"]["net_buoyancy_N"] - 2.0) < len(exact["pieces"]) * 0.005 * GRAVITY


def test_notes_tell_what_was_not_meant(tmp_path):
    high = {"center_of_gravity": [0.0, 0.0, -0.03]}
    capsizing = tmp_path / "capsizing.yaml"
    capsizing.write_text(yaml.safe_dump({"name": "c", "parts": [BOX | high]}))
    assert any("capsizes" in note for note in ballast(capsizing, BallastTarget(0.0))["notes"])
    assert any("level" in note for note in ballast(written(tmp_path), BallastTarget(0.0))["notes"])
    assert any(
        "lowered" in note for note in ballast(written(tmp_path), BallastTarget(metacentric_height=0.01))["notes"]
    )
    assert ballast(written(tmp_path), BallastTarget(0.0, True, 0.03))["notes"] == []


def test_box_around_turned_shapes():
    ball = {"name": "ball", "pose": {"position": [1.0, 0, 0]}, "mass": 1.0, "shape": {"sphere": 0.1}}
    rod = {
        "name": "rod",
        "pose": {"position": [0, 0, 0], "attitude_deg": [0, 90, 0]},
        "mass": 1.0,
        "shape": {"cylinder": {"radius": 0.05, "length": 0.6}},
    }
    plate = {
        "name": "plate",
        "mass": 1.0,
        "pose": {"position": [0, 0, 0], "attitude_deg": [0, 0, 45]},
        "shape": {"box": [0.2, 0.2, 0.01]},
    }
    box = bounding_box(vehicle_from_dict({"name": "v", "parts": [ball, rod, plate]}).file)
    assert box is not None
    low, high = box
    np.testing.assert_allclose(low, [-0.1 * np.sqrt(2), -0.1 * np.sqrt(2), -0.3], atol=1e-12)
    np.testing.assert_allclose(high, [1.1, 0.1 * np.sqrt(2), 0.3], atol=1e-12)
