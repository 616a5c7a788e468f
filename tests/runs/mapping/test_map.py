"""Mosaics of runs: a planted plate is where it lies and as bright as it is; broken off, it goes on; what is wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import rasterio
import trimesh
import yaml
from tests.imaging.helper import cut, data, imager
from typer.testing import CliRunner

import rovtwin
from rovtwin.cli import app
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Channel, Log
from rovtwin.imaging import lines as layout
from rovtwin.mapping.projection import project
from rovtwin.runs.mapping.make import map_run
from rovtwin.runs.mapping.request import MapRequest
from rovtwin.runs.mapping.result import Mosaic
from rovtwin.runs.recording.channels import ETA, ETA_UNITS
from rovtwin.runs.recording.scan import ScanRequest, scan_run
from rovtwin.scenario.files import dump_scenario, load_scenario

ROOT = Path(__file__).parents[3]
DATUM = Datum(59.0, 5.0, 40.0, "2024-05-01T08:00:00Z")
PLATE = np.array([0.55, 1.0])  # its middle, north and east [m]
SIDE = 0.24
pytestmark = pytest.mark.system  # scans and maps


def recorded(folder):
    """A run of 6 s at 0.2 m/s over a level floor, as if it had been flown, with an altimeter."""
    t = np.arange(0.0, 6.05, 0.1)
    roll = 0.03 * np.sin(1.3 * t)
    eta = np.column_stack([0.2 * t, 1.0 + 0 * t, 3.3 + 0.02 * np.sin(t), roll, 0.02 * np.cos(t), 0.1 + 0 * t])
    names = ("truth/eta", "autopilot/eta")
    values = {name: (t, eta + [off, 0, 0, 0, 0, 0]) for name, off in zip(names, (0.0, 0.05), strict=True)}
    channels = [Channel(name, ETA, ETA_UNITS, "n") for name in names]
    channels.append(Channel("sensor/altimeter", ("range", "t_valid"), ("m", "s"), "sensor"))
    high = (5.0 - eta[:, 2]) / (np.cos(eta[:, 3]) * np.cos(eta[:, 4]))
    values["sensor/altimeter"] = (t, np.column_stack([high, t]))
    Log.from_arrays(channels, values, {"datum": DATUM.metadata()}).write(folder / "log.mcap")
    scenario = load_scenario("lawnmower_calm", ["world.floor=5", "sensors={altimeter: true}"])
    (folder / "scenario.yaml").write_text(dump_scenario(scenario))
    plate = {"name": "plate", "plane": [SIDE, SIDE], "pose": {"position": [*PLATE.tolist(), 4.9999]}}
    scene = {
        "name": "flat",
        "water": {"constituents": {"cdom_440": 0.12, "scattering_550": 0.17}},
        "bottom": {"depth": 5.0, "surface": {"material": "mud"}},
        "objects": [plate | {"surface": {"material": "white_50"}}],
        "light": {"surface": 0.0},
    }
    (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = recorded(tmp_path_factory.mktemp("run"))
    request = ScanRequest(imager(pixels=120), str(folder / "scene.yaml"), navigation="truth")
    scan_run(folder, request, folder / "lines.h5")
    return folder


@pytest.fixture(scope="module")
def by_truth(run):
    request = MapRequest(
        run / "lines.h5", "truth", "truth", resolution=0.02, formats=("envi", "cog", "netcdf"), turn=1.0
    )
    return map_run(run, request, run / "truth")


def plate_in(mosaic, near):
    """Its middle on the map, each cell counted by how much of it is plate; its size; and spectra well inside."""
    values = np.moveaxis(np.array(mosaic.cube, float), 1, -1)
    values = np.where(values < -1.0, np.nan, values)
    grid = mosaic.about["grid"]
    x = grid["left_m"] + grid["cell_m"] * (np.arange(grid["columns"]) + 0.5)
    y = grid["top_m"] - grid["cell_m"] * (np.arange(grid["rows"]) + 0.5)
    far = np.hypot(x[None] - near[0], y[:, None] - near[1])
    band = values[..., 2]
    mud, plate = np.nanmedian(band[(far > 0.25) & (far < 0.4)]), np.nanmedian(band[far < 0.08])
    share = np.where(far < 0.22, np.clip((np.nan_to_num(band) - mud) / (plate - mud), 0.0, 1.0), 0.0)
    share[share < 0.08] = 0.0  # mud is not all alike
    middle = np.array([(share * x[None]).sum(), (share * y[:, None]).sum()]) / share.sum()
    return middle, share.sum() * grid["cell_m"] ** 2, values[far < 0.08]


def test_a_plate_is_where_it_lies_to_a_tenth_of_a_cell_and_as_bright_as_it_is(by_truth):
    middle = project(DATUM, rasterio.crs.CRS.from_user_input("EPSG:32632"), np.array([[*PLATE, 5.0]]))[0]
    assert by_truth.about["grid"]["crs"] == "EPSG:32632"
    found, size, inside = plate_in(by_truth, middle)
    assert np.abs(found - middle).max() < 0.1 * 0.02
    assert size == pytest.approx(SIDE**2, rel=0.06)
    assert np.abs(np.nanmean(inside, axis=0) / 0.5 - 1.0).max() < 0.05
    rows = np.genfromtxt(by_truth.folder / "uncertainty.csv", delimiter=",", names=True)
    kept = rows["masked_share"] < 0.5
    assert kept.sum() >= 3 and np.abs(rows["bias_made"][kept]).max() < 0.03  # the rest is noise of a dark imager
    assert np.nanmedian(by_truth.spectrum(*middle)) == pytest.approx(0.5, rel=0.05)


def test_a_panel_puts_right_lamps_that_are_wrong_and_says_what_it_did(run, by_truth, tmp_path):
    lamps = [lamp | {"radiant_flux": 1.5 * lamp["radiant_flux"]} for lamp in data()["lamps"]]
    wrong = imager(pixels=120, lamps=lamps)
    (tmp_path / "panel.csv").write_text("wavelength,reflectance\n400,0.5\n700,0.5\n")
    panel = tmp_path / "panel.yaml"
    panel.write_text(f"north: {PLATE[0]}\neast: {PLATE[1]}\nradius: 0.09\nreflectance: panel.csv\nsd: 0.01\n")
    request = MapRequest(run / "lines.h5", "truth", "truth", resolution=0.02, turn=1.0, imager=wrong)
    off = map_run(run, request, tmp_path / "off")
    found = map_run(run, replace(request, panel=panel), tmp_path / "m")
    assert off.about["figures"]["error_median"] > 0.25
    assert found.about["figures"]["error_median"] < by_truth.about["figures"]["error_median"] + 0.02
    about = found.about["figures"]["panel"]
    assert about["pixels"] > 100 and np.median(about["factor"]) == pytest.approx(1.5, rel=0.05)
    rows = np.genfromtxt(tmp_path / "m" / "uncertainty.csv", delimiter=",", names=True)
    assert not rows["lamps"].any() and (rows["panel"] > 0.0099).all()
    words = " ".join(found.remarks())
    assert "radiances are multiplied by 1.4" in words and "that of the water as stated" in words
    assert {"panel.yaml"} <= found.about["sha256"].keys()
    (tmp_path / "panel.csv").write_text("wavelength,reflectance\n500,0.5\n700,0.5\n")
    with pytest.raises(ConfigError, match="panel.csv: has 500 to 700 nm, expected those of the bands, 450 to 650 nm"):
        map_run(run, replace(request, panel=panel), tmp_path / "n")


def test_a_mesh_with_the_plate_on_it_makes_the_mosaic_of_the_true_floor(run, by_truth, tmp_path):
    corners = [[n, e, 5.0] for n in (-3.0, 5.0) for e in (-3.0, 5.0)]
    mesh = trimesh.Trimesh(corners, [[0, 1, 3], [0, 3, 2]], process=False)
    mesh.export(tmp_path / "floor.obj")
    request = MapRequest(
        run / "lines.h5", "truth", str(tmp_path / "floor.obj"), resolution=0.02, turn=1.0, floor_std=0.03
    )
    found = map_run(run, request, tmp_path / "m")
    assert (tmp_path / "m" / "cube.img").read_bytes() == (by_truth.folder / "cube.img").read_bytes()
    assert "mesh floor.obj, 2 of 2 triangles" in " ".join(found.remarks())
    assert found.about["settings"]["floor_std"] == 0.03 and "floor.obj" in found.about["sha256"]


def test_estimates_move_it_as_they_are_off_and_the_altimeter_gives_the_floor(run, tmp_path):
    found = map_run(run, MapRequest(run / "lines.h5", "estimate", resolution=0.02, turn=1.0), tmp_path / "m")
    middle = project(DATUM, rasterio.crs.CRS.from_user_input("EPSG:32632"), np.array([[*(PLATE + [0.05, 0.0]), 5.0]]))
    place, _, inside = plate_in(found, middle[0])
    assert np.abs(place - middle[0]).max() < 0.01 and "altimeter echoes" in " ".join(found.remarks())
    assert np.abs(np.nanmean(inside, axis=0) / 0.5 - 1.0).max() < 0.08


def test_all_files_are_there_and_open(by_truth):
    folder = by_truth.folder
    names = {"cube.img", "cube.hdr", "cube.tif", "layers.tif", "rgb.tif", "rgb.png", "mosaic.nc", "gaps.geojson"}
    names |= {"navigation.csv", "spectra.csv", "uncertainty.csv", "map.json", "report.html", "figures"}
    assert {path.name for path in folder.iterdir()} == names
    for name in ("cube.img", "cube.tif", "layers.tif", "rgb.tif"):
        with rasterio.open(folder / name) as file:
            assert file.crs.to_epsg() == 32632 and file.shape == by_truth.shape[:2]
    with netCDF4.Dataset(folder / "mosaic.nc") as file:
        assert file["wavelength"][:].tolist() == by_truth.about["wavelengths_nm"]
    again = Mosaic.read(folder)
    assert again.about == by_truth.about and repr(again).startswith("<Mosaic: ")
    assert len(again.about["sha256"]["lines.h5"]) == 64
    found = again.to_xarray()
    assert found["reflectance"].dims == ("wavelength", "y", "x") and found["range"].attrs["units"] == "m"
    assert len(again.summary()) > 4 and again.plot().images
    page = (folder / "report.html").read_text()
    assert "The mosaic" in page and "Spectra of places" in page and "layers.tif" in page


def test_killed_it_goes_on_to_the_same_mosaic(run, by_truth, tmp_path):
    out = tmp_path / "m"
    code = (
        "import time; from pathlib import Path; from rovtwin.runs.mapping import make; "
        "from rovtwin.runs.mapping.request import MapRequest\n"
        "def slow(what, done, count):\n    time.sleep(60 if done == 1 and what == 'lines' else 0)\n"
        f"run = Path({str(run)!r})\n"
        "request = MapRequest(run / 'lines.h5', 'truth', 'truth', resolution=0.02, "
        "formats=('envi', 'cog', 'netcdf'), turn=1.0)\n"
        f"make.map_run(run, request, Path({str(out)!r}), progress=slow)"
    )
    process = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, env=os.environ | {"PYTHONPATH": "src:."})
    until = time.monotonic() + 120.0
    while not (out / ".parts" / "part_00000").is_dir():
        assert process.poll() is None and time.monotonic() < until
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (out / "map.json").exists()
    request = MapRequest(
        run / "lines.h5", "truth", "truth", resolution=0.02, formats=("envi", "cog", "netcdf"), turn=1.0
    )
    found = map_run(run, request, out)
    assert found.about["figures"]["resumed_parts"] >= 1
    assert (out / "cube.img").read_bytes() == (by_truth.folder / "cube.img").read_bytes()
    assert not (out / ".parts").exists()


def test_lines_in_three_files_make_the_same_mosaic_to_the_last_bit_also_when_broken_off(run, by_truth, tmp_path):
    pieces = cut(run / "lines.h5", tmp_path / "cut", [33, 70])  # none at the edge of a block
    request = MapRequest(
        (pieces[1], pieces[2], pieces[0]), "truth", "truth", resolution=0.02, formats=("envi", "cog"), turn=1.0
    )
    first: list[int] = []

    def broken(what, done, count):
        first.append(done)
        if what == "lines" and done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        map_run(run, request, tmp_path / "m", progress=broken)
    found = map_run(run, request, tmp_path / "m")
    assert found.about["figures"]["resumed_parts"] >= 1 and first
    for name in ("cube.img", "layers.tif", "spectra.csv", "uncertainty.csv"):
        assert (tmp_path / "m" / name).read_bytes() == (by_truth.folder / name).read_bytes()
    assert found.about["settings"]["lines"] == [path.name for path in pieces]
    assert {path.name for path in pieces} <= found.about["sha256"].keys()
    assert "chunknr_0.h5 and 2 more" in (tmp_path / "m" / "report.html").read_text()
    of_folder = rovtwin.map(
        run, tmp_path / "cut", tmp_path / "f", navigation="lines", floor="plane", depth=5.0, turn=1.0, resolution=0.02
    )
    alone = rovtwin.map(
        run, run / "lines.h5", tmp_path / "o", navigation="lines", floor="plane", depth=5.0, turn=1.0, resolution=0.02
    )
    assert (of_folder.folder / "cube.img").read_bytes() == (alone.folder / "cube.img").read_bytes()


def test_places_are_those_of_a_file(run, tmp_path):
    (tmp_path / "p.csv").write_text("name,north,east\nplate,0.55,1.0\nfar away,50,50\n")
    request = MapRequest(run / "lines.h5", "truth", "plane", 5.0, resolution=0.05, points=tmp_path / "p.csv", turn=1.0)
    map_run(run, request, tmp_path / "m")
    rows = (tmp_path / "m" / "spectra.csv").read_text().splitlines()
    assert rows[0].split(",")[:4] == ["wavelength_nm", "plate", "plate sd", "plate truth"]
    first = rows[2].split(",")
    assert float(first[1]) == pytest.approx(float(first[3]), rel=0.06) and first[4] == ""


BAD = [
    ({"resolution": 1e-5}, ConfigError, "--resolution: found 1e-05"),
    ({"resolution": 0.02, "crs": "EPSG:4326"}, ConfigError, "no coordinates in metres"),
    ({"floor": "none.tif"}, ConfigError, "none.tif: cannot be read"),
    ({"navigation": "smoothed"}, ConfigError, "rovtwin smooth"),
    ({"navigation": "gps"}, ConfigError, "expected smoothed, estimate, truth, lines"),
    ({"begin": 900.0}, LogError, "no line of .* can be placed"),
    ({"clock_offset": 1e4}, LogError, "--clock-offset"),
    ({"water": "nothing.yaml"}, ConfigError, "nothing.yaml"),
    ({"formats": ("envi", "shape")}, ConfigError, "--formats: found 'shape'"),
    ({"register": True}, ConfigError, "rovtwin smooth"),
    ({"floor": "reef.vtk"}, ConfigError, "meshes are read as .ply, .obj, .stl, .off"),
    ({"floor": "none.ply"}, ConfigError, "--floor none.ply: cannot be read: No such file"),
    ({"floor_crs": "EPSG:32632"}, ConfigError, "--floor-crs: says in which frame a mesh is"),
    ({"floor_std": 0.1}, ConfigError, "--floor altimeter says itself how unsure it is"),
    ({"floor": "plane", "floor_std": -0.1}, ConfigError, "--floor-std: found -0.1 m"),
    ({"panel": Path("none.yaml")}, ConfigError, "none.yaml"),
    ({"panel": Path("none.yaml"), "radiance": True}, ConfigError, "leave one of them out"),
    ({"lines": Path("none.h5")}, LogError, "none.h5: cannot be read"),
]


@pytest.mark.parametrize(("changed", "kind", "message"), BAD, ids=[str(b[0]) for b in BAD])
def test_what_is_wrong_is_named_and_nothing_is_left_behind(run, tmp_path, changed, kind, message):
    with pytest.raises(kind, match=message):
        map_run(run, replace(MapRequest(run / "lines.h5", turn=1.0), **changed), tmp_path / "m")
    assert not (tmp_path / "m").exists()


def test_a_folder_that_is_somebodys_is_left_alone(run, by_truth, tmp_path):
    request = MapRequest(run / "lines.h5")
    with pytest.raises(ConfigError, match="holds a mosaic already"):
        map_run(run, request, by_truth.folder)
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(ConfigError, match="holds other files"):
        map_run(run, request, tmp_path)


def test_lines_of_an_instrument_without_a_run_need_a_depth_and_a_datum(run, tmp_path):
    real = tmp_path / "real.h5"
    real.write_bytes((run / "lines.h5").read_bytes())
    with netCDF4.Dataset(real, "a") as file:
        file[layout.OWN].renameGroup("truth", "hidden")
        file[layout.OWN].renameVariable("datum", "elsewhere")
    alone = MapRequest(real, resolution=0.05, turn=1.0, radiance=True, floor="plane")
    with pytest.raises(ConfigError, match="nobody knows how deep"):
        map_run(None, replace(alone, datum=DATUM), tmp_path / "m")
    with pytest.raises(ConfigError, match="datum"):
        map_run(None, replace(alone, depth=5.0), tmp_path / "m")
    found = rovtwin.map(
        None, real, tmp_path / "m", resolution=0.05, turn=1.0, radiance=True, floor="plane", depth=5.0, datum=DATUM
    )
    assert found.about["quantity"] == "radiance" and found.about["figures"]["seen_m2"] > 0.8
    assert found.about["figures"].get("error_median") is None


def test_the_command_makes_a_mosaic_and_says_what_is_in_it(run, tmp_path):
    words = ["map", run, "--lines", run / "lines.h5", "-o", tmp_path / "m", "--resolution", "0.05", "--max-turn", "50"]
    done = CliRunner().invoke(app, [*[str(word) for word in words], "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert found["seen_m2"] > 0.8 and found["out"] == str(tmp_path / "m") and found["notes"]
    for more, message in (
        (["--blend", "all"], "expected best or mean"),
        (["--datum", "63"], "LATITUDE,LONGITUDE"),
        (["--radiance", "--water", "x.yaml"], "takes no water off"),
    ):
        bad = CliRunner().invoke(app, [*[str(word) for word in words], "--overwrite", *more])
        assert isinstance(bad.exception, ConfigError) and message in str(bad.exception)
