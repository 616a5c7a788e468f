"""The result as an object: tables, draws, predictions, figures, and one file that is the same to the last bit."""

import re
import warnings
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import jax
import netCDF4
import numpy as np
import pytest
import xarray
from tests.identification.synthetic import record, steps_command

import rovtwin
from rovtwin.core.errors import ConfigError, IdentificationError, LogError
from rovtwin.identification.diagnostics.validation import Prediction
from rovtwin.identification.diagnostics.verdict import Blind
from rovtwin.identification.diagnostics.whiteness import Residuals
from rovtwin.identification.identify import identify
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.nodes import Nodes
from rovtwin.identification.joint.solver.problem import Noise, Unknowns
from rovtwin.identification.joint.uncertainty.unmodelled import Effects
from rovtwin.identification.result import Identification
from rovtwin.report.identification.html import write_identification_report
from rovtwin.vehicle import Vehicle, load_vehicle
from rovtwin.vehicle.physics.model import Model

pytestmark = pytest.mark.system

FREE = [
    "added_mass.surge",
    "*_damping.yaw",
    "added_mass.surge_pitch",
    "restoring.net_buoyancy",
    "thrusters.*.dead_band",
]
JOINT = Path(__file__).parents[2] / "docs" / "identification" / "joint.md"


def same(a, b):
    """Equal in every value and type, to the last bit."""
    if isinstance(a, Model):
        assert jax.tree.structure(a) == jax.tree.structure(b)
        a, b = ([np.asarray(leaf) for leaf in jax.tree.leaves(x)] for x in (a, b))
    if isinstance(a, Vehicle):
        a, b = ((v.to_dict(), v.where, v.water_density, v.pairs_apart) for v in (a, b))
    if isinstance(a, np.ndarray):
        assert a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    elif is_dataclass(a):
        assert type(a) is type(b)
        for one in fields(a):
            same(getattr(a, one.name), getattr(b, one.name))
    elif isinstance(a, dict):
        assert list(a) == list(b)
        for key in a:
            same(a[key], b[key])
    elif isinstance(a, list | tuple):
        assert type(a) is type(b) and len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            same(one, other)
    else:
        assert type(a) is type(b) and (a == b or a != a)


@pytest.fixture(scope="module")
def log():
    vehicle = load_vehicle("double_blueye")
    return replace(record(vehicle.model(), *steps_command(vehicle, 0, 8.0), 8.0, water_density=1025.0), name="held")


@pytest.fixture(scope="module")
def run(log):
    """A whole run of `identify`, without a fit: the prior, and what it says of a held-out log."""
    vehicle = load_vehicle("double_blueye").in_water(1025.0)
    return identify(vehicle, [], validate=[log], free=FREE, options={"window": 2.0})


@pytest.fixture(scope="module")
def found(run):
    """The same as if there had been a fit, with numbers that have no short decimals. `test_joint` has one that is."""
    rng, n = np.random.default_rng(0), len(run.theta)
    A = rng.standard_normal((n, n))
    covariance, theta = 1e-4 * (A @ A.T + np.eye(n)), 0.05 * rng.standard_normal(n)
    nodes = Nodes(*(rng.standard_normal((3, k)) for k in (3, 4, 6, 6)))
    offsets = {"gyro": 1e-3 * rng.standard_normal(3), "depth": np.zeros(1)}
    unknowns = Unknowns(theta, np.concatenate(list(offsets.values())), nodes)
    noise = Noise(rng.uniform(size=4), rng.uniform(size=18))
    effects = Effects(
        ("drag", "loss"), ("1", "s/m"), rng.standard_normal(2), np.eye(2) / 3, rng.standard_normal((n, 2))
    )
    solution = Solution(
        unknowns, noise, covariance, np.eye(n), np.full(4, 1e-3), np.ones(n), 4, True, 7, 1234.5678, effects=effects
    )
    left = Residuals(np.arange(5) / 3, np.zeros(5, int), rng.standard_normal(5), 0.1 / 3, np.zeros(25), 0.05, 1.0)
    return replace(
        run, theta=theta, covariance=covariance, solution=solution, offsets=offsets, residuals={"gyro.p": left},
        verdicts=["learnt", "partly", "prior only", *["learnt"] * (n - 3)], findings=["narrow: 0.3 %, ± 2 µm"],
        blind=[Blind((run.parameters.names[0],), (1.0,), 0.1 / 3, "the scale of all forces")],
        tested={"surge": (-0.1 / 3, 0.2)}, doubts=["it has not settled"], seconds=1.0 / 3,
    )  # fmt: skip


