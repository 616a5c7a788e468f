"""What README and docs say: commands run, code runs, links lead somewhere."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import rovtwin.cli
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import load_scenario
from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.analysis.lint import check

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]


def commands(page: Path) -> list[str]:
    """Lines of the page's shell blocks that call rovtwin, without comments."""
    blocks = re.findall(r"```sh\n(.*?)```", page.read_text(), re.S)
    lines = [re.sub(r"\s+#.*$", "", line).strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith("rovtwin ")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_pictures_lead_to_files(page):
    targets = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", page.read_text())
    missing = [t for t in targets if "://" not in t and not (page.parent / t).exists()]
    assert not missing, f"{page.name} leads to what is not there: {missing}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_shown_exists_with_its_options(page, capsys):
    """`--help` behind each command: click checks names of commands and options before it answers."""
    for line in commands(page):
        words = shlex.split(line.split(" > ")[0].split(" | ")[0])[1:]
        depth = 2 if words and words[0] in ("vehicle", "scenario", "log", "evidence") else 1
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(sys, "argv", ["rovtwin", *words[:depth], "--help"])
            with pytest.raises(SystemExit) as stopped:
                rovtwin.cli.main()
        shown = capsys.readouterr().out
        assert stopped.value.code in (0, None), line
        for option in (word.split("=")[0] for word in words if word.startswith("--")):
            assert option in shown, f"{page.name}: {line}: no option {option}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_what_goes_with_a_link_stands_beside_one(page):
    """`fly` refuses these options without `--link`, which its help does not show; in text and in sentences, too."""
    text = page.read_text()
    written = re.findall(r"^rovtwin fly .*$|`rovtwin fly [^`]*`", text, re.M)
    bound = re.compile(r" --(sensor|no-thrust|arm|speed)\b")
    alone = [line for line in written if bound.search(line) and " --link " not in line]
    assert not alone, f"{page.name}: without --link: {alone}"


@pytest.mark.slow
def test_the_commands_of_the_readme_run(tmp_path, monkeypatch, capsys):
    """All of them, in order, in one folder; flights are cut short."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_vehicle.yaml").write_text(yaml.safe_dump(load_vehicle("double_blueye").to_dict()))
    lines = commands(ROOT / "README.md")
    assert len(lines) >= 8
    for line in lines:
        words = shlex.split(line)
        if words[1] in ("fly", "score"):
            seconds = 2 if "--realtime" in words else 25 if words[2] == "lawnmower_calm" else 12  # `watch` needs 20
            words += ["--set", f"duration={seconds}"]
            words += ["--no-report"] if words[1] == "fly" else []
        runs = sorted(Path("runs").glob("*")) if Path("runs").exists() else []
        if runs:  # `watch` compares the first flight of the lawn-mower with the last one
            calm = [run for run in runs if run.name.endswith("lawnmower_calm")]
            run = calm[0] if words[1] == "watch" else runs[-1]
            words = [w.replace("runs/<run>", str(run)).replace("runs/<later>", str(calm[-1])) for w in words]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as stopped:
            rovtwin.cli.main()
        expected = (1,) if words[1] in ("fly", "score") else (0, None)  # too short to finish
        assert stopped.value.code in expected, f"{line}: {capsys.readouterr().err}"
    assert (tmp_path / "run.nc").stat().st_size > 10_000


def test_the_first_vehicle_of_the_docs_is_what_its_page_says(tmp_path, monkeypatch, capsys):
    text = (ROOT / "docs" / "first_vehicle.md").read_text()
    monkeypatch.chdir(tmp_path)
    Path("otter.yaml").write_text(text.split("```yaml\n")[1].split("```")[0])
    monkeypatch.setattr(sys, "argv", ["rovtwin", "vehicle", "check", "otter.yaml"])
    with pytest.raises(SystemExit):
        rovtwin.cli.main()
    found = " ".join(capsys.readouterr().out.split())
    assert "rank 5 of 6" in found and "floats with 1.47 N" in found and "above 0.27 m/s" in found


def test_the_ballast_of_the_docs_is_what_is_printed(tmp_path, monkeypatch, capsys):
    text = (ROOT / "docs" / "vehicles.md").read_text()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    mine = text.split("```yaml\n")[1].split("```")[0].splitlines()
    Path("untrimmed.yaml").write_text("\n".join(line for line in mine if not line.startswith("restoring")))
    (line,) = [line for line in commands(ROOT / "docs" / "vehicles.md") if "-o ballasted.yaml" in line]
    monkeypatch.setattr(sys, "argv", shlex.split(line))
    with pytest.raises(SystemExit):
        rovtwin.cli.main()
    printed = [row.rstrip() for row in capsys.readouterr().out.strip().splitlines()]
    shown = text.split("```\npieces for my")[1].split("```")[0]
    assert printed == ("pieces for my" + shown).strip().splitlines()


def test_the_vehicles_and_the_scenario_of_the_docs_are_usable(tmp_path):
    found = []
    for page in ("vehicles.md", "scenarios.md"):
        blocks = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / page).read_text(), re.S)
        for i, block in enumerate(blocks):
            path = tmp_path / f"{page}_{i}.yaml"
            path.write_text(block)
            if block.startswith("name:"):
                found.append(check(path).verdict)
            elif block.startswith("description:"):
                found.append(compose(load_scenario(path)).scenario.name)
    assert found == ["usable", "usable", "scenarios.md_2"]


def test_the_performance_of_the_docs_is_what_is_printed(monkeypatch, capsys):
    shown = re.search(r"```\n(one axis at a time\n.*?)```", (ROOT / "docs" / "vehicles.md").read_text(), re.S)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(sys, "argv", ["rovtwin", "vehicle", "show", "double_blueye"])
    with pytest.raises(SystemExit):
        rovtwin.cli.main()
    printed = "\n".join(line.rstrip() for line in capsys.readouterr().out.splitlines())
    assert shown is not None and shown[1] in printed


@pytest.mark.slow
def test_the_examples_run(tmp_path):
    for example in sorted((ROOT / "examples").glob("*.py")):
        done = subprocess.run([sys.executable, example, "square"], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "path.png").stat().st_size > 10_000
