"""The face that all public results share: tables, arrays with units, a figure, a file, HTML; and their examples."""

import doctest
import inspect
import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pandas
import pyarrow as pa
import pytest
import xarray
from matplotlib.axes import Axes

import rovtwin
from rovtwin.campaign.rows import SCORES, table_schema
from rovtwin.campaign.schema import Campaign, complete
from rovtwin.campaign.tuning.cost import Cost
from rovtwin.campaign.tuning.parameters import chosen, start_of
from rovtwin.campaign.tuning.result import Judged, Tuned, TuningRequest
from rovtwin.campaign.tuning.search import Search
from rovtwin.core.arrays.key_frames import KeyFrames
from rovtwin.core.notebook import Result
from rovtwin.gnc.navigation.smoother import Smoothed
from rovtwin.identification.experiment.choice import Expected
from rovtwin.planning.plan import Plan
from rovtwin.planning.rehearsal import Rehearsed
from rovtwin.runs.smooth import SmoothedRun, _log_of

PAGE = Path(__file__).parents[1] / "docs" / "notebook.md"
RNG = np.random.default_rng(1)
FACE = ("figures_table", "remarks", "summary", "to_pandas", "to_xarray", "plot", "save", "load", "_repr_html_")
NEED_FILES = {"CampaignSession", "Plan", "SmoothedRun", "Tuned"}  # or minutes: their examples are shown, not run
NEED_LOGS = {"predict", "plot_prediction"}
ENDINGS = {"Log": "mcap", "Flight": "mcap", "Vehicle": "yaml", "Scenario": "yaml", "CampaignSession": "parquet"}


def flown():
    return rovtwin.fly("square", overrides=["duration=0.2"], say=lambda line: None)


def simulated():
    return rovtwin.simulate("double_blueye", {"port.surge": [0.5] * 20, "starboard.sway": [0.3] * 20})


def planned():
    n, p, k = 9, 4, 2
    data = {"name": "planned_test", "test": {"name": "planned", "manoeuvres": [{"manoeuvre": "rest", "duration": 1}]}}
    scenario = rovtwin.load_scenario(data | {"world": {"floor": 2.0, "tank": {"north": [-3, 3], "east": [-2, 2]}}})
    path = [np.cumsum(RNG.normal(size=(n, m)), axis=0) for m in (3, 4, 6)]
    rehearsed = Rehearsed(scenario, 0.02 * np.arange(n), *path, RNG.uniform(-1, 1, (n, 6)), [], None)
    sd, names = RNG.uniform(0.1, 1.0, p), [f"added_mass.{one}" for one in ("surge", "sway", "heave", "yaw")]
    ones = np.ones(p)
    hopes = Expected(names, ones, ones > 0, ones, sd, np.array([1.0, 2.5]), RNG.uniform(size=(k, p)))
    model = rovtwin.load_vehicle("double_blueye").model()
    return Plan(
        scenario,
        hopes,
        0.9 * sd,
        0.7,
        rehearsed,
        0.4,
        np.array([2.0, 1.0, 1.2]),
        (30, 20),
        ["pull ahead", "turn"],
        ["too narrow"],
        model,
    )


def smoothed():
    n = 40
    shapes = {"eta": 6, "nu": 6, "std": 9, "filtered": 6}
    keys = KeyFrames(
        *(RNG.uniform(0.1, 1.0, shape) for shape in ((2,), (2, 3), (2, 4), (1, 31, 31), (2, 31, 31), (6, 31))),
        ("attitude.heading",),
        *(RNG.uniform(0.1, 1.0, shape) for shape in ((2, 6, 1), (1,), (1,), (1, 1), (1,))),
    )
    arrays = (RNG.uniform(0.1, 1.0, (n, m)) for m in shapes.values())
    track = Smoothed(0.02 * np.arange(n), *arrays, RNG.uniform(0.1, 1.0, (n, 6, 6)), keys)
    return SmoothedRun(track, _log_of(track, rovtwin.Log({}, {"version": "0"})), RNG.uniform(size=(2, 2)))


def tuned():
    scenario = rovtwin.load_scenario("square")
    tunables = chosen(["control.bandwidth.surge", "control.damping_ratio"])
    section = start_of(scenario)
    search = Search(
        [RNG.normal(size=2) for _ in range(5)], [1.0, 0.9, np.inf, 0.8, 0.85], [0, 0, 0, 1, 1], np.zeros(2), "budget"
    )
    scores = [{"completed": True, "phase": "finished", "depth_rms_m": 0.1, "pair": (0.1, None)} for _ in range(3)]
    judged = Judged(["calm", "calm", "waves"], scores, scores, np.array([1.0, 1.1, 0.9]), np.array([0.8, 0.9, 0.85]))
    request = TuningRequest(scenario, tunables, ["calm"], {"path": 1.0})
    cost = Cost({"path": 1.0}, {"calm": {"path": 0.1}})
    influence = {one.name: 0.1 for one in tunables}
    return Tuned(
        request, "the prior", section, cost, search, 1.0, ("best", 1.0, 0.8), influence, judged, {"search": 12.5}
    )


