"""`rovtwin verify`: what was changed is named, what would harm is refused in words."""

import json
import os
import stat
import sys
import zipfile
from pathlib import Path

import pytest

import rovtwin.cli
from rovtwin.commission.certified import verify as module
from rovtwin.commission.certified.again import Row
from rovtwin.commission.certified.manifest import Derived, FileEntry, ParameterEntry, TestEntry, seal
from rovtwin.commission.certified.opening import opened
from rovtwin.commission.certified.verify import verify
from rovtwin.core.errors import ConfigError, IdentificationError

PAPER, LOG = "stages/1-paper/1/outcome.json", "stages/6-excite/1/part-1/log.mcap"


def run(monkeypatch, capsys, *words) -> tuple[int, str, str]:
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setattr(sys, "argv", ["rovtwin", "verify", *map(str, words)])
    with pytest.raises(SystemExit) as stopped:
        rovtwin.cli.main()
    found = capsys.readouterr()
    return int(stopped.value.code or 0), found.out, found.err


def zipped(folder: Path, target: Path) -> Path:
    with zipfile.ZipFile(target, "w") as archive:
        for path in sorted(folder.rglob("*")):
            if path.is_file():
                archive.write(path, f"bundle/{path.relative_to(folder).as_posix()}")
    return target


def changed(bundle: Path, **changes) -> None:
    path = bundle / "MANIFEST.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_an_untouched_bundle_is_verified(whole):
    for name in ("bundle", "bundle.zip"):
        found = verify(whole[0] / name)
        assert found.good and found.seal == whole[1].measured["seal"] and not found.findings
        assert found.not_derived == "it rests on no test" and not found.versions


def test_the_folder_of_a_commissioning_will_do(whole, tmp_path):
    """Its last certificate, by number."""
    assert verify(whole[0].parents[1], quick=True).good and verify(whole[0], quick=True).good
    for number in ("2", "10"):
        (tmp_path / "2-certificate" / number / "bundle").mkdir(parents=True)
        (tmp_path / "2-certificate" / number / "bundle" / "MANIFEST.json").write_text("{}")
    with opened(tmp_path) as found:
        assert found.where.endswith("10/bundle")