@pytest.fixture
def saved(found, tmp_path):
    return found.save(tmp_path / "identified.nc")


def test_what_was_saved_is_the_same_to_the_last_bit(found, saved):
    again = Identification.load(saved)
    records = [r | {"source": Path(r["source"]).name} for r in found.records]
    same(replace(found, records=records), again)
    same(found.file(), again.file())
    same(found.sampled(3), again.sampled(3))
    assert repr(again) == repr(found) and "not to be relied on" in repr(again) and len(repr(again)) < 120


def test_xarray_opens_the_file_unasked(found, saved):
    with xarray.open_dataset(saved) as data:
        assert data["covariance"].dims == ("parameter", "parameter_2")
        np.testing.assert_array_equal(data["theta"].sel(parameter="added_mass.surge"), found.theta[0])


def test_a_result_without_tests_is_kept_too(run, tmp_path):
    bare = replace(run, held_out=[], records=[])
    same(bare, Identification.load(bare.save(tmp_path / "predicted.nc")))


def test_nothing_is_overwritten_unasked(found, saved):
    with pytest.raises(LogError, match="exists already"):
        found.save(saved)
    found.save(saved, overwrite=True)


@pytest.mark.slow
def test_a_loaded_result_has_a_report(saved, tmp_path):
    page = write_identification_report(Identification.load(saved), tmp_path / "report").read_text()
    assert "Whiteness" in page and "it has not settled" in page


def test_the_summary_is_what_the_file_says_in_the_parameters_units(found):
    table = found.summary()
    for row in found.file()["identified"]["estimate"]["parameters"]:
        text = table.loc[row["name"]]
        assert (text["unit"], text["verdict"]) == (row["unit"], row["verdict"])
        assert text["estimate"] == pytest.approx(row["value"], rel=1e-7)
        p = next(p for p in found.parameters.free if p.name == row["name"])
        assert text["sd"] == pytest.approx(row["std"] * p.slope(row["value"]), rel=1e-6)
        assert text["prior_mean"] == pytest.approx(row["base"], rel=1e-7)
        assert text["prior_sd"] == pytest.approx(row["prior_std"] * p.slope(row["base"]), rel=1e-6)
        assert text["low_95"] < text["estimate"] < text["high_95"]
    assert table.loc["added_mass.surge", "unit"] == "kg"
    known = found.summary(truth={"added_mass.surge": 31.0})["truth"]
    assert known["added_mass.surge"] == 31.0 and known.isna().sum() == len(table) - 1
    with pytest.raises(IdentificationError, match=r"truth: 'added_mass.surg' .* Did you mean 'added_mass.surge'"):
        found.summary(truth={"added_mass.surg": 31.0})


def test_frame_and_data_set_hold_the_same(found):
    data, table = found.to_xarray(), found.to_pandas()
    for name in table.columns.drop("unit"):
        np.testing.assert_array_equal(data[name], table[name])
    np.testing.assert_array_equal(data["theta_covariance"], found.covariance)
    np.testing.assert_allclose(np.sqrt(np.diag(data["covariance"])), table["sd"])
    np.testing.assert_allclose(np.sqrt(np.diag(data["prior_covariance"])), table["prior_sd"])
    assert data.sel(parameter="restoring.net_buoyancy")["unit"] == "N"
    assert data.attrs["vehicle"] == "double_blueye" and data.attrs["logs"] == "held (held out, 8 s)"
    assert data.attrs["rovtwin_version"] == rovtwin.__version__


def test_draws_have_the_covariance_of_the_estimate(found):
    draws = found.draws(20_000, seed=1, chains=2)
    assert dict(draws.sizes) == {"chain": 2, "draw": 20_000}
    free = found.parameters.free
    theta = np.array([[p.theta(float(x)) for x in draws[p.name].values.ravel()] for p in free])
    L = np.linalg.cholesky(found.covariance)
    np.testing.assert_allclose(np.linalg.solve(L, np.linalg.solve(L, np.cov(theta)).T), np.eye(len(free)), atol=0.04)
    np.testing.assert_allclose(theta.mean(axis=1), found.theta, atol=0.03 * found.std.max())
    assert draws["added_mass.surge"].attrs["units"] == "kg"
    same(draws["added_mass.surge"].values, found.draws(20_000, seed=1, chains=2)["added_mass.surge"].values)
    with pytest.raises(IdentificationError, match="n: found 0, expected 1 or more"):
        found.draws(0)


def test_a_prediction_is_that_of_the_run(run, log, tmp_path):
    again = Identification.load(run.save(tmp_path / "identified.nc"))
    for window, expected in zip((None, 2.0), run.held_out, strict=True):
        (prediction,) = again.predict(log, window)
        same(prediction, expected)


