import json
import re
import time
from html.parser import HTMLParser

import numpy as np
import pytest
from tests.report.synthetic import synthetic

from rovtwin.core.datum import Datum
from rovtwin.core.log import Channel, Log
from rovtwin.report import write_comparison, write_report
from rovtwin.report.flight import Flight
from rovtwin.report.run.tables import mission_table, sensor_table
from rovtwin.report.run.vehicle import vehicle_tables
from rovtwin.report.run.verdict import scores, verdict

pytestmark = pytest.mark.system


class Page(HTMLParser):
    """Links, texts and open tags of a page."""

    def __init__(self, text):
        super().__init__()
        self.links, self.texts, self.tags, self.open = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for key, value in attrs if key in ("src", "href", "srcset", "action", "data")]
        if tag not in ("meta", "img", "br", "link", "input"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)

    @property
    def text(self):
        return re.sub(r"\s+", " ", " ".join(self.texts))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def page(folder):
    return Page(write_report(synthetic(dt=0.5), folder).read_text())


def test_page_needs_no_network(page, folder):
    outside = [link for link in page.links if not link.startswith(("data:image/png;base64,", "#", "figures/"))]
    assert outside == []
    assert "script" not in page.tags and "link" not in page.tags
    source = (folder / "report.html").read_text()
    assert "@import" not in source and "url(" not in source and "http" not in re.sub(r"base64,[^\"]*", "", source)


def test_page_is_well_formed(page):
    assert page.open == []


def test_links_lead_somewhere(page, folder):
    source = (folder / "report.html").read_text()
    for link in page.links:
        if link.startswith("figures/"):
            assert (folder / link).is_file()
        if link.startswith("#"):
            assert f'id="{link[1:]}"' in source