def test_what_differs_is_missing_or_extra_is_named(bundle, tmp_path):
    content = bytearray((bundle / LOG).read_bytes())
    content[len(content) // 2] ^= 1
    (bundle / LOG).write_bytes(content)
    (bundle / PAPER).unlink()
    (bundle / "vehicle.yaml").write_text("name: other\n")
    (bundle / "stages" / "more.txt").write_text("x")
    for path in (bundle, zipped(bundle, tmp_path / "b.zip")):
        found = verify(path)
        assert not found.good and not found.rows
        kinds = {(one.kind, one.path) for one in found.findings}
        assert kinds == {
            ("differs", LOG), ("missing", PAPER), ("differs", "vehicle.yaml"), ("extra", "stages/more.txt")
        }  # fmt: skip
        assert "not those that were certified" in found.not_derived and found.seal == ""


def test_a_manifest_that_was_mended_after_a_change_has_another_seal(bundle):
    (bundle / "vehicle.yaml").write_text("name: other\n")
    data = json.loads((bundle / "MANIFEST.json").read_text())
    import hashlib

    for one in data["files"]:
        if one["path"] == "vehicle.yaml":
            content = (bundle / "vehicle.yaml").read_bytes()
            one |= {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    changed(bundle, files=data["files"])
    found = verify(bundle, quick=True)
    assert not found.findings and found.seal != found.manifest.seal and not found.good
    changed(bundle, seal=found.seal)  # whoever mends all of it cannot mend what was signed
    assert verify(bundle, quick=True).seal != data["seal"]


def test_the_seal_leaves_out_what_shows_it():
    one, page = (FileEntry(path=path, bytes=1, sha256=64 * c) for path, c in (("a", "0"), ("certificate.html", "1")))
    assert seal([page, one]) == seal([one]) != seal([page])


def test_other_versions_are_named(bundle):
    found = json.loads((bundle / "MANIFEST.json").read_text())["versions"]
    changed(bundle, versions=found | {"rovtwin": "0.0.1", "numpy": "99.0", "gone": "1.0"})
    lines = verify(bundle, quick=True).versions
    assert [line.split("(")[-1] for line in lines[:2]] == ["newer)", "older)"] and "not there now" in lines[2]


@pytest.fixture
def derivable(bundle):
    """A bundle with something to derive again."""
    derived = Derived(
        result="stages/7-identify/1/identified.nc", vehicle="identified.yaml", anchors=[],
        tests=[TestEntry(log=LOG, name="part-1", use="fit", duration_s=10.0)],
        parameters=[ParameterEntry(name="a.b", unit="N", value=1.0, theta=0.0, sd=0.1)],
    )  # fmt: skip
    changed(bundle, derived=derived.model_dump())
    return bundle


@pytest.mark.parametrize(
    ("row", "good"),
    [
        (Row("a.b", "N", 1.0, 1.0001, 0.001, 0.0), True),
        (Row("a.b", "N", 1.0, 1.1, 1.0, 0.0), False),
        (Row("a.b", "N", 1.0, 1.0, 0.0, 0.5), False),
        (Row("a.b", "N", 1.0, float("nan"), float("nan"), 0.0), False),
    ],
)
def test_parameters_that_come_out_otherwise_are_a_no(derivable, monkeypatch, capsys, row, good):
    monkeypatch.setattr(module, "derive_again", lambda folder, derived, progress: [row])
    code, out, _ = run(monkeypatch, capsys, derivable)
    assert code == (0 if good else 1) and "a.b" in out and ("NOT VERIFIED" in out) != good
    code, out, _ = run(monkeypatch, capsys, derivable, "--json")
    data = json.loads(out)
    assert data["verified"] is good and data["derived"][0]["certified"] == 1.0


def test_of_a_zip_only_its_own_files_are_unpacked(derivable, monkeypatch, tmp_path):
    seen = []

    def derive(folder, derived, progress):
        seen.extend(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
        return []

    monkeypatch.setattr(module, "derive_again", derive)
    path = zipped(derivable, tmp_path / "b.zip")
    assert verify(path).good and LOG in seen and len(seen) == len(verify(path, True).manifest.files)


def test_evidence_that_contradicts_itself_is_a_no(derivable, monkeypatch, capsys):
    code, out, _ = run(monkeypatch, capsys, derivable)
    assert code == 1 and "identified.nc has other parameters than the manifest" in out

    for error in (IdentificationError("a test is gone"), ValueError("a test is gone")):

        def fails(*_, error=error):
            raise error

        monkeypatch.setattr(module, "derive_again", fails)
        assert "a test is gone" in verify(derivable).contradiction and not verify(derivable).good
    code, out, _ = run(monkeypatch, capsys, derivable, "--quick")
    assert code == 0 and "not derived again: --quick" in out and "VERIFIED: files; no figure" in out


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"files": [{"path": "../x", "bytes": 1, "sha256": 64 * "0"}]}, "expected one within the bundle"),
        ({"files": [{"path": "/etc/passwd", "bytes": 1, "sha256": 64 * "0"}]}, "expected one within the bundle"),
        ({"files": [{"path": "a\\b", "bytes": 1, "sha256": 64 * "0"}]}, "expected one within the bundle"),
        ({"files": [{"path": "C:x", "bytes": 1, "sha256": 64 * "0"}]}, "expected one within the bundle"),
        ({"files": [{"path": "a\x1b[2J", "bytes": 1, "sha256": 64 * "0"}]}, "expected one within the bundle"),
        ({"files": 2 * [{"path": "a", "bytes": 1, "sha256": 64 * "0"}]}, "named twice"),
        ({"files": [{"path": "a", "bytes": -1, "sha256": 64 * "0"}]}, "bytes"),
        ({"files": [{"path": "a", "bytes": 10**15, "sha256": 64 * "0"}]}, "bytes"),
        ({"files": "many"}, "files"),
        ({"version": 2}, "found version 2"),
        ({"format": "other"}, "found no 'rovtwin commissioning bundle'"),
        ({"seal": "short"}, "seal"),
        ({"surprise": 1}, "surprise"),
    ],
)
def test_a_hostile_manifest_is_refused_in_words(bundle, changes, words, monkeypatch, capsys):
    changed(bundle, **changes)
    code, _, err = run(monkeypatch, capsys, bundle)
    assert code == 2 and words in err and "Traceback" not in err and "\x1b[2J" not in err


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"\xff", 100_000 * b"[", b'{"format": 9' + 5000 * b"9" + b"}"])
def test_a_manifest_that_is_none_is_refused(bundle, content):
    (bundle / "MANIFEST.json").write_bytes(content)
    with pytest.raises(ConfigError, match="expected"):
        verify(bundle)