def test_a_log_of_a_vehicle_with_other_thrusters_is_refused(found, log):
    wrong = replace(log, command=log.command[:, :3], source="three.csv")
    with pytest.raises(
        IdentificationError, match="three.csv: found commands of 3 thrusters, expected 6 as double_blueye"
    ):
        found.predict(wrong)


def test_a_log_of_several_tests_is_drawn_one_at_a_time(found, log):
    with pytest.raises(IdentificationError, match=r"found 2 tests \(held, held\), expected one; draw one of them"):
        found.plot_prediction([log, log])


def test_a_notebook_shows_each_parameter(found):
    shown = found._repr_html_()
    assert repr(found)[1:-1] in shown and shown.count("<tr") > len(found.theta)
    assert found.plot("added_mass.surge").get_yticklabels()[0].get_text() == "added mass, surge"


def test_figures_are_drawn_without_a_warning(found, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        axes = found.plot_intervals(truth={"added_mass.surge": 31.0})
        axes.figure.savefig(tmp_path / "intervals.png")
        # No couplings unasked.
        assert len(axes.get_yticks()) == len(found.theta) - 1
        assert "added mass, surge pitch" not in [label.get_text() for label in axes.get_yticklabels()]
        found.plot_correlations().figure.savefig(tmp_path / "correlations.png")
        panels = found.plot_prediction(found.held_out[0])
        panels[0].figure.savefig(tmp_path / "prediction.png")
    assert panels.shape == (len(found.held_out[0].scores),)
    (tick,) = found.plot_intervals("added_mass.surge_pitch").get_yticklabels()
    assert tick.get_text() == "added mass, surge pitch"
    assert found.plot_correlations(["added_mass.*"]).images[0].get_array().shape == (2, 2)
    with pytest.raises(IdentificationError, match=r"names: 'damping.\*' fits no parameter"):
        found.plot_intervals(["damping.*"])


def cut_short(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def without_an_array(path):
    with netCDF4.Dataset(path, "a") as file:
        file["solution"].renameVariable("sigma", "sigmas")


def of_another_model(path):
    with netCDF4.Dataset(path, "a") as file:
        file["model"].renameVariable("buoyancy", "lift")


def of_another_version(path):
    with netCDF4.Dataset(path, "a") as file:
        file.setncatts({"format_version": np.int32(3), "source": "rovtwin 9.0.0"})


def of_something_else(path):
    path.unlink()
    with netCDF4.Dataset(path, "w") as file:
        file.title = "rovtwin log run.mcap"


@pytest.mark.parametrize(
    ("spoiled", "message"),
    [
        (Path.unlink, "found no such file, expected a saved identification"),
        (lambda path: path.write_text("name: rov"), "found no netCDF file, expected .* such as identified.nc"),
        (cut_short, r"found a damaged file, or one that was cut short .* copy it once more, or run rovtwin identify"),
        (without_an_array, r"found a damaged file, or one that was cut short \(KeyError: 'sigma'\)"),
        (of_another_model, "identified.nc: model: found arrays .* differ in buoyancy, lift; read the file with the"),
        (of_another_version, "found version 3 of the format, written by rovtwin 9.0.0, expected version 2"),
        (of_something_else, "found a netCDF file titled 'rovtwin log run.mcap' that is no identification"),
    ],
)  # fmt: skip
def test_a_bad_file_is_refused_in_words(saved, spoiled, message):
    spoiled(saved)
    with pytest.raises(IdentificationError, match=f"identified.nc: .*{message}" if "model" not in message else message):
        Identification.load(saved)


@pytest.mark.parametrize(("package", "asked"), [("pandas", "summary"), ("xarray", "to_xarray"), ("xarray", "draws")])
def test_a_missing_package_is_named_with_its_extra(found, monkeypatch, package, asked):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == package else SimpleNamespace())
    with pytest.raises(ConfigError, match=rf"needs {package}: pip install 'rovtwin\[notebook\]'"):
        getattr(found, asked)()


def test_the_code_of_the_page_runs(run, log, tmp_path, monkeypatch):
    (code,) = re.findall(r"```python\n(.*?)```", JOINT.read_text(), re.S)
    run.save(tmp_path / "identified.nc")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rovtwin.identification.logs.readers.read_records", lambda path, vehicle: [log])
    monkeypatch.setattr("rovtwin.identification.result.identification.open_loop", lambda *args: run.held_out[:1])
    names: dict = {}
    exec(code, names)
    assert isinstance(names["prediction"], Prediction) and (tmp_path / "intervals.png").stat().st_size > 5000
