"""Imports point one way: core <- vehicle <- siblings <- scenario <- runs <- live, planning, campaign, console <- cli.

Inside a package they point one way, too (LAYERS), and at run time no two files import each other by any detour.

The sources are parsed, not imported: the test is quick, and it also sees imports inside functions and under
`TYPE_CHECKING`.
"""

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "src" / "rovtwin"

SIBLINGS = {"simulation", "identification", "positioning", "gnc", "survey"}
LEAVES = {"links", "report"}
LIBRARIES = {"core", "vehicle", "imaging", "mapping", "monitoring"} | SIBLINGS | LEAVES
# What each package of rovtwin may import, besides itself. A new package gets its line here.
RULES: dict[str, set[str]] = {
    "_version": set(),
    "core": set(),
    "vehicle": {"core"},
    **{name: {"core", "vehicle"} for name in SIBLINGS | LEAVES},
    "imaging": {"core", "vehicle"},  # what makes lines and what makes maps of them share
    "simulation": {"core", "vehicle", "imaging"},
    "mapping": {"core", "vehicle", "imaging"},  # it knows lines, and not who made them
    "identification": {"core", "vehicle", "report"},  # a result draws itself; report knows of no sibling
    "monitoring": {"core", "vehicle", "identification", "gnc"},  # it reads records, and counts in a vehicle's scales
    "scenario": {"core", "vehicle", "gnc", "simulation"},  # it checks what people write by the names that these know
    "runs": LIBRARIES | {"scenario"},
    "live": LIBRARIES | {"scenario", "runs"},
    "planning": LIBRARIES | {"scenario", "runs"},
    "testing": LIBRARIES | {"scenario", "runs", "api", "console"},  # contracts for packages of others
    "demo": LIBRARIES | {"scenario", "runs", "planning"},
    "campaign": LIBRARIES | {"scenario", "runs"},
    "console": LIBRARIES | {"scenario", "runs", "live", "planning", "commission"},
    "commission": LIBRARIES | {"scenario", "runs", "live", "planning", "campaign"},
    "cli": LIBRARIES | {"scenario", "runs", "live", "planning", "demo", "campaign", "console", "commission"},
    "api": LIBRARIES | {"scenario", "runs", "live", "planning", "campaign"},
    "__main__": {"cli"},
    "__init__": LIBRARIES | {"scenario", "runs", "planning", "campaign", "api"},  # lazily, see PROMPT
}
EVERYWHERE = {"_version"}
FACES = ("__init__", "__main__")  # of a package: they stand above its rooms
MOST_MODULES = 16  # in a folder, so that a newcomer sees at a glance what is there
WHERE_RULES_ARE = "RULES in tests/test_imports.py"
# Protocols, each in a room of its own: a new one needs no row below.
PROTOCOLS = {endpoint.parent.name for endpoint in (PACKAGE / "links").glob("*/endpoint.py")}
# Rooms and modules inside a package, the lowest first: each imports its own line and the lines above it.
LAYERS: dict[str, list[set[str]]] = {
    "core": [
        {"errors", "sensors"},
        {"datum", "extras", "notebook", "plugins", "processes", "trust", "user_files", "vision"},
        {"log", "markers", "numerics", "types"},
        {"programs"},
        {"arrays", "block", "flow", "frames"},
        {"link", "stored"},
        {"contract"},
    ],
    "vehicle": [{"constants", "solids"}, {"physics"}, {"description"}, {"analysis"}, {"outfitting"}],
    "gnc": [
        {"guard", "interfaces", "mounting", "scales"},
        {"thesis"},
        {"allocation"},
        {"navigation"},
        {"guidance"},
        {"control"},
        {"safety"},
        {"autopilot", "experiment"},
    ],
    "simulation": [
        {"checks", "noise", "relief", "scene", "vehicle_firmware"},
        {"battery", "camera", "environment", "events", "imager", "mismatch", "roll_out", "sensors", "tether"},
        {"twin"},
        {"stepping"},
    ],
    "report": [
        {"flight", "series"},
        {"parts"},
        {"cameras", "evidence", "identification", "mapping", "run"},
        {"commission", "plans", "studies", "vehicles"},
    ],
    "links/mavlink": [
        {"mixing", "modes", "wire"},
        {"firmware"},
        {"driver", "telemetry"},
        {"services"},
        {"link", "server"},
        {"endpoint"},
    ],
    "links/blueye": [
        {"protobuf", "readings", "wire"},
        {"driver", "mission"},
        {"drone"},
        {"services"},
        {"link", "server"},
        {"double"},
        {"endpoint"},
    ],
    "campaign": [
        {"distributions", "shares", "tuning"},
        {"schema"},
        {"replay", "rows", "samples"},
        {"flying", "store", "summary"},
        {"session", "workers"},
        {"run"},
        {"reporting"},
    ],
    "positioning": [
        {"images"},
        {"estimators", "recording"},
        {"calibration", "track"},
        {"track_log"},
    ],
    "identification/logs/readers": [
        {"clocks", "convert"},
        {"raw"},
        {"assemble", "autopilots", "blueye", "ros", "rovtwin_log", "tables"},
        {"qtm"},
        {"c3d"},
        {"reading"},
    ],
    "vehicle/description": [
        {"fields", "thrust_curve", "water"},
        {"schema"},
        {"files", "learned", "totals"},
        {"thruster_arrays"},
        {"face", "identified", "power"},
        {"vehicle"},
        {"cameras", "instruments"},
    ],
    "links": [
        {"background", "clock", "endpoint", "host", "http_wire", "local_link", "servers", "url"},
        {"registry", "remote_link", "replay", "twin"} | PROTOCOLS - {"ros2"},
        {"ros2"},
    ],
    "console/engine": [
        {"fence", "lending", "manoeuvres", "steering", "world"},
        {"experiment_helm", "helm", "reporting"},
        {"flights", "vehicle_session"},
        {"switch", "ticker"},
        {"engine"},
        {"bridge"},
    ],
    "console/web": [
        {"assessing", "browser", "camera_stream", "gate", "mesh", "own_views", "panels", "sea_check", "swath_layer"},
        {"drafting", "page", "rehearsing", "sockets"},
        {"hub"},
        {"chart", "commissioning", "replays"},
        {"app"},
    ],
    "console": [
        {"assess", "clock", "control", "locks", "orders", "pictures", "surveys", "view", "wire", "worker"},
        {"camera", "chart", "client", "commissioning", "engine", "launch", "planning", "swath", "video"},
        {"rehearsal", "replays"},
        {"web"},
    ],
    "cli": [
        {"output"},
        {"scenarios"},
        {"cameras", "commissioning", "evidence", "flight", "planning", "studies", "vehicle"},
        {"identification"},
    ],
    "identification/joint": [{"model"}, {"solver"}, {"uncertainty"}, {"estimate"}, {"build", "result"}],
    "runs": [
        {"interrupt", "limits", "loop", "pace", "realtime", "run", "track", "under_way", "vehicle_defaults"},
        {"compose"},
        {"trimmed", "vehicle_figures"},
        {"feasibility"},
        {"scoring"},
        {"recording"},
        {"flight"},
        {"batch", "fly", "mapping", "smooth", "watch"},
        {"ensemble"},
    ],
    "live": [
        {"manoeuvres", "readiness"},
        {"beside", "connect", "record", "recorder", "serving"},
        {"flight"},
        {"pulses"},
    ],
}

