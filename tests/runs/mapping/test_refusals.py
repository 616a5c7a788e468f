"""Refused or masked, each by name: the list of what goes wrong with lines, navigation, floors and disks."""

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from tests.imaging.helper import imager
from tests.mapping.test_floors import dem
from tests.runs.mapping.test_map import recorded

from rovtwin.core.errors import ConfigError, LogError, RovtwinError
from rovtwin.core.log import Channel, Log
from rovtwin.imaging import lines as layout
from rovtwin.runs.mapping.make import map_run
from rovtwin.runs.mapping.request import MapRequest
from rovtwin.runs.recording.channels import ETA, ETA_UNITS
from rovtwin.runs.recording.scan import ScanRequest, scan_run

pytestmark = pytest.mark.system  # scans and maps


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = recorded(tmp_path_factory.mktemp("run"))
    scan_run(
        folder, ScanRequest(imager(pixels=40), str(folder / "scene.yaml"), navigation="truth"), folder / "lines.h5"
    )
    return folder


@pytest.fixture
def run(whole, tmp_path):
    for name in ("log.mcap", "scenario.yaml", "lines.h5"):
        shutil.copy(whole / name, tmp_path / name)
    return tmp_path


def in_file(change) -> Callable[[Path], dict]:
    """A change of the file of lines."""

    def changed(run):
        with netCDF4.Dataset(run / "lines.h5", "a") as file:
            change(file)
        return {}

    return changed


def in_poses(change) -> Callable[[Path], dict]:
    """A change of the poses of the run's log: times and poses in, times and poses out."""

    def changed(run):
        log = Log.read(run / "log.mcap")
        t, eta = change(log["autopilot/eta"].t, log["autopilot/eta"].values.copy())
        channels = [Channel("autopilot/eta", ETA, ETA_UNITS, "n")]
        channels.append(Channel("sensor/altimeter", ("range", "t_valid"), ("m", "s"), "sensor"))
        sounder = log["sensor/altimeter"]
        data = {"autopilot/eta": (t, eta), "sensor/altimeter": (sounder.t, sounder.values)}
        Log.from_arrays(channels, data, log.metadata).write(run / "log.mcap", overwrite=True)
        return {}

    return changed


def renamed(name):
    """A dataset that is not where it belongs."""

    def change(file):
        group, _, leaf = name.rpartition("/")
        file[group].renameVariable(leaf, "elsewhere")

    return in_file(change)


def shifted(file, first, last, by):
    file[layout.STAMP][first:last] = file[layout.STAMP][first:last] + by


def full(file):
    file[layout.CUBE][30:50] = int(file[layout.CUBE].saturation)


def copied(source, target, instead):
    """Groups and variables of a file, some left out (None) or made something else."""
    for name in source.ncattrs():
        target.setncattr(name, source.getncattr(name))
    for name, dimension in source.dimensions.items():
        target.createDimension(name, len(dimension))
    for name, variable in source.variables.items():
        values = instead(name, variable[...])
        if values is not None:
            kind = str if variable.dtype is str else values.dtype
            new = target.createVariable(name, kind, variable.dimensions)
            new[...] = values
            new.setncatts({key: variable.getncattr(key) for key in variable.ncattrs() if key != "_FillValue"})
    for name, group in source.groups.items():
        copied(group, target.createGroup(name), instead)


def with_variables(instead) -> Callable[[Path], dict]:
    """The file of lines with other variables, by name and values."""

    def changed(run):
        (run / "lines.h5").rename(run / "before.h5")
        with netCDF4.Dataset(run / "before.h5") as source, netCDF4.Dataset(run / "lines.h5", "w") as target:
            source.set_auto_maskandscale(False)
            copied(source, target, instead)
        return {}

    return changed


def without_wavelengths(name, values):
    return None if name == "band2Wavelength" else values


def as_radiances(name, values):
    """Floats in place of counts, some of them no numbers."""
    if name == "dataCube":
        values = values.astype(np.float32) * 1e-5
        values[30:50, :, 1] = np.nan
    return values


def turning(t, eta):
    eta[:, 5] += np.clip(t - 2.0, 0.0, 1.5) * 0.7
    return t, eta


