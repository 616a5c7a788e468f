"""The bundle: everything in it, nothing of the machine it was made on."""

import getpass
import hashlib
import json
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.commission.dossiers import small_log

from rovtwin.commission.certified.cleaning import Cleaner, public_url
from rovtwin.core.log import Log
from rovtwin.identification.result import Identification
from rovtwin.vehicle import load_vehicle


@pytest.mark.system
def test_every_file_has_its_hash_and_size(whole):
    bundle = whole[0] / "bundle"
    manifest = json.loads((bundle / "MANIFEST.json").read_text())
    listed = {one["path"]: one for one in manifest["files"]}
    there = {path.relative_to(bundle).as_posix() for path in bundle.rglob("*") if path.is_file()}
    assert there == set(listed) | {"MANIFEST.json"}
    for path, one in listed.items():
        content = (bundle / path).read_bytes()
        assert (one["bytes"], one["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())


@pytest.mark.system
def test_what_belongs_in_it_is_in_it(whole):
    names = {path.relative_to(whole[0] / "bundle").as_posix() for path in (whole[0] / "bundle").rglob("*")}
    assert names >= {
        "vehicle.yaml", "identified.yaml", "autopilot.yaml", "request.json", "versions.json", "README.txt",
        "certificate.html", "certificate.pdf", "stages/3-dip/1/outcome.json", "stages/3-dip/2/log.mcap",
        "stages/6-excite/1/part-1/log.mcap", "stages/7-identify/1/identified.nc", "stages/9-predict/1/flight/log.mcap",
    }  # fmt: skip
    assert not any("certificate/" in name for name in names)
    assert load_vehicle(str(whole[0] / "bundle" / "identified.yaml")).file.identified is not None


def test_nothing_in_it_tells_of_the_machine(whole):
    """Neither folders, nor the user of the paths, nor the password of the link; in logs neither."""
    bundle = whole[0] / "bundle"
    secrets = ["anna", "secret@", str(whole[0].parents[2]), tempfile.gettempdir() + "/", f"/home/{getpass.getuser()}"]
    for path in bundle.rglob("*"):
        if path.is_file():
            content = path.read_bytes()
            assert not [word for word in secrets if word.encode() in content], path
    log = Log.read(bundle / "stages/6-excite/1/part-1/log.mcap")
    assert log.metadata["command"] == "rovtwin commission my.yaml -o "
    assert log.metadata["note"] == "6-excite/1/part-1"
    before = Log.read(whole[0].parents[1] / "6-excite/1/part-1/log.mcap")
    assert np.array_equal(before["sensor/depth"].values, log["sensor/depth"].values)
    assert log.metadata["created"] == before.metadata["created"]


def test_a_file_that_was_cleaned_names_its_hash_of_before(whole):
    manifest = json.loads((whole[0] / "bundle" / "MANIFEST.json").read_text())
    source = whole[0].parents[1] / "6-excite/1/part-1/log.mcap"
    before = {one["path"]: one["sha256_before"] for one in manifest["cleaned"]}
    assert before["stages/6-excite/1/part-1/log.mcap"] == hashlib.sha256(source.read_bytes()).hexdigest()


def test_the_zip_holds_the_bundle(whole):
    with zipfile.ZipFile(whole[0] / "bundle.zip") as archive:
        assert archive.testzip() is None
        assert archive.read("bundle/MANIFEST.json") == (whole[0] / "bundle" / "MANIFEST.json").read_bytes()


@pytest.mark.parametrize(
    ("text", "clean"),
    [
        ("see {inside}/6-excite/1/log.mcap, then", "see 6-excite/1/log.mcap, then"),
        ("-o {inside} --link x", "-o  --link x"),
        ("{inside}er/x", "er/x"),
        ("'/home/bob/boats/my.yaml'", "'my.yaml'"),
        ('"C:\\\\Users\\\\bob\\\\my.yaml"', '"my.yaml"'),
        ("/Users/bob", "bob"),
        ("https://example.org/home/bob/x", "https://example.org/home/bob/x"),
        ("home/bob and 3 m/s in /ros/topic", "home/bob and 3 m/s in /ros/topic"),
    ],
)
def test_paths_are_taken_out_of_text(text, clean, tmp_path):
    inside = tmp_path / "commissioned"
    found = Cleaner(inside).text(text.format(inside=inside) if "{inside}" in text else text)
    assert found == clean if "er/x" not in text else str(tmp_path) not in found


def test_a_binary_file_that_tells_is_left_out(tmp_path):
    cleaner = Cleaner(tmp_path / "inside", [tmp_path / "anna"])
    (tmp_path / "a.nc").write_bytes(b"\x89HDF" + str(tmp_path / "anna" / "x").encode() + b"\x00")
    (tmp_path / "b.nc").write_bytes(b"\x89HDF nothing")
    (tmp_path / "c.csv").write_bytes(b"\xff\xfe")
    assert "names folders of the machine" in cleaner.copy(tmp_path / "a.nc", tmp_path / "out" / "a.nc")
    assert cleaner.copy(tmp_path / "b.nc", tmp_path / "out" / "b.nc") == ""
    assert "no text in UTF-8" in cleaner.copy(tmp_path / "c.csv", tmp_path / "out" / "c.csv")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["b.nc"]


def test_a_saved_identification_keeps_its_figures(whole, tmp_path):
    source = whole[0] / "bundle" / "stages/7-identify/1/identified.nc"
    result = Identification.load(source)
    tells = replace(result, findings=[f"see {tmp_path / 'anna' / 'my.yaml'}: odd"])
    tells.save(tmp_path / "identified.nc")
    cleaner = Cleaner(tmp_path / "inside", [tmp_path / "anna"])
    for name in ("one.nc", "two.nc"):
        assert cleaner.copy(tmp_path / "identified.nc", tmp_path / name) == "cleaned"
    found = Identification.load(tmp_path / "one.nc")
    assert found.findings == ["see my.yaml: odd"] and found.theta.tobytes() == result.theta.tobytes()
    assert (tmp_path / "one.nc").read_bytes() == (tmp_path / "two.nc").read_bytes()


def test_a_log_that_was_cut_off_and_tells_is_left_out(tmp_path):
    small_log(tmp_path / "log.mcap", command=f"rovtwin -o {tmp_path / 'anna' / 'x'}")
    whole = (tmp_path / "log.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: whole.rindex(b"sensor/depth")])
    cleaner = Cleaner(tmp_path / "inside", [tmp_path / "anna"])
    assert "names folders" in cleaner.copy(cut, tmp_path / "out" / "cut.mcap")
    assert not Path(tmp_path / "out" / "cut.mcap").exists()


def test_a_link_is_given_without_its_password():
    assert public_url("mavlink://bob:word@10.0.0.2:14550/a?b=1") == "mavlink://10.0.0.2:14550/a?b=1"
    assert public_url("twin://") == "twin://" and public_url("mavlink:///dev/ttyACM0") == "mavlink:///dev/ttyACM0"
