"""`make interpreters`: which Pythons it finds, what it takes for a pin, and that it fails where one breaks."""

import sys
from pathlib import Path

import pytest
from tests import interpreters
from tests.interpreters import Broken, find, pins, unpinned

HERE = f"{sys.version_info.major}.{sys.version_info.minor}"
PINNED = pins("# pandas==1.0\npandas==3.1.1 ; python_version < '3.12'\npandas==2.3.3\nruamel-yaml==0.19.1\n")


def resolution(**versions: str) -> dict:
    return {"install": [{"metadata": {"name": name, "version": version}} for name, version in versions.items()]}


def test_what_has_no_pin_or_another_is_named():
    assert unpinned(resolution(rovtwin="0.1.0", pandas="2.3.3", Ruamel_Yaml="0.19.1"), PINNED) == []
    assert unpinned(resolution(pytz="2026.6", pandas="2.2.0"), PINNED) == ["pandas==2.2.0", "pytz==2026.6"]


def program(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)


def test_a_shim_that_runs_nothing_is_passed_over(tmp_path, monkeypatch):
    program(tmp_path / f"shims/python{HERE}", "exit 127")
    monkeypatch.setenv("PATH", f"{tmp_path / 'shims'}:/usr/bin:/bin")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PYENV_ROOT", str(tmp_path / "pyenv"))
    assert find(HERE) is None
    program(tmp_path / f"pyenv/versions/{HERE}.9/bin/python{HERE}", f'exec {sys.executable} "$@"')
    assert find(HERE) == Path(sys.executable)


@pytest.mark.parametrize("broken", [False, True])
def test_it_goes_through_all_and_fails_where_one_is_broken(broken, monkeypatch, capsys):
    def check(version, python, jobs):
        yield "resolves"
        if broken and version == "3.12":
            raise Broken("constraints.txt: no pin of pytz==2026.6: add it")

    monkeypatch.setattr(interpreters, "find", lambda version: None if version == "3.11" else Path(sys.executable))
    monkeypatch.setattr(interpreters, "check", check)
    monkeypatch.setattr(sys, "argv", ["interpreters.py"])
    assert interpreters.main() == int(broken)
    out, err = capsys.readouterr()
    assert "Python 3.11: skipped" in out and "Python 3.13: resolves" in out
    assert ("no pin of pytz" in out) == ("failed on Python 3.12" in err) == broken
