"""A full disk: the path is named, what was kept is said, and it can be read."""

import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pytest
from tests.core.damage import write_log
from tests.core.full_disk import full_at

from rovtwin.core.errors import LogError
from rovtwin.core.log import Channel, Log, LogWriter, export_csv, info, repair
from rovtwin.core.log.pictures import PictureWriter, read_pictures
from rovtwin.core.log.salvage import Salvage
from rovtwin.core.user_files.files import cannot, whole, write_text

CLOCK = Channel("clock", ("k", "noise"), "1", "")


def test_a_log_that_cannot_grow_is_whole_up_to_there(tmp_path: Path) -> None:
    path, random = tmp_path / "run.mcap", np.random.default_rng(1)
    kept = 0
    with full_at(50_000), pytest.raises(LogError) as failed, LogWriter(path, [CLOCK]) as writer:
        for k in range(100):
            t = k + np.arange(100) / 100
            writer.write_many("clock", t, np.column_stack([100 * k + np.arange(100), random.normal(size=100)]))
            writer.flush()
            kept = k
    text = str(failed.value)
    assert text.startswith(f"{path}: cannot be written: File too large. The system lets no file grow further")
    assert text.endswith(f"What was logged up to {kept + 0.99:.2f} s is kept") and 5 < kept < 99
    series = Log.read(path)["clock"]  # without a repair: nothing is left to write one to
    assert (series["k"] == np.arange(100 * (kept + 1))).all()
    assert info(path).messages == len(series)
    with pytest.raises(LogError, match="is kept"):
        writer.write("clock", 1e3, [0, 0])


def test_a_log_that_cannot_be_closed_is_whole_up_to_there(tmp_path: Path) -> None:
    """The index at the end is what does not fit."""
    path = tmp_path / "run.mcap"
    with pytest.raises(LogError, match="What was logged up to 9.00 s is kept"), LogWriter(path, [CLOCK]) as writer:
        for k in range(10):
            writer.write("clock", k, [k, 0])
        writer.flush()
        with full_at(path.stat().st_size + 60):
            writer.close()
    assert len(Log.read(path)["clock"]) == 10


def test_pictures_up_to_there(tmp_path: Path) -> None:
    path, random = tmp_path / "camera.mcap", np.random.default_rng(2)
    with full_at(50_000), pytest.raises(LogError, match=r"camera\.mcap: cannot be written.*up to 0\.\d+ s is kept"):
        with PictureWriter(path, "port") as pictures:
            for k in range(100):
                pictures.write(0.1 * k, 0.1 * k, random.bytes(5000))
    assert len(list(read_pictures(path))) in (8, 9)


def test_a_repair_that_does_not_fit_leaves_all_as_it_was(tmp_path: Path) -> None:
    path = write_log(tmp_path / "run.mcap", 5)
    before = path.read_bytes()
    with full_at(20_000), pytest.raises(LogError) as failed:
        repair(path)
    assert str(failed.value).startswith(f"{tmp_path / 'run.repaired.mcap'}: cannot be written: File too large")
    assert f"Nothing of it was written; {path} is as it was" in str(failed.value)
    assert list(tmp_path.iterdir()) == [path] and path.read_bytes() == before


def test_a_repair_whose_source_cannot_be_read_names_the_source(tmp_path: Path, monkeypatch: Any) -> None:
    """The system's error comes in the middle: the open file becomes a folder, which nobody can read."""
    path, check = write_log(tmp_path / "run.mcap", 5), Salvage._check_magic

    def break_it(salvage: Salvage, stream: BinaryIO, *arguments: Any) -> None:
        check(salvage, stream, *arguments)
        folder = os.open(tmp_path, os.O_RDONLY)
        os.dup2(folder, stream.fileno())
        os.close(folder)

    monkeypatch.setattr(Salvage, "_check_magic", break_it)
    with pytest.raises(LogError) as failed:
        repair(path)
    assert str(failed.value).startswith(f"{path}: cannot be read: ")
    assert list(tmp_path.iterdir()) == [path]


def test_an_export_that_does_not_fit_leaves_nothing(tmp_path: Path) -> None:
    log = Log.read(write_log(tmp_path / "run.mcap", 5))
    with full_at(20_000), pytest.raises(LogError, match="File too large.*Nothing of it was written"):
        export_csv(log, tmp_path / "csv")


def test_what_was_there_stays(tmp_path: Path) -> None:
    path = tmp_path / "identified.yaml"
    write_text(path, "before")
    with full_at(1000), pytest.raises(OSError) as failed:
        write_text(path, "x" * 2000)
    assert cannot(failed.value).startswith(f"{path}: File too large. The system lets no file grow")
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link_and_a_device_a_device(tmp_path: Path) -> None:
    (tmp_path / "link.yaml").symlink_to(tmp_path / "real.yaml")
    write_text(tmp_path / "link.yaml", "text")
    assert (tmp_path / "link.yaml").is_symlink() and (tmp_path / "real.yaml").read_text() == "text"
    write_text("/dev/null", "text")
    assert not Path("/dev/null").is_file()


def test_a_file_is_there_when_it_is_whole(tmp_path: Path) -> None:
    with whole(tmp_path / "a") as one:
        one.write_text("one")
        assert not (tmp_path / "a").exists()
    assert (tmp_path / "a").read_text() == "one"
