"""What the repository and the wheel hold: pins, size, no traces of a machine, and a prompt command line."""

import configparser
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def constraint_lines() -> list[str]:
    lines = (line.split("#")[0].strip() for line in (ROOT / "constraints.txt").read_text().splitlines())
    return [line for line in lines if line]


def pins(python: str) -> dict[str, str]:
    environment = {**default_environment(), "python_version": python, "python_full_version": f"{python}.0"}
    found: dict[str, str] = {}
    for requirement in map(Requirement, constraint_lines()):
        if requirement.marker is None or requirement.marker.evaluate(environment):
            name = canonicalize_name(requirement.name)
            assert name not in found, f"constraints.txt: {name} is pinned twice for Python {python}"
            found[name] = next(iter(requirement.specifier)).version
    return found


@pytest.mark.parametrize("line", constraint_lines())
def test_constraint_is_an_exact_pin(line: str):
    requirement = Requirement(line)
    assert [s.operator for s in requirement.specifier] == ["=="], "write name==version"
    assert "*" not in str(requirement.specifier) and requirement.url is None and not requirement.extras


@pytest.mark.parametrize("python", PYTHONS)
def test_every_direct_requirement_has_a_pin_that_satisfies_it(python: str):
    pinned = pins(python)
    groups = [PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()]
    for requirement in (Requirement(line) for group in groups for line in group):
        if requirement.name != PROJECT["name"]:
            version = pinned.get(canonicalize_name(requirement.name))
            assert version, f"constraints.txt: no pin of {requirement.name} for Python {python}"
            assert version in requirement.specifier, (
                f"constraints.txt: {requirement.name}=={version}, need {requirement}"
            )


def test_every_installed_requirement_of_ours_is_pinned():
    """Follows the requirements of the installed packages, so that an indirect one without a pin is found."""
    from importlib.metadata import PackageNotFoundError, requires

    pinned = pins(f"{sys.version_info.major}.{sys.version_info.minor}")
    todo, seen = [(PROJECT["name"], "all")], set()
    while todo:
        name, extra = todo.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        try:
            lines = requires(name) or []
        except PackageNotFoundError:
            continue  # an extra that nobody installed here
        for requirement in map(Requirement, lines):
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                found = canonicalize_name(requirement.name)
                todo += [(found, e) for e in ("", *requirement.extras)]
    missing = {name for name, _ in seen} - pinned.keys() - {PROJECT["name"]}
    assert not missing, f"constraints.txt: no pin of {sorted(missing)}"


# The repository


def tracked_files() -> list[Path]:
    answer = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True)
    if answer.returncode:
        pytest.skip("not a git checkout")
    files = (ROOT / name for name in answer.stdout.split("\0") if name)
    return [path for path in files if path.is_file()]


def files_with(pattern: re.Pattern[str]) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}: {match.group()}"
        for path in tracked_files()
        if (match := pattern.search(path.read_bytes().decode("utf-8", errors="replace")))
    ]


def test_no_large_file():
    large = [
        f"{p.relative_to(ROOT)}: {p.stat().st_size / 1e6:.1f} MB" for p in tracked_files() if p.stat().st_size > 5e6
    ]
    assert not large, f"larger than 5 MB, keep them out of the repository: {large}"


def test_no_path_of_a_machine():
    places = ["/work/" + "main", "/work/" + "shared", str(Path.home()) + "/"]
    pattern = re.compile(r"(?<![\w.])(" + "|".join(map(re.escape, places)) + ")")
    assert not files_with(pattern), "write paths relative to the repository"


def test_no_private_registry():
    answer = subprocess.run([sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True)
    settings = configparser.ConfigParser(interpolation=None, delimiters=("=",))
    settings.read_string("[pip]\n" + answer.stdout)
    urls = [
        url for key, value in settings["pip"].items() if key.endswith("index-url") for url in value.strip("'\"").split()
    ]
    hosts = {urlsplit(url).hostname for url in urls} - {None, "", "pypi.org"}
    if not hosts:
        pytest.skip("pip here uses no registry of its own")
    assert not files_with(re.compile("|".join(re.escape(host) for host in hosts if host))), "name no registry"


# The package


def test_wheel_holds_every_source_file(tmp_path: Path):
    """Also what is not Python: vehicle files, templates, py.typed."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    expected = {str(p.relative_to(ROOT / "src")) for p in tracked_files() if p.is_relative_to(ROOT / "src")}
    assert not expected - held
    assert any(name.endswith("licenses/LICENSE") for name in held)


def test_help_answers():
    script = Path(sys.executable).with_name("rovtwin")
    answer = subprocess.run([script, "--help"], capture_output=True, text=True, timeout=60)
    assert answer.returncode == 0, answer.stderr
    assert "Usage" in answer.stdout


def test_help_loads_nothing_that_computes():
    code = "import sys, rovtwin.cli; print(*({'jax', 'numpy', 'equinox', 'matplotlib', 'xarray'} & sys.modules.keys()))"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert not answer.stdout.split(), "loaded while rovtwin.cli is imported; import it inside the command"
