"""gref4hsi, as published and not changed, reads our file of lines and finds the same points on the floor.

It wants older libraries than ours, and so an interpreter of its own: ROVTWIN_GREF4HSI names one.
"""

import configparser
import json
import os
import subprocess
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.imaging.helper import DOWN, imager

from rovtwin.core.datum import Datum
from rovtwin.imaging.floor import Plane
from rovtwin.imaging.imager import Mount
from rovtwin.imaging.lines import LinesFile
from rovtwin.imaging.lines_writer import Head, Navigation, write_lines
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.navigation import Navigation as Poses

LINES, PIXELS, BANDS = 400, 96, 5
FLOOR = Plane(5.0, (0.08, -0.05))
OFFSET = np.array([2.0, 0.5, 5.0])  # of the mesh from n, as its vertices are kept in single precision [m]
FROM_THEIRS = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # their x right, y back, z down in our frame s
RADIANCE = "processed/radiance"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def interpreter():
    path = os.environ.get("ROVTWIN_GREF4HSI")
    if path is None or subprocess.run([path, "-c", "import gref4hsi.scripts.georeference"], check=False).returncode:
        pytest.skip("no gref4hsi here: set ROVTWIN_GREF4HSI to an interpreter that imports it")
    return path


def flown() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, places and attitudes of a vehicle that rolls, pitches and turns."""
    t = 10.0 + 0.05 * np.arange(LINES)
    place = np.column_stack([0.2 * t - 2.0, 0.3 * np.sin(0.2 * t), 3.4 + 0.1 * np.cos(0.5 * t)])
    euler = np.column_stack([0.1 * np.sin(0.7 * t), -0.05 + 0.06 * np.cos(0.9 * t), 2.5 + 0.2 * np.sin(0.3 * t)])
    return t, place, euler


def lines_file(path: Path) -> Path:
    """Written as any scan is, with a boresight and a lever."""
    small = imager(pixels=PIXELS, band_count=BANDS, port=None, lens={"field_of_view_deg": 50.0})
    turned = Rotation.from_euler("ZYX", [0.03, -0.02, 0.015]).as_matrix() @ DOWN
    mount, shape = Mount(np.array([0.31, -0.12, 0.18]), turned, "uhi.camera"), (PIXELS, BANDS)
    t, place, euler = flown()
    head = Head(
        small, mount, Datum(), t, np.full(LINES, 0.025), np.full(shape, 64.0), np.full(shape, 2e6), 4095.0,
        Navigation(t, place, euler, "estimate"),
    )  # fmt: skip
    return write_lines(path, head, [np.full((LINES, *shape), 900, np.uint16)])


def camera_file(path: Path, lines: LinesFile) -> None:
    """Their camera model: focal length and centre in pixels, pose against the vehicle."""
    lens, mount = lines.imager.lens, lines.mount
    rz, ry, rx = Rotation.from_matrix(mount.rotation @ FROM_THEIRS).as_euler("ZYX")
    place = dict(zip(("tx", "ty", "tz"), mount.position, strict=True))
    values = {"rx": rx, "ry": ry, "rz": rz, **place, "f": lens.focal[0], "cx": lens.principal[0] + 0.5}
    values |= {"k1": 0.0, "k2": 0.0, "k3": 0.0, "width": PIXELS}
    text = "".join(f"<{name}>{float(value)!r}</{name}>" for name, value in values.items())
    path.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n<calibration>{text}</calibration>\n')


def mesh_file(path: Path, datum: Datum) -> None:
    """The floor as triangles of 1 m, in ECEF less an offset."""
    at = np.arange(-12.0, 13.0)
    north, east = (x.ravel() for x in np.meshgrid(at, at, indexing="ij"))
    place = np.column_stack([north, east, FLOOR.depth_and_slope(np.column_stack([north, east]))[0]])
    origin = datum.ecef(OFFSET)
    corner = (np.arange(len(at) - 1)[:, None] * len(at) + np.arange(len(at) - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + len(at), corner + len(at) + 1
    faces = np.concatenate([np.column_stack([a, c, b]), np.column_stack([b, c, d])])
    points = "\n".join(" ".join(map(repr, row)) for row in (datum.ecef(place) - origin).tolist())
    cells = "\n".join("3 " + " ".join(map(str, row)) for row in faces.tolist())
    head = f"# vtk DataFile Version 3.0\nfloor\nASCII\nDATASET POLYDATA\nPOINTS {len(place)} double\n"
    path.write_text(f"{head}{points}\nPOLYGONS {len(faces)} {4 * len(faces)}\n{cells}\n")
    meta = dict(zip(("offset_x", "offset_y", "offset_z"), origin.tolist(), strict=True))
    path.with_name(f"{path.stem}_meta.json").write_text(json.dumps(meta))


def geoid_file(path: Path) -> None:
    """Of no height anywhere: what they do with it is not compared."""
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(
        path, "w", driver="GTiff", width=36, height=18, count=1, dtype="float32", crs="EPSG:4326",
        transform=rasterio.transform.from_origin(-180.0, 90.0, 10.0, 10.0),
    ) as raster:  # fmt: skip
        raster.write(np.zeros((1, 18, 36), np.float32))


def settings(folder: Path) -> Path:
    """Their settings: where things lie in our file and in the folder."""
    ini = configparser.ConfigParser()
    ini.read_dict(
        {
            "General": {
                "mission_dir": str(folder), "pose_export_type": "h5_embedded", "model_export_type": "ply_file",
                "max_ray_length": 20, "red_wave_length": 650, "green_wave_length": 550,
                "blue_wave_length": 450,
            },
            "Coordinate Reference Systems": {"geocsc_epsg_export": 4978, "pos_epsg_orig": 4978},
            "Absolute Paths": {
                "h5_folder": f"{folder / 'h5'}/", "hsi_calib_path": folder / "camera.xml",
                "model_path": folder / "floor.vtk", "pose_path": folder / "pose.csv",
                "geoid_path": folder / "geoid.tif", "tide_path": folder / "no.txt",
                "rgb_point_cloud_folder": f"{folder}/",
            },
            "HDF.raw_nav": {
                "eul_zyx": "raw/nav/euler_angles", "position": "raw/nav/position_ecef",
                "timestamp": "raw/nav/timestamp", "rotation_reference_type": "eul_ZYX", "is_global_rot": False,
                "eul_is_degrees": True,
            },
            "HDF.hyperspectral": {
                "datacube": f"{RADIANCE}/dataCube", "exposuretime": f"{RADIANCE}/exposureTime",
                "timestamp": f"{RADIANCE}/timestamp", "is_calibrated": False,
            },
            "HDF.processed_nav": {
                "folder": "processed/nav/", "quaternion_ecef": "processed/nav/quaternion_ref_ecef",
                "position_ecef": "processed/nav/position_ref_ecef", "timestamp": "processed/nav/timestamp_hsi",
            },
            "HDF.calibration": {
                "band2wavelength": f"{RADIANCE}/calibration/spectral/band2Wavelength",
                "fwhm": f"{RADIANCE}/calibration/spectral/fwhm",
                "darkframe": f"{RADIANCE}/calibration/radiometric/darkFrame",
                "radiometricframe": f"{RADIANCE}/calibration/radiometric/radiometricFrame",
            },
            "Georeferencing": {"folder": "processed/georef/", "points_ecef_crs": "processed/georef/points_ecef_crs"},
        }
    )  # fmt: skip
    path = folder / "settings.ini"
    with path.open("w") as file:
        ini.write(file)
    return path


def test_their_points_are_ours_to_five_micrometres(interpreter, tmp_path):
    (tmp_path / "h5").mkdir()
    path = lines_file(tmp_path / "h5" / "dive_transectnr_0_chunknr_0.h5")
    with LinesFile(path) as lines:
        datum, t, radiance = lines.datum, lines.t, lines.radiance(0, LINES)[0]
        ours = Georeference(lines.imager, lines.mount, Poses.of_lines(lines), FLOOR).locate(t)
        camera_file(tmp_path / "camera.xml", lines)
    mesh_file(tmp_path / "floor.vtk", datum)
    geoid_file(tmp_path / "geoid.tif")
    script = Path(__file__).with_name("gref4hsi_points.py")
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PROJ_DATA")}
    done = subprocess.run(
        [interpreter, str(script), str(settings(tmp_path))],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-3000:]
    with netCDF4.Dataset(path) as file:
        theirs = datum.position_of_ecef(np.asarray(file["processed/georef/points_ecef_crs"][:]).reshape(-1, 3))
        again = np.asarray(file[f"{RADIANCE}/dataCube_radiance"][:])
    apart = np.linalg.norm(theirs.reshape(LINES, PIXELS, 3) - ours.point, axis=-1)
    assert ours.valid.all() and np.ptp(ours.point[..., :2], axis=(0, 1)).min() > 1.0
    assert apart.max() < 5e-6, f"{1e6 * apart.max():.2f} um"
    assert np.allclose(again, radiance, rtol=1e-5)  # their calibration of the counts, too
