"""The report of a campaign, on rows whose answers are known."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from rovtwin.report.studies.campaign import CampaignResult, draw_scatter, draw_scores, write_campaign_report


def result(n=60, **changes) -> CampaignResult:
    rng = np.random.default_rng(1)
    completed = np.arange(n) % 10 != 3
    mass = rng.normal(1, 0.1, n)
    known = {
        "title": "Campaign known", "description": "", "samples": n, "completed": completed, "interval": (0.8, 0.95),
        "scores": {
            "duration_s": np.where(completed, 200 + 20 * mass, np.nan),
            "cross_track_rms_m": np.r_[rng.gamma(4, 0.03, n - 1), 50.0] if n > 1 else np.array([0.1]),
            "energy_wh": np.full(n, np.nan),
            "saturated_share": np.zeros(n),
        },
        "varied": {"world.mismatch.mass": mass}, "scatter": ["cross_track_rms_m", "energy_wh"],
        "rank": lambda path, name: 0.5,
        "failures": [
            {"index": i, "reason": "depth limit", "world.mismatch.mass": 1.0} for i in np.flatnonzero(~completed)
        ],
        "replay": lambda index: f"rovtwin fly --replay runs/known/{index}",
        "drawn": {"world.mismatch.mass": "normal: mean 1, sd 0.1"}, "cost": [("Wall time", "1 s")],
        "provenance": [("Seed", "1")], "campaign": "name: known\n",
    }  # fmt: skip
    return CampaignResult(**(known | changes))


def test_failures_come_first_with_their_command(tmp_path):
    page = write_campaign_report(result(), tmp_path).read_text()
    assert (
        page.index("54 of 60 missions completed") < page.index("rovtwin fly --replay runs/known/3") < page.index("<img")
    )
    assert "90.0 %, 95 % interval 80.0 to 95.0 %" in page
    assert not re.search(r'(src|href)="https?:', page)
    kept = {path.name for path in (tmp_path / "figures").iterdir()}
    assert kept == {"scores.png", "scores.svg", "scatter.png", "scatter.svg"}
    ET.parse(tmp_path / "figures" / "scores.svg")


def test_scores_that_nobody_has_are_left_out_and_one_lost_mission_does_not_squeeze_the_others():
    figure = draw_scores(result())
    labels = [axes.get_xlabel() for axes in figure.axes if axes.get_xlabel()]
    assert labels == ["Duration [s]", "Cross-track error, rms [m]", "Time saturated [%]"]
    cross = next(axes for axes in figure.axes if axes.get_xlabel().startswith("Cross"))
    assert cross.get_xlim()[1] < 2.0 and "1 beyond" in cross.get_title(loc="right")


def test_scatter_shows_chosen_scores_that_are_there():
    figure = draw_scatter(result())
    (axes,) = figure.axes
    assert axes.get_xlabel() == "world.mismatch.mass" and axes.get_title(loc="right") == "rank correlation +0.50"
    assert sum(len(line.get_xdata()) for line in axes.lines) == 60


@pytest.mark.parametrize("n", [0, 1])
def test_hardly_any_samples(tmp_path, n):
    few = result(n, completed=np.ones(n, bool), failures=[], samples=5)
    if n == 0:
        few = result(0, completed=np.zeros(0, bool), failures=[], samples=5, varied={}, scores={})
    page = write_campaign_report(few, tmp_path).read_text()
    assert ("None of 5 samples is flown" if n == 0 else "4 samples are left") in page
