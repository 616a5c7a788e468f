"""Bundles that `rovtwin watch --certificate` is given: only what was sealed is used, the rest is refused in words."""

import hashlib
import json
import zipfile

import pytest
from tests.commission.certified.test_verify import changed, zipped

from rovtwin.commission.after.issued import issued
from rovtwin.commission.certified.manifest import FileEntry, seal
from rovtwin.commission.certified.verify import verify
from rovtwin.core.errors import ConfigError

PROVE, PREDICT = "stages/8-prove/1/outcome.json", "stages/9-predict/1/outcome.json"


def resealed(bundle):
    """As somebody would who changes a bundle and mends its manifest, too."""
    files = [path for path in sorted(bundle.rglob("*")) if path.is_file() and path.name != "MANIFEST.json"]
    entries = []
    for path in files:
        name, content = path.relative_to(bundle).as_posix(), path.read_bytes()
        entries.append(FileEntry(path=name, bytes=len(content), sha256=hashlib.sha256(content).hexdigest()))
    changed(bundle, files=[one.model_dump() for one in entries], seal=seal(entries))
    assert verify(bundle, quick=True).good
    return bundle


def measured(bundle, page, **figures):
    path = bundle / page
    data = json.loads(path.read_text())
    path.write_text(json.dumps(data | {"measured": data["measured"] | figures}))


def refused(bundle, *words):
    with pytest.raises(ConfigError) as found, issued(bundle):
        pass
    assert all(word in str(found.value) for word in words), found.value


@pytest.mark.system
def test_what_was_sealed_is_read(bundle, tmp_path):
    for path in (bundle, zipped(bundle, tmp_path / "b.zip")):
        with issued(path) as found:
            assert found.seal == verify(bundle, quick=True).seal
            assert found.flight is not None and found.flight.name == "log.mcap"
            assert len(found.proven.envelope) == 6 and found.positions is not None
            assert (found.proven.seed, found.proven.samples) == (found.request.seed, found.request.samples)


@pytest.mark.system
def test_the_proofs_own_numbers_are_used(bundle):
    measured(bundle, PROVE, seed=7, samples=3)
    with issued(resealed(bundle)) as found:
        assert (found.proven.seed, found.proven.samples) == (7, 3)


@pytest.mark.system
def test_a_bundle_that_is_not_as_sealed_is_refused(bundle, tmp_path):
    (bundle / "stages" / "10-prove" / "1").mkdir(parents=True)
    (bundle / "stages" / "10-prove" / "1" / "outcome.json").write_text("{}")
    refused(bundle, "NOT VERIFIED", "not in the manifest")
    refused(zipped(bundle, tmp_path / "b.zip"), "NOT VERIFIED", "not in the manifest")
    measured(bundle, PROVE, seed=7)
    refused(bundle, "NOT VERIFIED", "differs", "rovtwin verify")


def test_a_damaged_zip_is_refused(bundle, tmp_path):
    path = tmp_path / "b.zip"
    with zipfile.ZipFile(path, "w") as archive:
        for one in sorted(bundle.rglob("*")):
            if one.is_file():
                archive.write(one, one.relative_to(bundle).as_posix())
        at = archive.getinfo(PROVE).header_offset
    content = bytearray(path.read_bytes())
    content[at + 200] ^= 1
    path.write_bytes(content)
    refused(path, "NOT VERIFIED", PROVE)


@pytest.mark.parametrize("log", ["../../../../../etc/hostname", "/etc/hostname", "flight//log.mcap"])
def test_a_flight_outside_of_the_bundle_is_refused(bundle, log):
    measured(bundle, PREDICT, log=log)
    refused(resealed(bundle), "within the bundle")


@pytest.mark.parametrize(
    "content",
    ["[1, 2]", "{", "{}", '{"vehicle": "a", "link": "b", "seed": "x"}', '{"vehicle": 1, "link": []}', "[" * 99999],
)
def test_a_request_that_is_none_is_refused(bundle, content):
    (bundle / "request.json").write_text(content)
    refused(resealed(bundle), "expected what rovtwin commission writes")


@pytest.mark.parametrize(
    "figures",
    [
        {"envelope": [{"current_m_s": 0.1}]},
        {"envelope": [{"current_m_s": 0.1, "sea_m": "x"}]},
        {"envelope": 3},
        {"largest_currents": [{"current_m_s": 0.1}]},
        {"samples": 0},
        {"seed": -1},
    ],
)
def test_a_proof_that_is_none_is_refused(bundle, figures):
    measured(bundle, PROVE, **figures)
    refused(resealed(bundle), "expected what rovtwin commission writes")


def test_readings_of_the_bench_that_are_none_are_refused(bundle):
    measured(bundle, "stages/2-bench/1/outcome.json", sensors=[1])
    refused(resealed(bundle), "expected what rovtwin commission writes")


def test_a_name_of_a_file_and_of_a_folder_is_refused(bundle, tmp_path):
    path = zipped(bundle, tmp_path / "b.zip")
    files = json.loads((bundle / "MANIFEST.json").read_text())["files"]
    empty = hashlib.sha256(b"").hexdigest()
    more = [{"path": name, "bytes": 0, "sha256": empty} for name in ("a", "a/b")]
    changed(bundle, files=files + more)
    with zipfile.ZipFile(path, "w") as archive:
        for one in sorted(bundle.rglob("*")):
            if one.is_file():
                archive.write(one, one.relative_to(bundle).as_posix())
        for one in more:
            archive.writestr(one["path"], b"")
    refused(path, "a file and a folder")
