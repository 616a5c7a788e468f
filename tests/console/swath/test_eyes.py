"""What of a vehicle sees a swath: imagers, cameras and sonars that look down, as they are described."""

import numpy as np
import pytest

from rovtwin.console.swath.eyes import REACH, eyes_of, looks_down, sounders_of
from rovtwin.console.swath.painter import swath_of
from rovtwin.core.errors import ConfigError
from rovtwin.imaging.footprint import footprint_of
from rovtwin.imaging.imager import load_imager, mount_of
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.description.cameras import cameras_of
from rovtwin.vehicle.physics.camera import project

DOWN = {"position": [0.1, 0.0, 0.2], "attitude_deg": [0, -90, 0]}
SONAR = {"name": "mbes", "kind": "sonar", "pose": DOWN, "max_range": 30.0}


def carrying(sensors=(), cameras=()):
    """A scenario whose BlueROV2 carries more, and looks ahead with its own camera."""
    described = load_vehicle("bluerov2_heavy").to_dict()
    described["parts"] = [*described.get("parts", []), {"name": "pod", "sensors": [*sensors], "cameras": [*cameras]}]
    return load_scenario("square").model_copy(update={"vehicle": described})


@pytest.mark.system
def test_the_librarys_imager_is_seen_through_its_port():
    scenario = load_scenario("lawnmower_calm", ["world.floor=5", "sensors={altimeter: true}"])
    (eye,), notes = eyes_of(scenario)
    vehicle = load_vehicle("double_blueye")
    expected = footprint_of(load_imager("uhi"), mount_of(vehicle), 1.5)
    width, middle = swath_of(eye, 1.5)
    assert (eye.name, eye.kind, eye.imager, eye.reach, notes) == ("uhi.camera", "imager", "uhi", REACH, [])
    assert width == pytest.approx(expected.level_width, rel=1e-6) and middle == pytest.approx(expected.middle, abs=1e-6)
    assert [one.name for one in sounders_of(scenario)] == ["altimeter"]


def test_a_fan_of_a_sonar_is_as_wide_as_it_is_described():
    (eye,), notes = eyes_of(carrying([SONAR | {"swath_deg": 90.0}]))
    assert (eye.name, eye.kind, eye.reach, notes) == ("pod.mbes", "sonar", 30.0, [])
    width, middle = swath_of(eye, 5.2)
    assert width == pytest.approx(2 * 5.0) and middle == pytest.approx([0.1, 0.0], abs=1e-9)


@pytest.mark.system
def test_a_camera_that_looks_down_sees_what_its_lens_shows():
    """Corners of its picture lie where its own projection says, through distortion."""
    camera = {"name": "down", "pose": DOWN, "focal_length": [800, 800], "distortion": [0.1, 0.0, 0.0, 0.0]}
    scenario = carrying(cameras=[camera])
    (eye,), _ = eyes_of(scenario)
    assert (eye.name, eye.kind) == ("pod.down", "camera")
    lens = next(one for one in cameras_of(vehicle_of(scenario)) if one.name == "pod.down")
    points = eye.origin + 3.0 * eye.direction
    pixels = np.asarray(project(lens.lens, (points - lens.position) @ lens.R_bc))
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    assert low == pytest.approx([-0.5, -0.5], abs=0.05) and high == pytest.approx([1919.5, 1079.5], abs=0.05)


@pytest.mark.parametrize(
    ("sensor", "why"),
    [
        (SONAR, "swath_deg: 90"),
        ({"name": "spectrum", "kind": "imager", "pose": DOWN}, "imager: uhi"),
        ({"name": "spectrum", "kind": "imager", "imager": "uih", "pose": DOWN}, "uih"),
    ],
    ids=["a sonar", "an imager", "an imager of a name that there is not"],
)
def test_what_is_not_known_of(sensor, why):
    eyes, notes = eyes_of(carrying([sensor]))
    assert eyes == [] and len(notes) == 1 and why in notes[0] and sensor["name"] in notes[0]


@pytest.mark.parametrize(("pitch", "sees"), [(0, False), (-44, False), (-46, True), (-90, True), (90, False)])
def test_only_what_looks_down_counts(pitch, sees):
    tilted = SONAR | {"swath_deg": 60.0, "pose": {"attitude_deg": [0, pitch, 0]}}
    scenario = carrying([tilted])
    assert looks_down(scenario) == sees and bool(eyes_of(scenario)[0]) == sees


def test_an_opening_of_what_is_no_sonar_is_refused():
    with pytest.raises(ConfigError, match="swath_deg: 60 of a sensor of kind imager"):
        looks_down(carrying([{"name": "spectrum", "kind": "imager", "swath_deg": 60.0}]))
