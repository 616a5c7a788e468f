"""Commands on a full disk: exit code 2, the path, what is kept; no traceback, and what is kept can be read."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from tests.core.full_disk import full_at

from rovtwin.core.log import Log

FLIGHT = ("fly", "lawnmower_waves", "--set", "autopilot=thesis", "--no-report")


def refused(size: int, *words: str | Path) -> str:
    """What a command says whose files cannot grow beyond so many bytes."""
    with full_at(size):
        process = subprocess.Popen(
            [sys.executable, "-m", "rovtwin.cli", *map(str, words)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
    _, text = process.communicate(timeout=900)
    assert process.returncode == 2 and "Traceback" not in text, text
    return text.strip().splitlines()[-1]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "flown"
    words = [*FLIGHT, "--set", "duration=10", "--out", folder]
    subprocess.run([sys.executable, "-m", "rovtwin.cli", *map(str, words)], check=False, capture_output=True)
    return folder / "log.mcap"


@pytest.mark.slow
def test_fly(flown: Path, tmp_path: Path) -> None:
    text = refused(flown.stat().st_size, *FLIGHT, "--set", "duration=40", "--out", tmp_path / "run")
    path = tmp_path / "run" / "log.mcap"
    assert text.startswith(f"rovtwin: {path}: cannot be written: File too large") and text.endswith("s is kept")
    log = Log.read(path)
    assert f"up to {log.end:.2f} s is kept" in text and log.end > 0.0


@pytest.mark.slow
def test_record(flown: Path, tmp_path: Path) -> None:
    out = tmp_path / "recorded.mcap"
    text = refused(60_000, "record", "lawnmower_waves", "--link", f"replay://{flown}", "--out", out, "--duration", "20")
    assert text.startswith(f"rovtwin: {out}: cannot be written: File too large") and text.endswith("s is kept")
    assert f"up to {Log.read(out).end:.2f} s is kept" in text


@pytest.mark.slow
def test_repair(flown: Path, tmp_path: Path) -> None:
    out = tmp_path / "repaired.mcap"
    text = refused(50_000, "log", "repair", flown, "--out", out)
    assert f"{out}: cannot be written" in text and f"Nothing of it was written; {flown} is as it was" in text
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_campaign(tmp_path: Path) -> None:
    file = {
        "scenario": "lawnmower_waves",
        "samples": 2,
        "set": {"autopilot": "thesis", "duration": 2},
        "vary": {"world.net_buoyancy": {"distribution": "uniform", "low": 0, "high": 1}},
    }
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(file))
    out = tmp_path / "out"
    text = refused(12_000, "campaign", tmp_path / "short.yaml", "--workers", "1", "--out", out)
    assert text.startswith(f"rovtwin: {out / 'campaign.yaml'}: File too large")  # tests/campaign: a mission's row
    assert not [path for path in out.rglob("*") if path.is_file() and path.stat().st_size]


@pytest.mark.slow
def test_identify(tmp_path: Path) -> None:
    from rovtwin.identification.identify import identify
    from rovtwin.identification.joint.result.overlay import to_yaml
    from rovtwin.vehicle import load_vehicle

    made = identify(load_vehicle("bluerov2"), [], free=["added_mass.yaw"])
    prior, out = tmp_path / "prior.yaml", tmp_path / "out" / "identified.yaml"
    prior.write_text(to_yaml(made.file(), "test"))
    made.save(prior.with_suffix(".nc"))
    out.parent.mkdir()
    out.write_text("of before")
    text = refused(3000, "identify", "bluerov2", "--prior", prior, "-o", out, "--keep")
    assert text.startswith(f"rovtwin: {out.parent}") and "File too large" in text and "othing of" in text
    assert list(out.parent.iterdir()) == [out] and out.read_text() == "of before"