# What may be imported while `rovtwin --help` starts; anything that computes goes inside the command's function.
PROMPT = {"cli", "__main__", "__init__"}
LIGHT_LIBRARIES = set(sys.stdlib_module_names) | {"typer", "rich", "click"}
LIGHT_MODULES = {
    "rovtwin.core.errors",
    "rovtwin.core.user_files.files",
    "rovtwin.core.user_files.jsontext",
    "rovtwin._version",
}
LIGHT_MODULES |= {"rovtwin.links.registry"}  # help names the protocols that it lists


@dataclass(frozen=True)
class Import:
    """One imported name, e.g. `rovtwin.core.frames.R_nb`, and where it is written."""

    name: str
    line: int
    text: str
    at_start: bool  # executed when the module is imported
    for_types: bool  # read by type checkers only


def imports_of(path: Path, package: Path) -> tuple[Import, ...]:
    """Every import of a file, relative ones resolved, also `import_module("...")` with a literal name."""
    module = ("rovtwin", *path.relative_to(package).with_suffix("").parts)
    return _imports(module, path.read_text(encoding="utf-8"))


@cache
def _imports(module: tuple[str, ...], source: str) -> tuple[Import, ...]:
    parents = [*module[:-1]]  # of a module, and of a package's __init__: the package `from .` means

    def visit(node: ast.AST, at_start: bool, for_types: bool = False) -> Iterator[Import]:
        names: list[str] = []
        match node:
            case ast.Import():
                names = [alias.name for alias in node.names]
            case ast.ImportFrom():
                base = parents[: len(parents) - node.level + 1] if node.level else []
                base = base + (node.module or "").split(".") if node.module else base
                names = [".".join([*base, alias.name]) for alias in node.names]
            case ast.Call(func=ast.Name(id=call) | ast.Attribute(attr=call), args=[ast.Constant(value=str(name)), *_]):
                if call in ("import_module", "__import__"):
                    names = [name if not name.startswith(".") else ".".join([*parents, name.lstrip(".")])]
        for name in names:
            yield Import(name, getattr(node, "lineno", 0), ast.unparse(node), at_start, for_types)

        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            body = node.body if isinstance(node.body, list) else [node.body]
            for child in ast.iter_child_nodes(node):
                yield from visit(
                    child, at_start and child not in body, for_types
                )  # defaults and decorators run at once
        elif isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            for child in node.body:
                yield from visit(child, False, True)
            for child in node.orelse:
                yield from visit(child, at_start)
        else:
            for child in ast.iter_child_nodes(node):
                yield from visit(child, at_start, for_types)

    return tuple(visit(ast.parse(source, filename="/".join(module)), True))


