"""Objects by address: a mistyped one is seen without importing its module, and the message helps."""

import subprocess
import sys
from pathlib import Path

import pytest

import rovtwin
from rovtwin.core.errors import ConfigError
from rovtwin.core.plugins import BLOCKS, load, require_there
from rovtwin.core.trust import VARIABLE

SOURCE = """
import math as maths
A, (B, c) = 1, (2, 3)
limit: float = 2.0


class SlidingMode:
    class Inner: ...


def made(): ...
"""


@pytest.fixture(autouse=True)
def module(tmp_path, monkeypatch):
    """Two modules, beside each other in a package; one decides at run time what it has."""
    package = tmp_path / "plug_pack"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "control.py").write_text(SOURCE)
    (package / "dynamic.py").write_text("for name in 'xy':\n    globals()[name] = 1\n")
    (package / "broken.py").write_text("import not_there_at_all\nx = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv(VARIABLE, "1")
    yield
    for name in [name for name in sys.modules if name.startswith("plug_pack")]:
        del sys.modules[name]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("plug_pack.control:SlidngMode", "found no 'SlidngMode' in plug_pack.control, .* Did you mean 'SlidingMode'"),
        ("plug_pack.contrl:SlidingMode", "no module 'plug_pack.contrl', .*looked for in .*plug_pack.*mean 'control'"),
        ("plug_pac.control:SlidingMode", "no module 'plug_pac', .*PYTHONPATH .*installed packages.*mean 'plug_pack'"),
        ("plug_pack.control.x:Y", "no module 'plug_pack.control.x', as plug_pack.control is a module and no package"),
        ("spring", "found 'spring', expected package.module:Name"),
    ],
)
@pytest.mark.parametrize("look", [require_there, load])
def test_what_is_not_there_is_named_with_what_is_near(look, text, why):
    with pytest.raises(ConfigError, match=f"^key: .*{why}"):
        look(text, BLOCKS, "key")


def test_what_is_there_or_may_be_is_found_without_an_import():
    for name in ("SlidingMode", "SlidingMode.Inner", "made", "A", "B", "c", "limit", "maths"):
        require_there(f"plug_pack.control:{name}", BLOCKS, "key")
    require_there("plug_pack.dynamic:x", BLOCKS, "key")
    require_there("plug_pack.broken:x", BLOCKS, "key")  # `load` says what is wrong with it
    assert not {"plug_pack.control", "plug_pack.dynamic", "plug_pack.broken"} & sys.modules.keys()
    with pytest.raises(ConfigError, match="importing plug_pack.broken failed: No module named 'not_there_at_all'"):
        load("plug_pack.broken:x", BLOCKS, "key")


def test_a_mistyped_name_in_set_is_refused_before_jax_is_imported(tmp_path):
    code = (
        "import sys; from rovtwin.cli import main\n"
        "try: main()\n"
        "finally: assert 'plug_pack.control' not in sys.modules and 'jax' not in sys.modules, 'imported'"
    )
    words = ["fly", "square", "--set", "autopilot.controller=plug_pack.control:SlidngMode"]
    env = {"PYTHONPATH": f"{Path(rovtwin.__file__).parents[1]}:{tmp_path}"}
    done = subprocess.run([sys.executable, "-c", code, *words], env=env, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2 and "Did you mean 'SlidingMode'?" in done.stderr and "imported" not in done.stderr
