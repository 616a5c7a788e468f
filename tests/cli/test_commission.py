"""rovtwin commission on the command line: what is asked for, what is refused, and that paper alone needs no link."""

import json

import pytest
from typer.testing import CliRunner

from rovtwin.cli import app
from rovtwin.commission.dossier import Dossier


def invoked(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_real_vehicle_wants_a_person(tmp_path):
    found = invoked("commission", "double_blueye", "--link", "mavlink://10.1.2.3", "--tank", "6x3x1.5",
                    "-o", tmp_path / "c", "--yes")  # fmt: skip
    assert "--yes" in str(found.exception) and not (tmp_path / "c").exists()
    found = invoked("commission", "double_blueye", "--link", "twin://", "--tank", "6x3x1.5", "-o", tmp_path / "c")
    assert found.exception and "terminal" in str(found.exception)


def test_what_is_missing_is_named(tmp_path):
    found = invoked("commission", "-o", tmp_path / "none", "--yes")
    assert found.exception and "--link" in str(found.exception) and "--tank" in str(found.exception)


@pytest.mark.system
def test_paper_and_then_on_with_what_was_asked_for_at_first(tmp_path):
    folder = tmp_path / "c"
    common = ("-o", folder, "--yes", "--json", "--stage", "paper")
    asked = ("--current", "0.3", "--sea", "0.2", "--missions", "5", "--seed", "7", "--minutes", "4")
    found = invoked("commission", "gladius_mini", "--link", "twin://", "--tank", "8x5x2", *asked, *common)
    assert found.exit_code == 0, found.output
    page = json.loads(found.stdout)["stages"][0]
    assert page["state"] == "passed" and page["outcome"]["measured"]["vehicle"] == "gladius_mini"
    assert len(page["outcome"]["measured"]["parameters"]) > 10
    found = invoked("commission", *common, "--interval", "0.1")
    assert found.exit_code == 0, found.output
    request = Dossier.open(folder).request
    assert (request.currents, request.seas, request.samples, request.seed) == ((0.3,), (0.2,), 5, 7)
    assert (request.interval, request.minutes, request.tank) == (0.1, 4.0, "8x5x2")
    found = invoked("commission", "double_blueye", *common)
    assert found.exception and "another folder" in str(found.exception)


@pytest.mark.system
def test_a_tank_that_is_too_small_stops_on_paper(tmp_path):
    found = invoked("commission", "double_blueye", "--link", "twin://", "--tank", "1x1x0.5", "-o", tmp_path / "c",
                    "--yes", "--json")  # fmt: skip
    assert found.exit_code == 1
    page = json.loads(found.stdout)["stages"][0]
    assert page["state"] == "no-go"
    assert any(c["what"] == "tank" and c["verdict"] == "stop" for c in page["outcome"]["checks"])