def violations(path: Path, package: Path) -> list[str]:
    """What is wrong with the imports of a file; each line says where, what, and what would be right."""
    where = path.relative_to(package)
    owner = where.with_suffix("").parts[0]
    if owner not in RULES:
        return [f"{where}: package '{owner}' has no rule. Say what it may import in {WHERE_RULES_ARE}."]
    known = {p.stem for p in package.iterdir() if p.is_dir() or p.suffix == ".py"} | set(RULES)
    found = []
    for item in imports_of(path, package):
        message = f"{where}:{item.line}: '{item.text}'"
        library, *rest = item.name.split(".")
        if library == "rovtwin":
            target = rest[0] if rest else "__init__"
            if target not in known or target in ("__init__", "*"):
                found.append(f"{message} goes through the front door; import from the package that defines the name.")
            elif target not in RULES:
                found.append(f"{message}: package '{target}' has no rule. Say who may import it in {WHERE_RULES_ARE}.")
            elif target not in RULES[owner] | EVERYWHERE | {owner}:
                allowed = ", ".join(sorted(RULES[owner])) or "nothing of ours"
                found.append(f"{message}: {owner} may not import {target} (it may import: {allowed}).")
        if owner in PROMPT and item.at_start and not _is_light(item.name, owner):
            found.append(f"{message} at the top of {owner} slows down `rovtwin --help`; import it inside the function.")
    return found


def upward(path: Path, package: Path) -> list[str]:
    """Imports inside a package that point up its LAYERS, and modules that have no place in them."""
    inside = [p for p in LAYERS if (package / p) in path.parents and path.relative_to(package / p).stem not in FACES]
    return [line for part in inside for line in _upward(path, package, part)]


def _upward(path: Path, package: Path, inside: str) -> list[str]:
    level = {name: i for i, names in enumerate(LAYERS[inside]) for name in names}
    room = path.relative_to(package / inside).with_suffix("").parts[0]
    if room not in level:
        return [f"{inside}/{room} has no place. Give it one in LAYERS in tests/test_imports.py."]
    prefix = f"rovtwin.{inside.replace('/', '.')}."
    above = {name: i for name, i in level.items() if i > level[room]}
    return [
        f"{path.relative_to(package)}:{item.line}: '{item.text}': {target} is above {room} in LAYERS."
        for item in imports_of(path, package)
        if f"{item.name}.".startswith(prefix) and not item.for_types
        # A name that is no room is one of the package's lazy face, which may lead anywhere.
        for target in [item.name.removeprefix(prefix).split(".")[0] if item.name.startswith(prefix) else "the package"]
        if target in above or target not in level
    ]


def crowded(package: Path) -> list[str]:
    """Folders with more than MOST_MODULES modules, the package's faces not counted."""
    counts = Counter(path.parent for path in package.rglob("*.py") if path.stem not in FACES)
    return [
        f"{folder.relative_to(package)} holds {count} modules, more than {MOST_MODULES}: cut it into rooms, see "
        "docs/architecture.md."
        for folder, count in sorted(counts.items())
        if count > MOST_MODULES
    ]