def test_links_and_devices_in_a_folder_are_refused(bundle):
    (bundle / "stages" / "link").symlink_to("/etc/passwd")
    with pytest.raises(ConfigError, match="stages/link' is a link, expected files only"):
        verify(bundle)
    (bundle / "stages" / "link").unlink()
    os.mkfifo(bundle / "pipe")
    with pytest.raises(ConfigError, match="pipe' is no ordinary file"):
        verify(bundle)


def entry(name: str, mode: int = 0) -> zipfile.ZipInfo:
    found = zipfile.ZipInfo(name)
    found.external_attr = mode << 16
    return found


@pytest.mark.parametrize(
    ("name", "mode", "words"),
    [
        ("../outside.txt", 0, "expected one within the bundle"),
        ("/absolute.txt", 0, "expected one within the bundle"),
        ("bundle/a/../../b", 0, "expected one within the bundle"),
        ("bundle/link", stat.S_IFLNK | 0o777, "is a link or a device"),
        ("bundle/MANIFEST.json", 0, "in it twice"),
    ],
)
def test_a_hostile_zip_is_refused(bundle, tmp_path, name, mode, words):
    path = zipped(bundle, tmp_path / "b.zip")
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning) if "twice" in words else _nothing():
        archive.writestr(entry(name, mode), "/etc/passwd")
    with pytest.raises(ConfigError, match=words):
        verify(path)
    assert not (tmp_path / "outside.txt").exists()


class _nothing:
    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


def test_a_zip_that_says_another_size_is_named(bundle, tmp_path):
    """A bomb behind the name of a file: its size is not the manifest's, so that it is never unpacked."""
    path = tmp_path / "b.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(bundle.rglob("*")):
            name = file.relative_to(bundle).as_posix()
            if file.is_file():
                archive.writestr(f"bundle/{name}", bytes(30_000_000) if name == PAPER else file.read_bytes())
    (one,) = verify(path).findings
    assert one.path == PAPER and "30000000 bytes" in one.text


def test_a_damaged_zip_is_named_not_a_traceback(bundle, tmp_path):
    path = zipped(bundle, tmp_path / "b.zip")
    content = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        at = archive.getinfo(f"bundle/{LOG}").header_offset
    path.write_bytes(content[: at + 300] + bytes(50) + content[at + 350 :])
    (one,) = verify(path).findings
    assert one.path == LOG and "cannot be unpacked" in one.text
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ConfigError, match="no zip that can be read"):
        verify(path)


def test_what_is_no_bundle_is_refused(tmp_path, monkeypatch, capsys):
    for path, words in (("gone", "no such folder or file"), ("", "found no MANIFEST.json")):
        code, _, err = run(monkeypatch, capsys, tmp_path / path)
        assert code == 2 and words in err
    (tmp_path / "x.zip").write_text("no zip")
    assert run(monkeypatch, capsys, tmp_path / "x.zip")[0] == 2


def test_the_screen_says_what_was_found(bundle, monkeypatch, capsys):
    (bundle / PAPER).unlink()
    code, out, _ = run(monkeypatch, capsys, bundle, "--quick")
    assert code == 1 and f"missing: {PAPER}" in out and "NOT VERIFIED" in out
