"""Runs: the same twice, the same in a batch, tick by tick and from their own file; logged as they were."""

import json
import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import PHASES
from rovtwin.core.log import Log
from rovtwin.core.notebook import html_table
from rovtwin.core.programs.compiled import in_one_piece
from rovtwin.runs import loop as loops
from rovtwin.runs.batch import score_batch, score_seeds
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.fly import fly
from rovtwin.runs.loop import HostLoop, advance, advance_batch, stack, start_batch, start_loop
from rovtwin.runs.run import chunks, realtime_chunks
from rovtwin.scenario.files import load_scenario
from rovtwin.scenario.schema.world import MismatchSection


@pytest.fixture(scope="module")
def flight(short, tmp_path_factory):
    return fly(short, tmp_path_factory.mktemp("runs") / "first")


def joined(records):
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *records)


@pytest.mark.system
def test_a_run_leaves_log_scenario_and_summary(flight):
    assert {path.name for path in flight.folder.iterdir()} == {"log.mcap", "scenario.yaml", "summary.json"}
    log = Log.read(flight.folder / "log.mcap")
    assert json.loads(log.metadata["summary"]) == json.loads((flight.folder / "summary.json").read_text())
    assert log["truth/eta"].t[-1] == pytest.approx(12.0)
    assert log["truth/eta"].values[0] == pytest.approx([0, 0, 0.5, 0, 0, 0])
    assert {"seed", "version", "python", "jax", "vehicle_table", "created"} <= set(log.metadata)


@pytest.mark.system
def test_a_run_shows_its_figures_and_its_path_in_a_notebook(flight):
    assert repr(flight).startswith("<Flight of short, seed 1: not completed: not finished after 12 s")
    shown = flight._repr_html_()
    for text in ("short, seed 1: not completed", "<th style='text-align:left'>duration</th><td>12 s</td>", "N/s"):
        assert text in shown
    assert "<script>" not in html_table("<script>", [("<script>", 1.0, "<script>")], ["<script>"])
    assert max(len(line.get_xdata()) for line in flight.plot().lines) > 100


@pytest.mark.system
def test_sensors_are_logged_at_their_own_rates_without_repeats(flight):
    counts = {name: len(flight.log[f"sensor/{name}"]) for name in ("position", "pressure", "gyro")}
    assert counts == {"position": 12, "pressure": 12 * 42, "gyro": 1200}
    for name in counts:
        stamps = flight.log[f"sensor/{name}"]["t_valid"]
        assert np.all(np.diff(stamps) > 0)


@pytest.mark.system
def test_the_same_scenario_and_seed_give_the_same_data_bit_for_bit(flight, short, tmp_path):
    assert flight.log.equal_data(fly(short, tmp_path / "again").log)


@pytest.mark.system
def test_another_seed_gives_other_data(flight, short):
    other = fly(short.model_copy(update={"seed": 2}))
    assert not flight.log.equal_data(other.log)


@pytest.mark.system
def test_the_written_scenario_flies_the_same_run(flight, tmp_path):
    replayed = fly(load_scenario(flight.folder / "scenario.yaml"), tmp_path / "replayed")
    assert flight.log.equal_data(replayed.log)


@pytest.mark.system
def test_a_run_in_memory_is_the_run_on_disk(flight, short):
    assert flight.log.equal_data(fly(short).log)


@pytest.mark.system
def test_progress_says_when_a_long_run_is_compiled_again(short):
    seen = []
    fly(short, progress=lambda t, phase: seen.append((round(t), "compiling" in phase)), short=150)
    assert [t for t, again in seen if again] == [3] and len(seen) > 10


@pytest.mark.system
def test_a_run_never_overwrites_another(flight, short):
    with pytest.raises(ConfigError, match="exists already"):
        fly(short, flight.folder)