def cut(run):
    data = (run / "lines.h5").read_bytes()
    (run / "lines.h5").write_bytes(data[: len(data) // 2])
    return {}


def without_system(run):
    return {"floor": str(dem(run / "dem.tif", crs=None))}


def elsewhere(run):
    return {"floor": str(dem(run / "dem.tif"))}  # of another place


REFUSED = {
    "stamps that turn back": (in_file(lambda f: shifted(f, 50, 60, -1.0)), "stamp of line 50 is .* expected stamps"),
    "all stamps outside the navigation": (lambda run: {"clock_offset": 1e4}, "no line of .* --clock-offset"),
    "no datum": (lambda run: renamed("rovtwin/datum")(run) | {"floor": "plane", "alone": True}, "--datum"),
    "rays past the floor": (lambda run: {"floor": "plane", "depth": 40.0}, "no pixel of any line meets the floor"),
    "no wavelengths": (with_variables(without_wavelengths), "no processed/.*band2Wavelength"),
    "a wavelength that is no number": (
        in_file(lambda f: f[layout.WAVELENGTHS].__setitem__(2, np.nan)), "band2Wavelength: number 2 is no number",
    ),
    "a floor without a coordinate system": (without_system, "says no coordinate system"),
    "a floor of another place": (elsewhere, "lies at x .* the survey at"),
    "a file that is cut": (cut, "is damaged or cut short, .* copy it again"),
}  # fmt: skip
MASKED = {
    "stamps outside the navigation": (lambda run: {"clock_offset": 2.0}, "lines lie outside the navigation of"),
    "gaps of the lines": (in_file(lambda f: shifted(f, 90, None, 0.5)), "lines are missing 1 times for more"),
    "gaps of the navigation": (
        in_poses(lambda t, eta: (t[(t < 2) | (t > 2.6)], eta[(t < 2) | (t > 2.6)])), "which has 1 gaps",
    ),
    "poses that are no numbers": (
        in_poses(lambda t, eta: (t, np.where((t > 2.0) & (t < 2.15), np.nan, eta.T).T)), "poses without a number",
    ),
    "turns": (in_poses(turning), "lines taken in turns faster than"),
    "full counts": (in_file(full), "of the counts are full and masked"),
    "radiances that are no numbers": (with_variables(as_radiances), "of the radiances are no numbers and masked"),
}  # fmt: skip


def mapped(run, **given):
    alone = given.pop("alone", False)
    request = MapRequest(run / "lines.h5", resolution=0.05, radiance=True, **({"turn": 0.3} | given))
    return map_run(None if alone else run, request, run / "m")


@pytest.mark.parametrize("case", REFUSED)
def test_it_is_refused_by_name(run, case):
    change, message = REFUSED[case]
    with pytest.raises((ConfigError, LogError), match=message):
        mapped(run, **change(run))
    assert not (run / "m").exists()


@pytest.mark.parametrize("case", MASKED)
def test_it_is_masked_and_named(run, case):
    change, message = MASKED[case]
    found = mapped(run, **change(run))
    assert any(re.search(message, remark) for remark in found.remarks()), found.remarks()
    assert found.about["figures"]["seen_m2"] > 0.2


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        ({"view_angles_deg": np.linspace(-30, 30, 39).tolist()}, "39 .*40"),
        ({"view_angles_deg": np.radians(np.linspace(-30, 30, 40)).tolist()}, "radian"),
    ],
    ids=["angles that are not as many as pixels", "degrees that are radians"],
)
def test_angles_of_an_imager_are_refused_by_name(lens, message):
    with pytest.raises(ConfigError, match=message):
        imager(pixels=40, port=None, lens=lens)


def test_a_full_disk_is_named_before_and_while_writing(run, monkeypatch):
    usage = shutil.disk_usage(run)
    monkeypatch.setattr("shutil.disk_usage", lambda path: usage._replace(free=1000))
    with pytest.raises(ConfigError, match="the disk has 0.0 GB free"):
        mapped(run)
    monkeypatch.undo()

    def no_room(self, number, part, notes):
        from rovtwin.core.log.files import write_error

        raise write_error(self.folder, OSError(28, "No space left on device"))

    monkeypatch.setattr("rovtwin.mapping.cells.parts.Parts.add", no_room)
    with pytest.raises(RovtwinError, match="No space left"):
        mapped(run)
    assert not (run / "m" / "map.json").exists()


def test_a_wrong_option_is_named_before_anything_heavy_is_loaded(run):
    """What takes ten seconds is not the refusal but JAX, SciPy's statistics and Matplotlib."""
    code = (
        "import sys\nfrom pathlib import Path\nfrom rovtwin.core.errors import ConfigError\n"
        "from rovtwin.runs.mapping.checking import check\nfrom rovtwin.runs.mapping.request import MapRequest\n"
        f"run = Path({str(run)!r})\n"
        "try:\n    check(run, MapRequest(run / 'lines.h5', water='none.yaml'), run / 'm', False)\n"
        "except ConfigError as error:\n    assert 'none.yaml' in str(error)\nelse:\n    raise SystemExit(1)\n"
        "print([name for name in ('jax', 'matplotlib', 'scipy.stats') if name in sys.modules])"
    )
    begun = time.process_time()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]" and time.process_time() - begun < 3.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"register": True, "navigation": "estimate"}, "expected smoothed"),
        ({"begin": 5.0, "end": 2.0}, "--from, --to: found 5 and 2 s"),
        ({"turn": 0.0}, "--max-turn"),
        ({"floor": "altimeter", "alone": True}, "--floor altimeter: needs a run"),
        ({"navigation": "smoothed", "alone": True, "floor": "plane"}, "needs a run"),
        ({"area": Path("none.geojson")}, "--area none.geojson: cannot be read"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_options_that_contradict_each_other_are_refused(run, given, message):
    with pytest.raises(ConfigError, match=message):
        mapped(run, **given)