def circle(package: Path) -> list[str]:
    """A circle of imports between files, [] where there is none; what only type checkers read does not count."""
    modules = {".".join(["rovtwin", *p.relative_to(package).with_suffix("").parts]): p for p in package.rglob("*.py")}
    modules = {name.removesuffix(".__init__"): path for name, path in modules.items()}

    def module_of(name: str) -> str:
        while name and name not in modules:
            name = name.rpartition(".")[0]
        return name

    needs = {
        name: {module_of(item.name) for item in imports_of(path, package) if not item.for_types} - {name, ""}
        for name, path in modules.items()
    }
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def _is_light(name: str, owner: str) -> bool:
    if name.split(".")[0] != "rovtwin":
        return name.split(".")[0] in LIGHT_LIBRARIES
    return any(
        name == light or name.startswith(f"{light}.") for light in LIGHT_MODULES | {f"rovtwin.{owner}", "rovtwin.cli"}
    )


FILES = sorted(PACKAGE.rglob("*.py"))


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_imports_point_downwards(path: Path):
    assert not (wrong := violations(path, PACKAGE)), "\n" + "\n".join(wrong)


@pytest.mark.parametrize("path", FILES, ids=[str(p.relative_to(PACKAGE)) for p in FILES])
def test_rooms_import_downwards(path: Path):
    assert not (wrong := upward(path, PACKAGE)), "\n" + "\n".join(wrong)


def test_no_folder_is_crowded():
    assert not (found := crowded(PACKAGE)), "\n" + "\n".join(found)


def test_a_crowded_folder_is_found(tmp_path: Path):
    (tmp_path / "gnc").mkdir()
    for name in ("__init__", "__main__", *(f"part_{i}" for i in range(MOST_MODULES))):
        (tmp_path / "gnc" / f"{name}.py").write_text("")
    assert crowded(tmp_path) == []
    (tmp_path / "gnc" / "one_more.py").write_text("")
    (wrong,) = crowded(tmp_path)
    assert wrong.startswith(f"gnc holds {MOST_MODULES + 1} modules")


def test_no_circle_of_imports():
    assert not (found := circle(PACKAGE)), "a circle of imports: " + " <- ".join(found)


def test_a_circle_is_found(tmp_path: Path):
    for name, text in (
        ("a", "from rovtwin.b import x"),
        ("b", "def f():\n    import rovtwin.c"),
        ("c", "import rovtwin.a"),
    ):
        (tmp_path / f"{name}.py").write_text(text)
    assert set(circle(tmp_path)) == {"rovtwin.a", "rovtwin.b", "rovtwin.c"}
    (tmp_path / "c.py").write_text("if TYPE_CHECKING:\n    import rovtwin.a")
    assert circle(tmp_path) == []


def test_an_import_up_a_room_is_found(tmp_path: Path):
    path = tmp_path / "gnc" / "allocation" / "a.py"
    path.parent.mkdir(parents=True)
    path.write_text("from rovtwin.gnc.safety.rules import Rules\nfrom rovtwin.gnc.interfaces import Mode\n")
    (wrong,) = upward(path, tmp_path)
    assert wrong.startswith("gnc/allocation/a.py:1:") and "safety is above allocation" in wrong
    for face in (
        "from rovtwin.gnc import fly",
        "import rovtwin.gnc as g",
        "if not TYPE_CHECKING:\n    import rovtwin.gnc.safety",
    ):
        path.write_text(face)
        assert upward(path, tmp_path), face
    nowhere = tmp_path / "gnc" / "nowhere.py"
    nowhere.write_text("")
    assert "gnc/nowhere has no place" in upward(nowhere, tmp_path)[0]


# The checker itself, on a small tree: each line must be found, or must pass.