@pytest.mark.system
def test_tick_by_tick_through_a_link_is_the_compiled_run(short):
    """The same blocks in a Python loop on a host that comes late: what the vehicle does agrees to rounding."""
    simulation = compose(short)
    run = (simulation.loop, simulation.key, simulation.start, short.control_dt, 4.0)
    now, calls = [0.0], []

    def late(seconds: float) -> None:
        """Sleep of a host that oversleeps by five periods now and then."""
        calls.append(seconds)
        now[0] += seconds + (0.1 if len(calls) % 37 == 0 else 0.0)

    compiled, ticked = (
        joined(list(chunks(*run))),
        joined(list(realtime_chunks(*run, clock=lambda: now[0], sleep=late))),
    )
    assert len(compiled.water_velocity) == len(ticked.water_velocity) == 201
    for one, other in zip(jax.tree.leaves(compiled.state), jax.tree.leaves(ticked.state), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    np.testing.assert_array_equal(compiled.measurements["gyro"].valid, ticked.measurements["gyro"].valid)


@pytest.mark.system
def test_a_long_run_goes_on_with_the_optimised_program_where_it_was(short, monkeypatch):
    """The only test of the optimised program: the others turn that off for all (tests/conftest.py)."""
    static = {"static_argnames": ("ticks", "control_dt"), "donate_argnames": "memory"}
    as_users_have_it: dict[str, bool | int] = {"xla_backend_optimization_level": 3}
    as_users_have_it["xla_llvm_disable_expensive_passes"] = False
    if "xla_cpu_use_fusion_emitters" in os.environ["XLA_FLAGS"]:
        as_users_have_it["xla_cpu_use_fusion_emitters"] = True
    optimised = in_one_piece(loops._advance_flat, compiler_options=as_users_have_it, **static)
    monkeypatch.setitem(loops._advance, False, optimised)
    run = compose(short)
    given = run.loop, run.key, run.start, short.control_dt, 50
    flown = [
        joined([host.advance() for _ in range(4)]) for host in (HostLoop(*given, short=k) for k in (0, 100, 10**9))
    ]
    for other in flown[1:]:
        for one, two in zip(jax.tree.leaves(flown[0].state), jax.tree.leaves(other.state), strict=True):
            np.testing.assert_allclose(two, one, atol=1e-9)


@pytest.mark.slow
def test_a_batch_agrees_with_single_runs_to_1e9_over_a_minute_of_calm_water():
    scenario = load_scenario("lawnmower_calm", ["autopilot=thesis"])
    dt, ticks, n = scenario.control_dt, 50, 60
    runs = [compose(scenario.model_copy(update={"seed": seed})) for seed in (1, 2)]
    loops = stack([run.loop for run in runs])
    batch = start_batch(loops, stack([run.key for run in runs]), stack([run.start for run in runs]), control_dt=dt)
    singles = [start_loop(run.loop, run.key, run.start, control_dt=dt) for run in runs]
    for i in range(n):
        batch, records = advance_batch(loops, batch, jnp.asarray(i * ticks), ticks=ticks, control_dt=dt)
        for j, run in enumerate(runs):
            singles[j], record = advance(run.loop, singles[j], jnp.asarray(i * ticks), ticks=ticks, control_dt=dt)
            for one, many in zip(jax.tree.leaves(record.state), jax.tree.leaves(records.state), strict=True):
                np.testing.assert_allclose(many[j], one, atol=1e-9)


@pytest.mark.slow
def test_a_batch_ends_each_run_where_it_ends():
    calm = load_scenario("lawnmower_calm", ["autopilot=thesis", "duration=12"])
    scores = score_batch(calm, [1, 2])
    assert [s["seed"] for s in scores] == [1, 2]
    for batched, single in zip(scores, score_seeds(calm, [1, 2]), strict=True):
        for key in ("duration_s", "position_error_rms_m", "effort_n2s"):
            assert batched[key] == pytest.approx(single[key], rel=1e-6)
        assert batched["phase"] in PHASES and not batched["completed"]
        assert batched["reason"].startswith("not finished after 12 s: ")
        assert batched["reason"] == single["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lawnmower_calm", "lawnmower_hard", "lawnmower_dropout"])
def test_whole_missions_have_the_same_verdict_alone_and_in_a_batch(name):
    scenario = load_scenario(name, ["autopilot=thesis_placed"])
    verdicts = [
        [(run["seed"], run["phase"], run["reason"], round(run["duration_s"])) for run in scores(scenario, [1, 2, 3])]
        for scores in (score_seeds, score_batch)
    ]
    assert verdicts[0] == verdicts[1]


@pytest.mark.system
def test_the_log_and_the_summary_of_a_mismatch_hold_what_was_drawn(short, flight, tmp_path):
    """Else nobody could check the intervals of an identification against the vehicle that flew."""
    assert flight.log.metadata["mismatch"] == "" and flight.figures["mismatch"] is None
    scenario = short.model_copy(update={"world": short.world.model_copy(update={"mismatch": MismatchSection()})})
    wrong = fly(scenario, tmp_path / "wrong")
    simulation = compose(scenario)
    data = json.loads(wrong.log.metadata["mismatch"])
    assert data == wrong.figures["mismatch"] == json.loads((wrong.folder / "summary.json").read_text())["mismatch"]
    assert (data["mass"], data["thrust"]) == (pytest.approx(1.1), pytest.approx(0.9))
    truth, model = simulation.loop.twin.model, simulation.model
    ratio = truth.quadratic_damping_astern[1, 1] / model.quadratic_damping_astern[1, 1]
    assert data["quadratic_damping_astern.sway"] == pytest.approx(ratio) != pytest.approx(1.0)


def test_a_limit_aborts_with_its_reason_and_thrusters_off(short):
    scenario = load_scenario(
        "lawnmower_waves", ["autopilot=thesis", "duration=12", "autopilot.supervisor.attitude_limit_deg=0.005"]
    )
    flight = fly(scenario)
    assert flight.figures["phase"] == "aborted" and flight.figures["reason"] == "attitude limit"
    assert not flight.completed and flight.figures["duration_s"] < 12
    assert np.all(flight.log["autopilot/command"].values[-1] == 0.0)


@pytest.mark.system
def test_a_dead_thruster_is_felt(short):
    sound = fly(short).log["truth/thrust"]
    faulty = fly(
        short.model_copy(update={"world": short.world.model_copy(update={"thruster_health": {"port.heave": 0}})})
    )
    thrust = faulty.log["truth/thrust"]
    assert np.max(np.abs(sound["port_heave"])) > 0.1
    assert np.max(np.abs(thrust["port_heave"])) == 0.0 and np.max(np.abs(thrust["starboard_heave"])) > 0.1


@pytest.mark.system
def test_scores_do_not_depend_on_what_is_logged(flight, short):
    sparse = fly(short.model_copy(update={"log": short.log.model_copy(update={"rate": 1, "sensors": False})}))
    assert sparse.figures == flight.figures
    assert len(sparse.log["truth/eta"]) == 13 and "sensor/gyro" not in sparse.log


def test_an_unknown_thruster_is_named(short):
    world = short.world.model_copy(update={"thruster_health": {"port.heav": 0}})
    with pytest.raises(ConfigError, match="no thruster 'port.heav'"):
        compose(short.model_copy(update={"world": world}))