def campaigned():
    vary = {"world.net_buoyancy": {"distribution": "uniform", "low": 0.0, "high": 1.0}}
    campaign = complete(
        Campaign.model_validate({"scenario": "square", "samples": 3, "vary": vary, "set": {"duration": 5}})
    )
    row = {"phase": "finished", "reason": "", "lanes": 1, "began": 1.7e9, "wall_s": 2.0, "cpu_s": 2.0, "seed": 7}
    rows = [
        row | {"index": i, "completed": i > 0, "world.net_buoyancy": 0.1 * i} | dict.fromkeys(SCORES, 0.2 + i)
        for i in range(3)
    ]
    rows[0] |= {"reason": "geofence", "depth_rms_m": None}
    table = pa.Table.from_pylist(rows, schema=table_schema(campaign))
    return rovtwin.CampaignSession(Path("runs/many"), campaign, table, 3, 6.5, "this process")


MADE = {
    "CampaignSession": campaigned,
    "Flight": flown,
    "Identification": lambda: rovtwin.identify("double_blueye"),
    "Log": lambda: flown().log,
    "Plan": planned,
    "Scenario": lambda: rovtwin.load_scenario("square", ["duration=20"], seed=4),
    "SmoothedRun": smoothed,
    "Trajectory": simulated,
    "Tuned": tuned,
    "Vehicle": lambda: rovtwin.load_vehicle("double_blueye"),
}


def flying(name):
    """Marks of what a flight is needed for, which takes seconds."""
    return [pytest.mark.system] if name in ("Flight", "Log") else []


@pytest.fixture(scope="module", params=[pytest.param(one, marks=flying(one)) for one in MADE])
def result(request):
    return MADE[request.param]()


def kind(result):
    return type(result).__name__


def same(one, other):
    """Equal in every number, to the last bit, and in every word."""
    if isinstance(one, rovtwin.Log):
        return one.equal_data(other) and one.metadata == other.metadata
    if isinstance(one, rovtwin.Flight):  # a flight that is read has its vehicle written out, and no folder
        return same(one.log, other.log) and one.figures == other.figures and one.scenario.name == other.scenario.name
    if isinstance(one, rovtwin.Vehicle):
        return one.to_dict() == other.to_dict()
    if isinstance(one, pa.Table | rovtwin.Scenario | Campaign):
        return one.equals(other) if isinstance(one, pa.Table) else one == other
    if is_dataclass(one) and not isinstance(one, rovtwin.Model):
        left_out = {"problem", "seconds"} if isinstance(one, rovtwin.Identification) else set()
        names = [f.name for f in fields(one) if f.name not in left_out]
        return type(one) is type(other) and all(same(getattr(one, n), getattr(other, n)) for n in names)
    if isinstance(one, rovtwin.Model):
        return all(np.array_equal(a, b) for a, b in zip(leaves(one), leaves(other), strict=True))
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, dict):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple):
        return type(one) is type(other) and len(one) == len(other) and all(map(same, one, other))
    return one == other or one != one


def leaves(model):
    from rovtwin.core.numerics import jax

    return [np.asarray(leaf) for leaf in jax.tree.leaves(model)]