BAD = [
    ("core/a.py", "import rovtwin.vehicle"),
    ("core/a.py", "import numpy, rovtwin.gnc.thesis.ekf as o"),
    ("core/a.py", "from rovtwin.vehicle.physics.model import Model"),
    ("core/a.py", "from rovtwin import vehicle"),
    ("core/a.py", "from ..vehicle import Model"),
    ("core/a.py", "from .. import vehicle"),
    ("core/deep/a.py", "from ...vehicle import Model"),
    ("core/__init__.py", "from ..vehicle.model import Model"),
    ("core/a.py", "def f():\n    from rovtwin.vehicle import Model"),
    ("core/a.py", "if TYPE_CHECKING:\n    from rovtwin.vehicle import Model"),
    ("core/a.py", "import_module('rovtwin.vehicle')"),
    ("core/a.py", "importlib.import_module('rovtwin.vehicle')"),
    ("core/a.py", "import rovtwin"),
    ("core/a.py", "from rovtwin import Model"),
    ("core/a.py", "from rovtwin import *"),
    ("core/a.py", "from rovtwin import __version__"),
    ("simulation/a.py", "from rovtwin.gnc import Observer"),
    ("gnc/a.py", "from rovtwin.survey import plan"),
    ("links/a.py", "from rovtwin.simulation import Twin"),
    ("report/a.py", "from rovtwin.identification import fit"),
    ("survey/a.py", "from rovtwin.runs import fly"),
    ("scenario/a.py", "from rovtwin.campaign import study"),
    ("campaign/a.py", "from rovtwin.console import app"),
    ("console/a.py", "from rovtwin.cli import main"),
    ("cli.py", "import jax"),
    ("__init__.py", "import jax.numpy as jnp"),
    ("cli/main.py", "from numpy import array"),
    ("cli.py", "try:\n    import matplotlib\nexcept ImportError:\n    pass"),
    ("cli.py", "class A:\n    import equinox"),
    ("cli.py", "from rovtwin.runs import fly, study"),
    ("cli.py", "from .scenario import fly  # top"),
    ("cli.py", "from .core.log import Log"),
    ("__init__.py", "from rovtwin.vehicle import Vehicle"),
    ("cli.py", "from rovtwin.nonsense import x"),
]

GOOD = [
    (
        "core/a.py",
        "import jax\nfrom rovtwin.core.b import c\nfrom . import b\nfrom .b import c\nfrom rovtwin._version import v",
    ),
    ("core/deep/a.py", "from .. import errors\nfrom ..errors import RovtwinError"),
    ("vehicle/a.py", "from rovtwin.core import frames\nfrom ..core.frames import R_nb\nfrom rovtwinish import x"),
    ("gnc/a.py", "from rovtwin.vehicle import Model\nfrom ..core import Block"),
    ("runs/a.py", "from rovtwin.gnc import x\nfrom rovtwin.simulation import y\nfrom ..links import z"),
    ("campaign/a.py", "from rovtwin.runs import fly"),
    ("cli.py", "import sys\nimport typer\nfrom rich.table import Table\nfrom rovtwin._version import __version__"),
    (
        "cli.py",
        "from rovtwin.core.errors import LogError\ndef f():\n    import jax\n    from rovtwin.campaign import study",
    ),
    ("cli.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from rovtwin.scenario import Scenario"),
    ("cli/flight/runs.py", "from . import app\nfrom .app import console\nfrom ..core.errors import RovtwinError"),
    ("__main__.py", "from rovtwin.cli import main"),
    ("__init__.py", "from importlib import import_module\ndef __getattr__(name): return import_module('x.' + name)"),
]


def _checked(tmp_path: Path, file: str, source: str) -> list[str]:
    package = tmp_path / "rovtwin"
    for name in RULES.keys() - {"cli", "__main__", "__init__"}:
        (package / name).mkdir(parents=True)
    path = package / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(source)
    return violations(path, package)


@pytest.mark.parametrize(("file", "source"), BAD)
def test_checker_finds(tmp_path: Path, file: str, source: str):
    (wrong,) = {line.split(":")[0] for line in _checked(tmp_path, file, source)}
    assert wrong == file


@pytest.mark.parametrize(("file", "source"), GOOD)
def test_checker_passes(tmp_path: Path, file: str, source: str):
    assert _checked(tmp_path, file, source) == []


def test_checker_names_file_line_import_and_what_is_allowed(tmp_path: Path):
    (wrong,) = _checked(tmp_path, "vehicle/a.py", '"""Text."""\n\nfrom ..gnc import Observer\n')
    assert wrong == "vehicle/a.py:3: 'from ..gnc import Observer': vehicle may not import gnc (it may import: core)."


def test_checker_asks_for_a_rule_for_a_new_package(tmp_path: Path):
    (wrong,) = _checked(tmp_path, "quays/a.py", "import math")
    assert "package 'quays' has no rule" in wrong and WHERE_RULES_ARE in wrong
    user = tmp_path / "rovtwin" / "scenario" / "a.py"
    user.write_text("from rovtwin.quays import a\n")
    (wrong,) = violations(user, tmp_path / "rovtwin")
    assert "package 'quays' has no rule" in wrong and WHERE_RULES_ARE in wrong
