"""The imager's description and its rays."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.imaging.helper import DOWN, data, imager

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import parse
from rovtwin.imaging.files import imager_as_data, imager_schema, list_imagers, load_imager_file
from rovtwin.imaging.floor import Plane, ways_to
from rovtwin.imaging.imager import Imager, load_imager, mount_of
from rovtwin.imaging.schema import ImagerFile
from rovtwin.vehicle import load_vehicle


def snell(tangent: np.ndarray, port: dict, height: float) -> np.ndarray:
    """Where a ray behind a flat port comes to a plane across the line of sight, off that line [m], in closed form."""
    sine = tangent / np.hypot(1.0, tangent)
    glass, water = (sine / np.sqrt(n**2 - sine**2) for n in (port["glass"], port["water"]))
    return port["distance"] * tangent + port["thickness"] * glass + (height - 0.025) * water


def test_every_imager_of_the_library_says_where_its_values_come_from():
    for name in list_imagers():
        file = load_imager_file(name)
        given = set(file.model_fields_set) - {"name", "description", "source", "sources", "smallest_snr"}
        assert given <= set(file.sources), f"{name}: no source of {given - set(file.sources)}"
        assert parse(ImagerFile, imager_as_data(file), name) == file
    assert imager_schema()["properties"]["bands"]


def test_the_imager_of_the_docs_is_usable():
    page = (Path(__file__).parents[2] / "docs" / "mapping.md").read_text()
    shown = parse(ImagerFile, yaml.safe_load(page.split("```yaml\n")[1].split("```")[0]), "docs/mapping.md")
    assert Imager(shown).rays()[1].shape == (968, 3)


def test_its_field_of_view_in_the_water_is_that_of_snell():
    found = load_imager("uhi")
    half = np.degrees(np.arcsin(np.sin(np.radians(30.0)) / 1.333))
    edge = 0.5 / 968 * np.degrees(np.tan(np.radians(30)) * 2 / (1 + np.tan(np.radians(30)) ** 2))  # half a pixel
    assert np.degrees(found.view_angles[-1]) == pytest.approx(half, abs=2 * edge)
    assert np.allclose(found.view_angles, -found.view_angles[::-1], atol=1e-12)
    assert 2 * half == pytest.approx(44.1, abs=0.1)


def test_ground_points_of_a_level_floor_are_those_of_the_closed_form_to_a_nanometre():
    found, height = load_imager("uhi"), 1.5
    point, direction = (x @ DOWN.T for x in found.rays())
    way = ways_to(Plane(height), point, direction)
    at = point + way[:, None] * direction
    u = (np.arange(968) - 483.5) * np.tan(np.radians(30.0)) / 484.0
    port = {"distance": 0.02, "thickness": 0.005, "glass": 1.49, "water": 1.333}
    assert np.abs(at[:, 1] - snell(u, port, height)).max() < 1e-9
    assert np.abs(at[:, 0]).max() < 1e-12 and np.abs(at[:, 2] - height).max() < 1e-9


def test_a_ray_comes_to_a_slope_where_both_equations_hold():
    origin, direction = np.array([0.3, -0.2, 1.0]), np.array([0.1, 0.3, 0.9]) / np.linalg.norm([0.1, 0.3, 0.9])
    floor = Plane(4.0, (0.2, -0.1))
    way = float(ways_to(floor, origin, direction))
    at = origin + way * direction
    assert at[2] == pytest.approx(4.0 + 0.2 * at[0] - 0.1 * at[1], abs=1e-12)
    assert np.isnan(ways_to(floor, origin, -direction)) and np.isnan(ways_to(floor, origin, direction, longest=1.0))
    assert np.isnan(ways_to(floor, origin, np.array([1.0, 0.0, 0.0])))


def test_angles_for_each_pixel_give_the_rays_of_the_lens_that_has_them():
    lens = imager()
    tangent = (np.arange(12) - 5.5) / 6.0 * np.tan(np.radians(30.0))
    angles = imager(lens={"view_angles_deg": np.degrees(np.arctan(tangent)).tolist()})
    for a, b in zip(lens.rays(0.25), angles.rays(0.25), strict=True):
        assert np.abs(a - b).max() < 1e-12


def test_the_slit_is_wide_along_the_way():
    small = imager()
    first, last = (small.rays(across)[1] for across in (-0.5, 0.5))
    wide = np.arctan2(last[5, 2] - first[5, 2], last[5, 0])
    assert wide == pytest.approx(0.040 / 9.83 / 1.333, rel=1e-3)
    assert first[5, 2] < 0 < last[5, 2]


def test_a_band_sees_the_mean_over_its_response():
    small = imager()
    at = np.arange(400.0, 700.0, 0.25)
    assert np.allclose(small.in_bands(2.0 * at + 1.0, at), 2.0 * small.wavelengths + 1.0, atol=1e-6)
    sigma = 4.0 / 2.3548
    assert np.allclose(small.in_bands(at**2, at), small.wavelengths**2 + sigma**2, atol=1e-3)


def test_it_sits_where_the_vehicle_file_has_its_sensor():
    mount = mount_of(load_vehicle("double_blueye"))
    assert (
        mount.name == "uhi.camera" and np.allclose(mount.rotation, DOWN) and np.allclose(mount.position, [0, 0, 0.11])
    )
    with pytest.raises(ConfigError, match="carries no imager"):
        mount_of(load_vehicle("bluerov2"))
    with pytest.raises(ConfigError, match="no imager 'uhi.cam'.*uhi.camera"):
        mount_of(load_vehicle("double_blueye"), "uhi.cam")


BAD = [
    ({"lens": {"view_angles_deg": [-10.0, 0.0, 10.0]}}, "found 3 angles for 12 pixels"),
    ({"lens": {"field_of_view_deg": 1.047}}, "looks like radians"),
    ({"lens": {"view_angles_deg": np.linspace(-0.5, 0.5, 12).tolist()}}, "looks like radians"),
    ({"lens": {"view_angles_deg": [0.0] * 12}}, "grow from the left"),
    ({"lens": {"field_of_view_deg": 60.0, "focal_length": 100.0}}, "expected one of"),
    ({"bands": {"fwhm": 4.0}}, "no wavelengths"),
    ({"bands": {"first": 700.0, "last": 400.0, "count": 5, "fwhm": 4.0}}, "the shorter first"),
    ({"bands": {"centres": [500.0, 400.0], "fwhm": 4.0}}, "that grow"),
    ({"exposure": 0.06}, "0.05 s for each"),
    (
        {"lamps": [{"name": "a", "position": [0, 0, 0], "beam_deg": 60.0, "radiant_flux": 1.0}]},
        "temperature or spectrum",
    ),
    ({"detector": {"bits": 12}}, "missing"),
    ({"pixel": 5}, "no such key"),
]


@pytest.mark.parametrize(("changed", "message"), BAD, ids=[m for _, m in BAD])
def test_what_is_wrong_with_a_file_is_named(changed, message):
    with pytest.raises(ConfigError, match=message):
        parse(ImagerFile, data(**changed), "mine.yaml")


def test_a_distortion_that_leads_no_ray_to_a_pixel_is_named():
    with pytest.raises(ConfigError, match="leads no ray"):
        imager(lens={"field_of_view_deg": 100.0, "distortion": [-0.9, 0.0, 0.0, 0.0]}).rays()


def test_names_and_paths(tmp_path):
    assert load_imager("uhi.yaml") == load_imager("uhi")
    with pytest.raises(ConfigError, match="Did you mean 'uhi'"):
        load_imager("uhj")
    with pytest.raises(ConfigError, match="nowhere.yaml"):
        load_imager(tmp_path / "nowhere.yaml")
    assert isinstance(load_imager("uhi"), Imager)