@pytest.mark.system
def test_the_page_runs(tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(code, names)
    assert {path.name for path in tmp_path.iterdir()} == {"path.png", "flight.mcap", "identified.nc"}
    listed = set(re.findall(r"^\| `\w+` \|.*?`(\w+)`\]?\S* ?[|,]", PAGE.read_text(encoding="utf-8"), re.M))
    assert listed | {"Log"} == set(MADE)


def test_every_result_that_is_public_is_here():
    public = {getattr(rovtwin, name) for name in rovtwin.__all__ if isinstance(getattr(rovtwin, name), type)}
    assert {one.__name__ for one in public if issubclass(one, Result)} == set(MADE)


def test_it_is_a_result_with_the_whole_face(result):
    assert isinstance(result, Result)
    for name in FACE:
        assert callable(getattr(result, name)) and getattr(type(result), name).__module__ != "builtins"
    line = repr(result)
    assert line.startswith("<") and line.endswith(">") and "\n" not in line and len(line) < 250


def test_summary_and_table_are_frames_with_rows(result):
    summary, table = result.summary(), result.to_pandas()
    assert isinstance(summary, pandas.DataFrame) and len(summary) and summary.index.name
    assert isinstance(table, pandas.DataFrame) and len(table) and table.index.name is not None


def test_arrays_have_dimensions_coordinates_and_units(result):
    found = result.to_xarray()
    sets = [found] if isinstance(found, xarray.Dataset) else [node.dataset for node in found.subtree if node.data_vars]
    assert sets and sum(len(one.data_vars) for one in sets) > 2
    for one in sets:
        for name, variable in one.data_vars.items():
            assert "units" in variable.attrs or variable.dtype.kind in "OUT", name
            assert set(variable.dims) <= set(one.coords), f"{name}: a dimension without coordinates"
        if "time" in one.dims:
            assert one["time"].attrs["units"] == "s" and (np.diff(one["time"]) >= 0).all()


def test_a_figure_needs_no_display(result, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    axes = result.plot()
    assert isinstance(axes, Axes) and axes.get_xlabel()
    axes.figure.savefig(tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 3000
    assert axes.lines or axes.collections or axes.patches


def test_a_notebook_shows_a_heading_and_a_table(result):
    shown = result._repr_html_()
    assert shown.startswith("<div>") and "<table" in shown and shown.count("<tr") >= 3


def test_saved_and_loaded_it_is_the_same(result, tmp_path):
    path = tmp_path / f"result.{ENDINGS.get(kind(result), 'nc')}"
    assert result.save(path) == path
    again = type(result).load(path)
    assert type(again) is type(result) and same(result, again)
    assert same(type(result).load(again.save(tmp_path / f"again{path.suffix}")), again)


def test_nothing_is_overwritten_unasked(result, tmp_path):
    path = tmp_path / f"result.{ENDINGS.get(kind(result), 'nc')}"
    path.write_text("mine")
    with pytest.raises(rovtwin.LogError, match="exists already"):
        result.save(path)
    assert path.read_text() == "mine"
    result.save(path, overwrite=True)
    assert same(result, type(result).load(path))
    with pytest.raises(rovtwin.LogError, match="[Cc]reate (it|the folder) first"):
        result.save(tmp_path / "nowhere" / path.name)


def test_a_file_that_cannot_be_it_is_refused_in_words(result, tmp_path):
    load = type(result).load
    path = tmp_path / f"result.{ENDINGS.get(kind(result), 'nc')}"
    missing = tmp_path / f"resul.{path.suffix}"
    result.save(path)
    for wrong, words in ((missing, "no such|not found|no file"), (other(tmp_path), "found|starts with|no such key")):
        with pytest.raises(rovtwin.RovtwinError, match=words) as caught:
            load(wrong)
        assert wrong.name in str(caught.value)
    cut(path)
    with pytest.raises(rovtwin.RovtwinError) as caught:
        load(path)
    assert path.name in str(caught.value)


def other(folder):
    """A file of another kind: text that is YAML."""
    path = folder / "other.txt"
    path.write_text("nothing: of the kind\n")
    return path


def cut(path):
    """A file that was cut short; of text, one that says what no vehicle and no scenario has."""
    content = path.read_bytes()
    path.write_bytes(b"nonsense: 1\n" + content if path.suffix == ".yaml" else content[: len(content) // 2])


def test_a_saved_result_of_another_kind_is_named(tmp_path):
    path = simulated().save(tmp_path / "path.nc")
    with pytest.raises(
        rovtwin.LogError, match=r"path.nc: found a saved Trajectory, expected a SmoothedRun; rovtwin.Traj"
    ):
        rovtwin.SmoothedRun.load(path)
    with pytest.raises(
        rovtwin.IdentificationError, match=r"path.nc: found a netCDF file titled 'Trajectory of double_b"
    ):
        rovtwin.Identification.load(path)


def test_a_log_of_no_flight_is_named(tmp_path):
    from rovtwin.core.log import Channel

    log = rovtwin.Log.from_arrays([Channel("depth", ("z",), "m", "n")], {"depth": ([0.0], [[1.0]])})
    with pytest.raises(rovtwin.LogError, match=r"depth.mcap: found a log without the scenario of a run.*Log.load"):
        rovtwin.Flight.load(log.save(tmp_path / "depth.mcap"))


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ({"class": "os:system", "fields": {}}, "os:system is no class of rovtwin"),
        ({"named": "rovtwin.cli.__main__:main", "items": []}, "rovtwin.cli.__main__:main is no class"),
        ({"class": "rovtwin.console.worker:Worker", "fields": {}}, "is no class of rovtwin that a result holds"),
        ({"class": "rovtwin.simulation.__main__:Trajectory", "fields": {}}, "is no class of rovtwin that"),
        ({"class": "rovtwin.simulation.roll_out:Stored", "fields": {}}, "rovtwin.simulation.roll_out:Stored is no"),
        ({"class": "rovtwin.core.stored:Path", "fields": {}}, "rovtwin.core.stored:Path is no object"),
        ({"tuple": [1]}, "it holds tuple"),
        ({"class": 3}, "AttributeError"),
    ],
)
def test_a_file_names_no_code_but_that_of_results(tmp_path, words, why):
    import json

    import netCDF4

    path = simulated().save(tmp_path / "path.nc")
    with netCDF4.Dataset(path, "a") as file:
        file["words"][...] = np.array(json.dumps(words), dtype=object)
    with pytest.raises(rovtwin.LogError, match=why):
        rovtwin.Trajectory.load(path)


@pytest.mark.parametrize(
    ("about", "why"),
    [
        (b"{", "JSONDecodeError"),
        (b"[]", "TypeError"),
        (b"{}", "KeyError"),
        (b'{"campaign": []}', "found a list of 0 values, expected a mapping"),
        ({"folder": None}, "TypeError"),
        ({"flown": "many"}, "ValueError"),
        ({"flown": float("inf")}, "OverflowError"),
        ({"wall_s": []}, "TypeError"),
    ],
)
def test_a_saved_campaign_with_forged_words_is_refused(tmp_path, about, why):
    import json

    import pyarrow.parquet as pq

    path = campaigned().save(tmp_path / "many.parquet")
    table = pq.read_table(path)
    if isinstance(about, dict):
        about = json.dumps(json.loads(table.schema.metadata[b"rovtwin_campaign"]) | about).encode()
    pq.write_table(table.replace_schema_metadata({b"rovtwin_campaign": about}), path)
    with pytest.raises(rovtwin.RovtwinError, match=f"many.parquet: .*{why}"):
        rovtwin.CampaignSession.load(path)


def test_a_saved_campaign_without_its_columns_is_refused(tmp_path):
    import pyarrow.parquet as pq

    path = campaigned().save(tmp_path / "many.parquet")
    pq.write_table(pq.read_table(path).drop_columns("completed"), path)
    with pytest.raises(rovtwin.LogError, match="many.parquet: found a damaged file.*completed"):
        rovtwin.CampaignSession.load(path)


def test_a_vehicle_in_other_water_is_not_saved_as_if_it_were_not(tmp_path):
    with pytest.raises(rovtwin.ConfigError, match="water of another density, which a vehicle file does not hold"):
        rovtwin.load_vehicle("double_blueye").in_water(1025.0).save(tmp_path / "salt.yaml")


def test_channels_of_a_log_keep_their_clocks_and_repeated_times():
    from rovtwin.core.log import Channel

    channels = [Channel("a", ("x",), "m", ""), Channel("a/b", ("x", "y"), ("m", "s"), "n")]
    data = {"a": ([0.0, 1.0, 1.0], [[1.0], [2.0], [3.0]]), "a/b": ([0.5, 1.0], [[4.0, 5.0], [6.0, 7.0]])}
    log = rovtwin.Log.from_arrays(channels, data)
    tree, frame = log.to_xarray(), log.to_pandas()
    assert tree["a_/x"].values.tolist() == [1.0, 2.0, 3.0] and tree["a/b/y"].attrs["units"] == "s"
    assert frame.index.tolist() == [0.0, 0.5, 1.0, 1.0] and frame["a", "x"].dropna().tolist() == [1.0, 2.0, 3.0]


def methods():
    for name in MADE:
        of = getattr(rovtwin, name)
        yield pytest.param(name, of, id=name, marks=flying(name))
        for method in dir(of):
            what = getattr(of, method)
            shown = not method.startswith("_") and callable(what) and ">>>" in (what.__doc__ or "")
            if method in FACE[:-1] or shown:
                yield pytest.param(name, what, id=f"{name}.{method}", marks=flying(name))


@pytest.fixture(scope="module")
def names():
    """What the example of a class leaves for those of its methods, by the class."""
    return {}


@pytest.mark.parametrize(("name", "what"), list(methods()))
def test_every_method_has_an_example_that_runs(name, what, names, tmp_path, monkeypatch):
    """Examples of methods begin with what the example of their class has made."""
    assert ">>>" in (inspect.getdoc(what) or ""), f"{name}: {what} has no example"
    monkeypatch.chdir(tmp_path)
    if name not in names:
        names[name] = {"rovtwin": rovtwin}
        of = doctest.DocTestFinder(recurse=False).find(getattr(rovtwin, name), name, globs=names[name])[0]
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(of, clear_globs=False)
        names[name] = of.globs
    (test,) = doctest.DocTestFinder(recurse=False).find(what, name, globs=names[name])
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    assert runner.run(test).failed == 0
    assert runner.tries > 0 or name in NEED_FILES or what.__name__ in NEED_LOGS, "an example that no test runs"
