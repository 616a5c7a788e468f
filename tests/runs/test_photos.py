"""Photographs of a run: drawn or taken by a real camera, placed on the track, and read back by other programs."""

import csv
import json
import shutil
import subprocess
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import ExifTags, Image
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.core.datum import Datum
from rovtwin.core.errors import ConfigError, LogError
from rovtwin.core.log import Channel, Log
from rovtwin.imaging.photographs.jpeg import exif_in, jpeg_of, tagged
from rovtwin.runs.recording.channels import ETA, ETA_UNITS, NU, NU_UNITS, STD
from rovtwin.runs.recording.photo_sources import PhotoRequest
from rovtwin.runs.recording.photo_track import Track
from rovtwin.runs.recording.photos import photos_of_run
from rovtwin.scenario.files import dump_scenario, load_scenario

DATUM = Datum(-33.9, 151.25, 20.0, "2024-05-01T08:00:00Z")  # south and east: signs count
VEHICLE = """name: mine
restoring: {buoyancy: neutral}
parts:
- {name: rov, part: bluerov2_heavy}
- {name: down, part: lowlight_usb_camera, pose: {position: [0.2, 0.05, 0.1], attitude_deg: [0, -90, 0]}}
- {name: ahead, part: lowlight_usb_camera, pose: {position: [0.3, 0, 0]}}
"""
RDF, CAMERA = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}", "{http://pix4d.com/camera/1.0/}"
SMALL = 0.08
OFF = np.array([0.05, -0.03, 0.02])  # of the estimate [m]


def recorded(folder, channels=("truth/eta", "truth/nu", "autopilot/eta", "autopilot/std"), datum=DATUM):
    """Two lines of 4 m, 0.8 m apart, on opposite courses at 0.25 m/s, 1.6 m over the floor, heading 90 deg first."""
    t = np.arange(0.0, 36.0, 0.1)
    east = np.where(t < 16, 0.25 * t, np.where(t < 20, 4.0, 4.0 - 0.25 * (t - 20)))
    north = np.clip((t - 16) / 4, 0, 1) * 0.8
    heading = np.where(t < 18, 0.5 * np.pi, -0.5 * np.pi)
    eta = np.column_stack([north, east, 3.0 + 0 * t, 0.03 * np.sin(t), 0.02 + 0 * t, heading])
    std = np.tile([0.06, 0.08, 0.02, 1e-3, 1e-3, 2e-3] + [0.01] * 6, (len(t), 1))
    nu = np.column_stack([0.25 + 0 * t, *np.zeros((5, len(t)))])
    data = {"truth/eta": eta, "truth/nu": nu, "autopilot/eta": eta + [*OFF, 0, 0, 0], "autopilot/std": std}
    kinds = {"eta": (ETA, ETA_UNITS), "nu": (NU, NU_UNITS), "std": (STD, ETA_UNITS + NU_UNITS)}
    log = Log.from_arrays(
        [Channel(name, *kinds[name.split("/")[1]], "n") for name in channels],
        {name: (t, data[name]) for name in channels},
        {"datum": datum.metadata()} if datum else {},
    )
    log.write(folder / "log.mcap")
    (folder / "mine.yaml").write_text(VEHICLE)
    scenario = load_scenario("lawnmower_calm", [f"vehicle={folder / 'mine.yaml'}", "world.floor=4.6"])
    (folder / "scenario.yaml").write_text(dump_scenario(scenario))
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def made(run):
    request = PhotoRequest("down.camera", every=0.4, scene="shoal", scale=SMALL)
    return photos_of_run(run, request, run / "photos")


def xmp_of(picture):
    """Attributes in the namespace `Camera`."""
    (description,) = ElementTree.fromstring(picture.info["xmp"]).iter(f"{RDF}Description")
    return {key.removeprefix(CAMERA): value for key, value in description.attrib.items()}


def test_pictures_are_triggered_by_the_way_that_navigation_knows(made):
    assert len(made.names) == 22  # 4 m, 0.8 m and 4 m in steps of 0.4 m, and the first one
    ways = np.diff(np.interp(made.t, [0, 16, 20, 36], [0, 4, 4.8, 8.8]))
    assert np.allclose(ways[np.r_[:9, 13:21]], 0.4, atol=1e-3)  # round the corners it is the straight way that counts
    assert made.error == pytest.approx(np.linalg.norm(OFF), rel=1e-3)


def test_tags_are_read_by_pillow_as_they_were_meant(made):
    with Image.open(made.folder / made.names[3]) as picture:
        exif, angles = picture.getexif(), xmp_of(picture)
        assert picture.size == (round(1920 * SMALL), round(1080 * SMALL))
    gps, own = exif.get_ifd(ExifTags.IFD.GPSInfo), exif.get_ifd(ExifTags.IFD.Exif)
    degrees = [float(sum(x / 60.0**i for i, x in enumerate(gps[key]))) for key in (2, 4)]
    assert (gps[1], gps[3], gps[5]) == ("S", "E", b"\x01")
    place = DATUM.position(-degrees[0], degrees[1], float(gps[6]))
    # 1.2 m along, camera 0.2 m ahead (east) and 0.05 m to starboard (south), with the estimate's error.
    assert place == pytest.approx([OFF[0] - 0.05, 1.2 + 0.2 + OFF[1], 3.0 + 0.125 + OFF[2]], abs=0.02)
    assert float(gps[31]) == pytest.approx(0.1, abs=1e-4)  # 6 and 8 cm
    assert own[ExifTags.Base.DateTimeOriginal] == "2024:05:01 08:00:04"
    assert float(f"0.{own[ExifTags.Base.SubsecTimeOriginal]}") == pytest.approx(0.8, abs=0.11)
    assert float(gps[17]) == pytest.approx(90.0, abs=0.1)  # the top of the picture
    # 80 deg across in air, behind a port: 1144 px x 1.333 over 1920.
    assert float(own[ExifTags.Base.FocalLength]) == pytest.approx(36 * 1144 * 1.333 / 1920, rel=5e-3)
    assert float(angles["Yaw"]) == pytest.approx(90, abs=0.2) and float(angles["Pitch"]) == pytest.approx(
        1.146, abs=0.01
    )
    assert float(angles["GPSXYAccuracy"]) == pytest.approx(0.1 / np.sqrt(2), abs=1e-4)
    assert float(angles["GPSZAccuracy"]) == 0.02


@pytest.mark.skipif(shutil.which("exiftool") is None, reason="exiftool is not installed")
def test_exiftool_reads_the_same(made):
    words = ["exiftool", "-j", "-n", "-G", str(made.folder / made.names[-1])]
    found = json.loads(subprocess.run(words, capture_output=True, text=True, check=True).stdout)[0]
    with open(made.folder / "reference.csv", encoding="utf-8") as file:
        row = list(csv.DictReader(file))[-1]
    assert found["Composite:GPSLatitude"] == pytest.approx(float(row["latitude"]), abs=2e-9)
    assert found["Composite:GPSLongitude"] == pytest.approx(float(row["longitude"]), abs=2e-9)
    assert found["Composite:GPSAltitude"] == pytest.approx(float(row["altitude"]), abs=1e-4)
    assert found["XMP:Yaw"] == pytest.approx(270, abs=0.5) and found["XMP:Yaw"] == pytest.approx(float(row["yaw"]))
    assert found["EXIF:GPSHPositioningError"] == pytest.approx(0.1)
    assert found["EXIF:GPSImgDirectionRef"] == "T" and found["EXIF:OffsetTimeOriginal"] == "+00:00"
    assert found["Composite:SubSecDateTimeOriginal"].startswith(row["utc"][:19].replace("-", ":").replace("T", " "))
    assert "ExifTool:Warning" not in found and "ExifTool:Error" not in found


def test_tables_are_what_the_programs_read(made):
    rows = (made.folder / "geo.txt").read_text().splitlines()
    assert rows[0] == "EPSG:4326" and len(rows) == 23
    name, *numbers = rows[1].split(" ")
    longitude, latitude, altitude, yaw, _, _, horizontal, vertical = map(float, numbers)
    assert name == made.names[0] and (made.folder / name).is_file()
    assert (latitude, longitude) == pytest.approx((-33.9, 151.25), abs=1e-5)
    assert altitude < -3 and yaw == pytest.approx(90, abs=0.1)
    assert (horizontal, vertical) == pytest.approx((0.0707, 0.02), abs=1e-4)
    report = json.loads((made.folder / "photos.json").read_text())
    assert report["pictures"] == 22 and report["navigation"] == "estimate"


@pytest.mark.system
def test_overlap_is_reported_in_words(made, run):
    """Pictures 1.475 m over the floor show 1 m along the course: steps of 0.4 m leave 60 %, of 1 m next to nothing."""
    air = np.arctan(540 / 1144)
    glass, water = np.arcsin(np.sin(air) / 1.49), np.arcsin(np.sin(air) / 1.333)
    length = 2 * (0.010 * np.tan(air) + 0.006 * np.tan(glass) + (1.475 - 0.016) * np.tan(water))
    assert np.median(made.overlap.forward[:9]) == pytest.approx(1 - 0.4 / length, abs=0.06)  # less what rolling takes
    assert (made.overlap.side[2:8] > 0.3).all()  # the other line is 0.8 m away, pictures are 1.9 m wide
    sparse = photos_of_run(run, PhotoRequest("down.camera", every=1.0, scene="shoal", scale=0.05), run / "sparse")
    assert any("is seen by the next, 60% is enough" in note for note in sparse.notes)
    assert sparse.figures()["overlap_least"] < 0.2
    ahead = photos_of_run(run, PhotoRequest("ahead.camera", every=2.0, scene="shoal", scale=0.05), run / "ahead")
    assert any("overlaps cannot be judged" in note for note in ahead.notes)
    with Image.open(ahead.folder / ahead.names[0]) as picture:
        pitch = float(xmp_of(picture)["Pitch"])
    assert pitch == pytest.approx(90, abs=1.5)  # level ahead


@pytest.mark.system
def test_an_overlap_sets_the_way_between(run):
    found = photos_of_run(run, PhotoRequest("down.camera", overlap=0.5, scene="shoal", scale=0.05), run / "half")
    assert np.nanmedian(found.overlap.forward[:5]) == pytest.approx(0.5, abs=0.06)


def folder_of_real_ones(folder, offsets, zone="+02:00"):
    """As a camera two hours ahead of UTC and 2.5 s fast has taken them, so many seconds after the log's beginning."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    for i, t in enumerate(offsets):
        stamp = np.datetime64("2024-05-01T10:00:00") + np.timedelta64(round(1e6 * (t + 2.5)), "us")
        text, fraction = str(stamp.astype("datetime64[us]")).replace("-", ":").replace("T", " ").split(".")
        exif = Image.Exif()
        exif[ExifTags.Base.Make] = "GoPro"
        own = {ExifTags.Base.DateTimeOriginal: text, ExifTags.Base.SubsecTimeOriginal: fraction[:3],
               ExifTags.Base.ISOSpeedRatings: 400, ExifTags.Base.FocalLength: 3.0}  # fmt: skip
        exif.get_ifd(ExifTags.IFD.Exif).update(own | ({ExifTags.Base.OffsetTimeOriginal: zone} if zone else {}))
        noise = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
        (folder / f"GOPR{9 - i:04d}.JPG").write_bytes(tagged(jpeg_of(noise), exif, b"<x/>"))
    return folder


def test_real_pictures_get_their_place_and_stay_bit_for_bit(run, tmp_path):
    folder = folder_of_real_ones(tmp_path / "DCIM", (4.0, 8.0, 12.0, 50.0))
    request = PhotoRequest("down.camera", pictures=folder, clock_offset=2.5)
    found = photos_of_run(run, request, tmp_path / "out")
    assert found.names == ["GOPR0009.JPG", "GOPR0008.JPG", "GOPR0007.JPG"]
    assert found.t == pytest.approx([4.0, 8.0, 12.0], abs=1e-3)
    assert any("1 of 4 pictures lie outside the track" in note for note in found.notes)
    for name in found.names:
        with Image.open(folder / name) as before, Image.open(tmp_path / "out" / name) as after:
            assert np.array_equal(np.asarray(before), np.asarray(after))
    exif = exif_in(tmp_path / "out" / "GOPR0008.JPG")
    own = exif.get_ifd(ExifTags.IFD.Exif)
    assert exif[ExifTags.Base.Make] == "GoPro" and own[ExifTags.Base.ISOSpeedRatings] == 400
    assert own[ExifTags.Base.FocalLength] == 3.0 and own[ExifTags.Base.DateTimeOriginal] == "2024:05:01 08:00:08"
    assert exif.get_ifd(ExifTags.IFD.GPSInfo)[1] == "S"


def test_stamps_of_whole_seconds_count_in_the_accuracies(run, tmp_path):
    folder = folder_of_real_ones(tmp_path / "DCIM", (4.0, 8.0))
    coarse = folder / "GOPR0008.JPG"
    exif = exif_in(coarse)
    del exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.SubsecTimeOriginal]
    coarse.write_bytes(tagged(coarse.read_bytes(), exif, b"<x/>"))
    found = photos_of_run(run, PhotoRequest("down.camera", pictures=folder, clock_offset=2.5), tmp_path / "out")
    with open(tmp_path / "out" / "reference.csv", encoding="utf-8") as file:
        rows = {row["label"]: float(row["xy_accuracy_m"]) for row in csv.DictReader(file)}
    along = 0.25 / np.sqrt(12.0)  # eastwards, at 0.25 m/s
    assert rows["GOPR0009.JPG"] == pytest.approx(0.1 / np.sqrt(2), abs=1e-4)
    assert rows["GOPR0008.JPG"] == pytest.approx(np.sqrt((0.01 + along**2) / 2), abs=1e-3)
    assert any("1 pictures have stamps of whole seconds" in note for note in found.notes)


def test_a_track_that_stands_still_gains_nothing_from_the_spread_of_time():
    t = np.arange(0.0, 5.0, 0.1)
    track = Track(t, np.zeros((50, 3)), np.zeros((50, 3)), np.full((50, 6), 0.02))
    assert np.allclose(track.at(np.array([0.0, 2.0]), 0.29)[2], 0.02)


def test_tables_name_the_files_that_are_there(run, tmp_path):
    folder = folder_of_real_ones(tmp_path / "DCIM", (4.0, 8.0))
    (folder / "GOPR0009.JPG").rename(folder / "IMG 1.jpg")
    found = photos_of_run(run, PhotoRequest("down.camera", pictures=folder, clock_offset=2.5), tmp_path / "out")
    named = [row.split(" ")[0] for row in (tmp_path / "out" / "geo.txt").read_text().splitlines()[1:]]
    assert named == found.names == ["IMG_1.jpg", "GOPR0008.JPG"]
    assert all((tmp_path / "out" / name).is_file() for name in named)
    assert (tmp_path / "out" / "reference.csv").read_text().splitlines()[1].startswith("IMG_1.jpg,")
    assert any("spaces in names" in note for note in found.notes)


def test_an_offset_of_the_clock_must_be_stated(run, tmp_path):
    folder = folder_of_real_ones(tmp_path / "DCIM", (4.0, 8.0))
    with pytest.raises(ConfigError, match="nobody has said how far .* lie 6.5 to 10.5 s after the log's beginning"):
        photos_of_run(run, PhotoRequest("down.camera", pictures=folder), tmp_path / "out")
    assert not (tmp_path / "out").exists()
    late = folder_of_real_ones(tmp_path / "LATE", (4.0, 8.0), zone="")  # an hour is not a second
    with pytest.raises(ConfigError, match="none of 2 pictures was taken on the track: they lie from 7204.0"):
        photos_of_run(run, PhotoRequest("down.camera", pictures=late, clock_offset=2.5), tmp_path / "out")


def test_what_is_wrong_is_named(run, tmp_path):
    def fails(message, where=run, error=ConfigError, **request):
        with pytest.raises(error, match=message):
            photos_of_run(where, PhotoRequest(**request), tmp_path / "out")

    fails("found no camera 'dwn.camera'. Did you mean 'down.camera'", camera="dwn.camera", every=1.0)
    fails("names no scene", camera="down.camera", every=1.0)
    fails("does not go 100 m", camera="down.camera", every=100.0, scene="shoal", scale=0.05)
    fails("smoothed.mcap: not there", camera="down.camera", every=1.0, navigation="smoothed")
    (tmp_path / "empty").mkdir()
    fails("has no pictures", pictures=tmp_path / "empty", clock_offset=0.0)
    (tmp_path / "empty" / "cut.jpg").write_bytes(b"\xff\xd8\xff\xe0\x00\x10JFIF")
    fails("cut.jpg: cannot be read as a picture", pictures=tmp_path / "empty", clock_offset=0.0)
    Image.new("RGB", (8, 8)).save(tmp_path / "empty" / "cut.jpg")
    fails("cut.jpg: has no DateTimeOriginal", pictures=tmp_path / "empty", clock_offset=0.0)
    for name in ("no_truth", "no_poses", "no_datum"):
        (tmp_path / name).mkdir()
    recorded(tmp_path / "no_truth", ("autopilot/eta",))
    fails("no truth/eta to render", tmp_path / "no_truth", LogError, every=1.0, scene="shoal", camera="down.camera")
    recorded(tmp_path / "no_poses", ("truth/eta",))
    fails("has no autopilot/eta", tmp_path / "no_poses", LogError, every=1.0)
    recorded(tmp_path / "no_datum", datum=None)
    fails("has no datum", tmp_path / "no_datum", pictures=tmp_path / "empty", clock_offset=0.0)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.pdf").write_text("years of work")
    for overwrite in (False, True):
        with pytest.raises(ConfigError, match="is there already|holds other things"):
            photos_of_run(
                run, PhotoRequest("down.camera", every=2.0, scene="shoal", scale=0.05), tmp_path / "out", overwrite
            )
    assert (tmp_path / "out" / "thesis.pdf").read_text() == "years of work"


@pytest.mark.system
def test_the_command(run, tmp_path):
    def call(*words):
        return CliRunner().invoke(app, ["photos", str(run), "--camera", "down.camera", *map(str, words)])

    result = call("--scene", "shoal", "--every", 2, "--scale", 0.05, "-o", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["pictures"] == 5
    text = call("--scene", "shoal", "--every", 2, "--scale", 0.05, "-o", tmp_path / "out", "--overwrite").output
    assert "note: pictures 1 to" in text and "5 pictures, overlap" in text
    for words, message in (
        (("--every", 1, "--overlap", 0.5), "--every and --overlap: found both"),
        (("--pictures", tmp_path, "--every", 1), "--every: nothing would come of it"),
        (("--clock-offset", 1), "--clock-offset: nothing would come of it"),
        (("--navigation", "gps"), "found 'gps', expected estimate"),
    ):
        assert message in str(call(*words).exception)