def test_figures_as_png_and_svg_of_moderate_size(folder, page):
    png, svg = sorted((folder / "figures").glob("*.png")), sorted((folder / "figures").glob("*.svg"))
    assert [p.stem for p in png] == [p.stem for p in svg] and len(png) == 11
    assert all(p.stat().st_size < 1e6 for p in (*png, *svg))
    assert (folder / "report.html").stat().st_size < 5e6
    assert all(p.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" for p in png)
    assert all("<svg" in p.read_text()[:2000] for p in svg)


def test_page_says_what_happened(page):
    assert "Completed in 187 s" in page.text
    assert "rovtwin fly" in page.text and "scenario.yaml" in page.text
    assert "What this report lacks" not in page.text
    assert "port_surge" in page.text and "lawnmower_waves" in page.text


def test_vehicle_has_symbols_and_units(page):
    for words in (
        "mass m 30 kg",
        "center of gravity r_g 0, 0, 0.017 m",
        "M_RB, rigid body mass [kg, kg m; kg m, kg m2]",
    ):
        assert words in page.text
    assert "natural periods, roll 5.8 s" in page.text and "natural periods, heave - s" in page.text
    assert "top speed [m/s] coasting time [s] surge ahead 20 0.36 -" in page.text
    assert "moment [N m] top speed [deg/s] coasting time [s] yaw port 5.6 47.4 6.1" in page.text
    assert "X_udot = -20.95 kg X_u = -4.4 N s/m" in page.text and "position [m]" in page.text


def parameters(**found):
    """Words of the vehicle's tables in other water, by what the log says of both."""
    log = synthetic(dt=2.0)
    log.metadata["vehicle_table"] = json.dumps(found)
    log.metadata["scenario"] = "world:\n  water: {density: 1025.0, temperature: null, salinity: null}\n"
    return [
        " ".join(cell for row in [table.head, *table.rows] for cell in row) for table in vehicle_tables(Flight(log))
    ]


def test_vehicle_says_which_water():
    (text,) = parameters(water_density_kgm3=1000.0, weight_N=300.0, buoyancy_N=294.0, net_buoyancy_N=-6.0)
    assert "water density, as the file describes it ρ 1000 kg/m³ water density, in the water flown ρ 1025 kg/m³" in text
    assert "net buoyancy, as the file describes it  -6 N net buoyancy, in the water flown  1.35 N" in text


def test_units_of_tethers_and_batteries():
    tethers, batteries = parameters(
        mass_kg=30.0,
        tethers=[{"name": "one", "wet_weight_N_per_m": 0.1}],
        batteries=[{"name": "port", "capacity_Wh": 75.0, "hotel_load_W": 20.0}],
    )[1:]
    assert "wet weight [N/m]" in tethers and "capacity [Wh] hotel load [W]" in batteries


def test_way_points_to_the_millimetre():
    log = synthetic(dt=2.0)
    log.metadata["mission"] = json.dumps([{"position": [6.01934033, 1.645e-12, 2.5]}])
    table = mission_table(Flight(log))
    assert table is not None and table.rows == [["1", "6.019", "0", "2.5"]]


def test_rates_are_counted(page):
    # acoustic: 1 Hz; its nominal rate is the same, its delay 50 ms
    assert re.search(r"position north, east \[m\] \d+ 1 1 1 50\.0", page.text)
    assert re.search(r"pressure depth \[m\] \d+ 42 42 0\.0238 0\.0", page.text)


def test_delays_over_a_link_are_not_known():
    log = synthetic(dt=2.0)
    log.metadata["live"] = "true"
    table = sensor_table(Flight(log))
    assert table is not None and {row[-1] for row in table.rows} == {"not known"} and "Over a link" in table.note


@pytest.mark.slow
def test_map_coordinates_where_the_log_has_a_datum(tmp_path, page):
    assert "On the map" not in page.text and "Latitude" not in page.text
    log = synthetic(dt=0.5)
    log.metadata["datum"] = Datum(63.45, 10.36).metadata()
    placed = Page(write_report(log, tmp_path).read_text())
    assert "it began at 63.45000" in placed.text and "the clock's zero is 2021-06-01T10:00:00Z" in placed.text
    first = 63.45 + np.degrees(6 / 6.387e6)  # way-point 1 is 6 m north; the meridian's radius there is 6,387 km
    assert f"{first:.7f}" in placed.text and "North and east from 63.450000° N, 10.360000° E, WGS 84." in placed.text
    assert "datum 63.450000° N, 10.360000° E, water level 0 m" in placed.text
    assert "63.45000" in (tmp_path / "figures" / "path.svg").read_text()


def test_same_report_from_a_log_file(tmp_path):
    log = synthetic(dt=1.0)
    kept = ("truth/eta", "autopilot/mode", "score/cross_track")
    short = Log.from_arrays(
        [log.channels[name] for name in kept], {name: (log[name].t, log[name].values) for name in kept}, log.metadata
    )
    first = write_report(short, tmp_path).read_text()
    again = write_report(Log.read(short.write(tmp_path / "log.mcap")), tmp_path).read_text()
    assert "Figure 3." in Page(first).text
    # What differs is the format, which only a file names.
    assert [line for line in again.splitlines() if "<td>log_format</td>" not in line] == [
        line for line in first.splitlines() if "<td>log_format</td>" not in line
    ]


def test_names_are_escaped(tmp_path):
    evil = '<script>alert("x")</script>'
    channel = Channel("truth/eta", ("x", "y", "z", "phi", "theta", "psi"), "m", "n")
    summary = {"completed": False, "phase": "aborted", "reason": evil}
    table = {"name": evil, evil: 1, "parts": [{evil: evil}]}
    mission = [{"position": [0, 0, 0], "hold_time": evil}]
    metadata = {"name": evil, "scenario": evil, "seed": evil, "summary": json.dumps(summary)}
    metadata |= {"vehicle_table": json.dumps(table), "mission": json.dumps(mission)}
    t = np.arange(5.0)
    log = Log.from_arrays([channel], {"truth/eta": (t, np.ones((5, 6)) * t[:, None])}, metadata)
    path = write_report(log, tmp_path)
    assert evil not in path.read_text()
    assert Page(path.read_text()).text.count(evil) >= 6
    path = write_comparison({evil: log}, [(evil, evil, evil, evil)], tmp_path / "b", title=evil)
    assert evil not in path.read_text()


def test_report_of_nearly_nothing(tmp_path):
    log = Log.from_arrays([Channel("truth/eta", ("x", "y", "z", "phi", "theta", "psi"), "m", "n")], {})
    text = Page(write_report(log, tmp_path).read_text()).text
    assert "no channel that a figure could be made of" in text
    assert "has no truth/eta or autopilot/eta" in text and "Scenario: the log's metadata has none" in text


# The verdict


def with_summary(**summary):
    log = synthetic(dt=1.0)
    series = {name: (log[name].t, log[name].values) for name in log.channels}
    return Flight(Log.from_arrays(log.channels.values(), series, {"summary": json.dumps(summary)}))


def test_verdict_names_the_reason():
    found = verdict(with_summary(completed=False, phase="aborted", reason="estimate lost", duration_s=61.2))
    assert found.good is False and found.headline == "Aborted after 61 s: estimate lost"


def test_verdict_of_a_run_that_ran_out_of_time():
    found = verdict(with_summary(completed=False, phase="go", reason="", duration_s=1500.0))
    assert found.good is False and found.headline == "Not completed: stopped after 1500 s in phase “go”"
    why = "way-point 3 of 7 was not reached: from 212 s the vehicle stayed 0.7 m east of it"
    reason = f"not finished after 1500 s: {why}"
    found = verdict(with_summary(completed=False, phase="go", reason=reason, duration_s=1500.0))
    assert found.headline == "Not completed: stopped after 1500 s in phase “go”"
    assert found.sentences[0] == f"W{why[1:]}."


def test_verdict_without_summary_is_read_from_the_phases():
    found = verdict(with_summary())
    assert found.good is True and found.headline.startswith("Completed in ") and found.scores == []


def test_a_stall_that_comes_again_is_described_once():
    stalls = [{"t": t, "what": f"no headway for {s} s, at way-point 2 of 7", "cause": f"{s} N push it"}
              for t, s in ((215.1, 31), (446.0, 32), (565.2, 33))]  # fmt: skip
    lost = {"t": 300.0, "what": "returning", "cause": "link lost"}
    found = verdict(with_summary(decisions=[*stalls, lost, lost | {"t": 400.0, "cause": "battery"}]))
    text = " ".join(found.sentences)
    assert text.count("no headway") == 1 and "(31 N push it); again at 446, 565 s." in text
    assert "returning (link lost)." in text and "returning (battery)." in text


@pytest.mark.parametrize(
    ("mean", "words"),
    [(95.0, "overconfident, its errors are 6.9 times"), (2.1, "as sure of itself as it may be"), (0.2, "too cautious")],
)
def test_nees_in_words(mean, words):
    sentences = verdict(with_summary(nees_position_mean=mean, nees_position_interval=[1.3, 2.9])).sentences
    assert any(words in s for s in sentences)


@pytest.mark.parametrize(("error", "words"), [(0.11, "about the best"), (0.33, "3.0 times the bound")])
def test_bound_in_words(error, words):
    found = verdict(with_summary(position_error_rms_m=[error, error], bound_position_m=0.11))
    assert any(words in s for s in found.sentences)
    assert found.scores[0].beside == "bound 0.110"


def test_an_aborted_run_is_not_praised_and_its_figures_are_plain_numbers():
    """It read "to 6.37e-03 and 5.35e-03 m" and "this run was luckier than the average" in one that was broken off."""
    figures = {"position_error_rms_m": [6.37e-3, 5.38e-3], "bound_position_m": [0.018, 0.018]}
    ended, done = (
        verdict(with_summary(completed=completed, phase=phase, **figures))
        for completed, phase in ((False, "aborted"), (True, "finished"))
    )
    (text,) = [s for s in ended.sentences if "horizontal position" in s]
    assert "to 6.4 mm and 5.4 mm rms (north and east)" in text and text.endswith("is 18 mm and 18 mm.")
    assert any("luckier than the average" in s for s in done.sentences)
    rows = scores({"position_error_rms_m": [6.4e-4, 1.23e-2], "effort_n2s": 238586.6, "depth_rms_m": 5.4e-5})
    assert [row.value for row in rows] == ["0.000054", "0.00064, 0.012", "238 587"]


def test_scores_pass_over_what_is_no_number():
    rows = scores({"duration_s": "long", "effort_n2s": None, "saturated_share": 0.25, "depth_rms_m": float("nan")})
    assert {row.name: row.value for row in rows} == {
        "Depth error, rms": "not a number",
        "Share of time saturated": "25.0",
    }


def test_verdict_names_the_empty_battery_and_the_largest_pull():
    log = synthetic(dt=1.0)
    data = {name: (log[name].t, np.array(log[name].values)) for name in log.channels}
    data["truth/battery"][1][80:, 1] = 0.0
    sentences = verdict(Flight(Log.from_arrays(log.channels.values(), data, log.metadata))).sentences
    assert "Battery starboard empty at 80 s." in sentences
    assert any(s.startswith("Largest tether tension: ") for s in sentences)


# Comparison


def test_comparison(tmp_path):
    logs = {"Calm water": synthetic(dt=0.5, waves=False), "Waves": synthetic(dt=0.5, speed=0.2)}
    rows = [("It completes the mission", "yes", "yes", "no", "thesis 8.3")]
    path = write_comparison(logs, rows, tmp_path, title="Demo", reports={"Waves": "waves/report.html"})
    page = Page(path.read_text())
    assert page.open == [] and "waves/report.html" in page.links
    assert all(word in page.text for word in ("Calm water", "It completes the mission", "thesis 8.3", "Scores"))
    assert {p.name for p in (tmp_path / "figures").iterdir()} == {
        f"{name}.{kind}" for name in ("paths", "errors", "effort") for kind in ("png", "svg")
    }


def test_comparison_checks_its_rows(tmp_path):
    with pytest.raises(ValueError, match="expected statement, published, 1 measured, note"):
        write_comparison({"a": synthetic(dt=1.0)}, [("too", "short")], tmp_path)
    with pytest.raises(ValueError, match="no runs"):
        write_comparison({}, [], tmp_path)


@pytest.mark.slow
def test_long_run_stays_small_and_quick(tmp_path):
    log = synthetic(dt=0.02, speed=0.022)  # 1500 s at 50 Hz
    assert log.duration > 1450
    start = time.process_time()
    path = write_report(log, tmp_path)
    assert time.process_time() - start < 20
    assert path.stat().st_size < 5e6
    assert max(p.stat().st_size for p in (tmp_path / "figures").iterdir()) < 1e6
