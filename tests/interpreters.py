"""Keep the README's promise: on Python 3.11, 3.12 and 3.13 the pins resolve, none is missing, and quick tests pass.

Each interpreter that is installed gets an environment in a temporary folder. What `pip install '.[all]'` would install
under constraints.txt must resolve, at versions that are pinned; then the smoke tests run, but for the interpreter that
runs this script: its tests are `make test`. Ends with 1 where one of them fails.
"""

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
# Extras of what the smoke tests touch, and what runs them: half of the time and disk of `all`.
EXTRAS = "campaign,console,panel,survey"
RUNNERS = ("pytest", "pytest-xdist", "hypothesis", "packaging", "xarray")
BUILDERS = ("hatchling", "editables", "setuptools")
# Every package once, a flight, a panel method, and the tests that other versions broke before.
SMOKE = (
    "tests/core",
    "tests/vehicle",
    "tests/survey",
    "tests/campaign/test_draws.py",
    "tests/console/web/test_hub.py",
    "tests/console/test_orders.py",
    "tests/console/test_planning.py",
    "tests/console/test_wire.py",
    "tests/gnc/test_allocation.py",
    "tests/gnc/test_path.py",
    "tests/identification/test_decay.py",
    "tests/identification/test_panel.py",
    "tests/cli/test_cli.py::test_fly_says_all_that_a_script_needs",
    "tests/test_imports.py",
    "tests/test_packaging.py",
)
SMOKE_LIMIT = 1500.0  # [s]


class Broken(Exception):
    """An interpreter on which something does not work; the text says what."""


def find(version: str) -> Path | None:
    """An interpreter of that version that runs and can make environments: on the PATH, or of pyenv or uv."""
    homes = [Path(os.environ.get("PYENV_ROOT", "~/.pyenv")), Path("~/.local/share/uv/python")]
    patterns = (f"versions/{version}.*/bin/python{version}", f"cpython-{version}.*/bin/python{version}")
    known = [path for home in homes for pattern in patterns for path in sorted(home.expanduser().glob(pattern))]
    for candidate in (f"python{version}", *known):
        # A shim of pyenv is on the PATH also for versions that it refuses to run.
        check = "import ensurepip, sys, venv; print(*sys.version_info[:2], sep='.'); print(sys.executable)"
        try:
            probe = subprocess.run([candidate, "-c", check], capture_output=True, text=True, timeout=60)
        except OSError:
            continue
        found = probe.stdout.split("\n")
        if probe.returncode == 0 and found[0] == version:
            return Path(found[1])
    return None


def pins(text: str) -> dict[str, set[str]]:
    """The pinned versions of each package in the text of a constraints file, whatever their markers."""
    found: dict[str, set[str]] = {}
    for line in text.splitlines():
        if pin := re.match(r"([\w.-]+)==([^\s;#]+)", line):
            found.setdefault(normal(pin[1]), set()).add(pin[2])
    return found


def normal(name: str) -> str:
    """A package's name as registries compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def unpinned(report: dict, pinned: dict[str, set[str]]) -> list[str]:
    """Packages of a resolution, as `pip install --report` tells it, at versions that nobody pinned."""
    chosen = {normal(item["metadata"]["name"]): item["metadata"]["version"] for item in report["install"]}
    chosen.pop("rovtwin", None)
    return sorted(f"{name}=={version}" for name, version in chosen.items() if version not in pinned.get(name, ()))


def pip(python: Path, *arguments: str) -> None:
    """Run pip at the pinned versions.

    Raises:
        Broken: With what pip said of it.
    """
    options = ("--disable-pip-version-check", "-c", "constraints.txt")
    command = [str(python), "-m", "pip", "install", "--progress-bar", "off", *options, *arguments]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        # What is in conflict pip tells on standard output, after all that it collected.
        conflict = done.stdout.partition("The conflict is caused by:")[2].splitlines()
        errors = [line for line in done.stderr.splitlines() if not line.startswith("WARNING")]
        raise Broken("\n".join([f"pip install {' '.join(arguments)}", *errors[-15:], *conflict[:15]]))


def resolve(python: Path, folder: Path) -> int:
    """How many packages `.[all]` is.

    Raises:
        Broken: They do not go together, or one of them has no pin.
    """
    report = folder / "report.json"
    pip(python, "--dry-run", "--ignore-installed", "--no-build-isolation", "--report", str(report), ".[all]")
    found = json.loads(report.read_text(encoding="utf-8"))
    if missing := unpinned(found, pins((ROOT / "constraints.txt").read_text(encoding="utf-8"))):
        raise Broken(f"constraints.txt: no pin of {', '.join(missing)}: add it")
    return len(found["install"]) - 1


def smoke(python: Path, jobs: int) -> str:
    """The last line of the smoke tests.

    Raises:
        Broken: Something cannot be installed, or a test fails.
    """
    pip(python, "--no-build-isolation", f".[{EXTRAS}]", *RUNNERS)
    # The tests shall meet the package as it was installed, not the sources.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    options = ["-q", "-m", "not slow", "-n", str(jobs), "--dist", "loadscope", "-p", "no:cacheprovider", "-r", "f"]
    try:
        done = subprocess.run(
            [str(python), "-m", "pytest", *options, *SMOKE],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=SMOKE_LIMIT,
        )
    except subprocess.TimeoutExpired:
        raise Broken(f"the smoke tests were not done after {SMOKE_LIMIT:g} s") from None
    lines = (done.stdout + done.stderr).splitlines()
    if done.returncode:
        raise Broken("\n".join(lines[-60:]))
    return lines[-1]


def check(version: str, python: Path, jobs: int) -> Iterator[str]:
    """What to say of one interpreter, as it comes.

    Raises:
        Broken: Something does not work on it.
    """
    with tempfile.TemporaryDirectory(prefix="rovtwin-python") as name:
        folder = Path(name)
        subprocess.run([str(python), "-m", "venv", str(folder / "venv")], check=True)
        inside, began = folder / "venv/bin/python", time.monotonic()
        pip(inside, *BUILDERS)
        count = resolve(inside, folder)
        yield f"{count} packages resolve, all pinned ({time.monotonic() - began:.0f} s)"
        if version == f"{sys.version_info.major}.{sys.version_info.minor}":
            yield "its tests are those of 'make test'"
        else:
            began = time.monotonic()
            yield f"{smoke(inside, jobs)}, installation and all {time.monotonic() - began:.0f} s"


def main() -> int:
    """Check the interpreters one after the other; 1 where one of them fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="test processes")
    parser.add_argument("versions", nargs="*", default=PYTHONS, help=f"default: {' '.join(PYTHONS)}")
    given, failed = parser.parse_args(), []
    for version in given.versions:
        python = find(version)
        if python is None:
            print(f"Python {version}: skipped, it is not installed here", flush=True)
            continue
        try:
            for probe in check(version, python, given.jobs):
                print(f"Python {version}: {probe}", flush=True)
        except Broken as error:
            failed.append(version)
            print(f"Python {version}: FAILED: {error}", flush=True)
    if failed:
        print(f"interpreters: failed on Python {', '.join(failed)}", file=sys.stderr)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
