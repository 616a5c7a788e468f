"""Campaigns flown: kept as they come, gone on with, killed, spread, and every sample again to the last bit."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from rovtwin.campaign import store
from rovtwin.campaign.replay import sample_of
from rovtwin.campaign.reporting import write_report
from rovtwin.campaign.rows import row_of, table_schema
from rovtwin.campaign.run import Progress, run_campaign
from rovtwin.campaign.samples import draws, scenario_at
from rovtwin.campaign.schema import load_campaign
from rovtwin.campaign.shares import share_interval
from rovtwin.campaign.store import Store, read_table
from rovtwin.campaign.summary import column, summarise, wall_time
from rovtwin.campaign.workers import Dask, at_scheduler, on_slurm, on_this_machine
from rovtwin.core.errors import ConfigError
from rovtwin.runs.fly import fly

pytestmark = pytest.mark.system

FILE = {
    "scenario": "lawnmower_waves",
    "samples": 4,
    "set": {"autopilot": "thesis", "duration": 2, "world.mismatch": True},
    "vary": {
        "world.current.velocity[1]": {"distribution": "uniform", "low": -0.1, "high": 0.1},
        "world.net_buoyancy": {"distribution": "choice", "values": [0, 1, -100_000], "weights": [4, 4, 1]},
    },
    "seed": 20,  # of samples 0 to 11 one, 3, cannot be flown: it has no buoyancy
}


@pytest.fixture(scope="session")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("campaign") / "short.yaml"
    path.write_text(yaml.safe_dump(FILE))
    return path


@pytest.fixture(scope="session")
def campaign(file):
    return load_campaign(file)


@pytest.fixture(scope="session")
def session(campaign, tmp_path_factory):
    """Two samples, then four, by this process."""
    folder = tmp_path_factory.mktemp("results") / "short"
    texts: list[Progress] = []
    first = run_campaign(campaign.model_copy(update={"samples": 2}), folder, on_this_machine(1), progress=texts.append)
    assert first.flown == first.table.num_rows == 2 and first.whole
    assert [(p.done, p.samples) for p in texts] == [(0, 2), (1, 2), (2, 2)] and texts[0].left_s is None
    whole = run_campaign(campaign, folder, on_this_machine(1))
    assert whole.flown == 2 and whole.table.slice(0, 2).equals(first.table)
    return whole


def test_every_sample_has_one_row(session, campaign):
    rows = session.table.to_pylist()
    assert [row["index"] for row in rows] == [0, 1, 2, 3] and session.whole
    for row in rows:
        assert row.items() >= draws(campaign, row["index"]).items()
    assert {path.name for path in session.folder.iterdir()} >= {"campaign.yaml", "samples.parquet", "parts"}
    assert not list((session.folder / "parts").iterdir())


def test_a_sample_is_flown_again_to_the_last_bit(session, campaign):
    flight = fly(scenario_at(*sample_of(f"{session.folder}/1")), short=0)
    row = session.table.slice(1, 1).to_pylist()[0]
    assert row.items() >= row_of(1, draws(campaign, 1), flight.figures).items()
    assert row["reason"].startswith("not finished after 2 s: ") and not row["completed"]


def test_a_sample_that_cannot_be_flown_says_why_and_stops_no_other(session):
    bad = session.table.slice(3, 1).to_pylist()[0]
    assert bad["world.net_buoyancy"] == -100_000 and bad["reason"].startswith("world.net_buoyancy: found -100000 N")
    assert bad["effort_n2s"] is None and np.isfinite(column(session.table, "effort_n2s")[:3]).all()


def test_nothing_is_flown_twice(session, campaign):
    again = run_campaign(campaign, session.folder, on_this_machine(1))
    assert again.flown == 0 and again.table.equals(session.table)


def test_another_campaign_is_refused_with_the_difference(session, campaign):
    for changes, message in (({"seed": 7}, r"seed \(there 20, here 7\)"), ({"vary": {}}, r"vary\.")):
        with pytest.raises(ConfigError, match=f"holds another campaign.*{message}"):
            Store(session.folder, campaign.model_copy(update=changes))


def test_another_version_and_another_process_are_refused(session, campaign, monkeypatch):
    with Store(session.folder, campaign), pytest.raises(ConfigError, match="another process flies this campaign"):
        Store(session.folder, campaign)
    monkeypatch.setattr(store, "__version__", "9.9")
    with pytest.raises(ConfigError, match=r"made with rovtwin .*, this is 9\.9"):
        Store(session.folder, campaign)


def test_a_kill_between_writing_the_whole_and_deleting_its_parts_leaves_nothing_twice(session, campaign, tmp_path):
    (tmp_path / "parts").mkdir()
    for name in ("samples.parquet", "parts/0000001-1.parquet"):
        pq.write_table(session.table if "/" not in name else session.table.slice(1, 1), tmp_path / name)
    (tmp_path / "parts" / ".0000002-1.parquet.writing").write_bytes(b"half a file")
    assert read_table(tmp_path, table_schema(campaign)).equals(session.table)


def test_ctrl_c_keeps_what_is_flown(campaign, tmp_path):
    def stop(now: Progress) -> None:
        if now.flown == 1:
            signal.raise_signal(signal.SIGINT)

    stopped = run_campaign(campaign, tmp_path, on_this_machine(1), progress=stop)
    assert stopped.flown == 1 and not stopped.whole and stopped.table["index"].to_pylist() == [0]
    assert summarise(campaign, stopped.table)["flown"] == 1


def test_a_report_of_real_rows(session):
    page = write_report(session).read_text()
    assert page.index("What did not complete") < page.index("Distribution of the scores")
    assert f"rovtwin fly --replay {session.folder}/3" in page and "Clopper-Pearson" in page


def test_summary_of_known_rows(campaign, session):
    text = summarise(campaign, session.table)
    assert text["completed"] == 0 and text["completed_interval"][1] == pytest.approx(1 - 0.025 ** (1 / 4))
    assert text["reasons"]["not finished after 2 s"] == 3
    assert share_interval(50, 100) == pytest.approx((0.398, 0.602), abs=1e-3)  # Clopper and Pearson's own table
    assert wall_time(session.table) == pytest.approx(np.sum(column(session.table, "wall_s")), rel=1e-6)


def test_places_that_hold_no_sample_are_refused(session):
    for place, message in (
        ("3", "DIR/INDEX"),
        ("nowhere/3", "no campaign.yaml"),
        (f"{session.folder}/4", "samples 0 to 3"),
    ):
        with pytest.raises(ConfigError, match=message):
            sample_of(place)


def test_slurm_without_its_package_and_a_scheduler_that_is_not_there(monkeypatch):
    monkeypatch.setattr("rovtwin.campaign.workers.installed", lambda name: False)
    with pytest.raises(ConfigError, match="dask-jobqueue"), on_slurm(2):
        pass
    monkeypatch.setattr("rovtwin.campaign.workers.CONNECT", "1s")
    with pytest.raises(ConfigError, match="nobody answers there"), at_scheduler("tcp://127.0.0.1:9"):
        pass


def _command(file, folder, workers) -> list[str]:
    words = ["campaign", str(file), "--out", str(folder), "--samples", "12", "--workers", str(workers)]
    return [sys.executable, "-m", "rovtwin.cli", *words, "--no-report", "--json"]


def _until_some_are_kept(folder, process, count=2):
    deadline = time.monotonic() + 900  # a busy machine compiles for minutes
    while len(list((folder / "parts").glob("*.parquet"))) < count:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("how", "workers"), [(signal.SIGKILL, 1), (signal.SIGINT, 2)])
def test_killed_in_the_middle_it_goes_on_where_it_was(file, campaign, tmp_path, how, workers):
    """Ctrl-C reaches all processes of a terminal, so the signal goes to the whole group."""
    folder = tmp_path / "killed"
    process = subprocess.Popen(
        _command(file, folder, workers),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    _until_some_are_kept(folder, process)
    os.killpg(process.pid, how)
    out, err = process.communicate(timeout=600)
    assert process.returncode == (-signal.SIGKILL if how == signal.SIGKILL else 1), err
    kept = read_table(folder, table_schema(campaign))
    assert 2 <= kept.num_rows < 12
    assert "Traceback" not in err
    if how == signal.SIGINT:
        assert json.loads(out)["flown"] == kept.num_rows
    done = subprocess.run(_command(file, folder, 1), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["flown_now"] == 12 - kept.num_rows
    whole = read_table(folder, table_schema(campaign))
    assert whole["index"].to_pylist() == list(range(12))
    assert set(kept["began"].to_pylist()) <= set(whole["began"].to_pylist())  # not flown again


@pytest.mark.slow
def test_two_dask_workers_one_of_them_killed(campaign, session, tmp_path):
    """Complete, nothing twice, and the same numbers as one process gives."""
    from distributed import Client, LocalCluster

    more = campaign.model_copy(update={"samples": 10})
    killed = []
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs="CRITICAL"
    ) as cluster:

        def kill_one(now: Progress) -> None:
            if now.flown >= 2 and not killed:
                with Client(cluster) as client:
                    killed.append(next(iter(client.run(os.getpid).values())))
                os.kill(killed[0], signal.SIGKILL)

        spread = run_campaign(more, tmp_path, at_scheduler(cluster.scheduler_address), progress=kill_one)
    assert killed and spread.whole and spread.flown == 10 and "dask workers at tcp" in spread.by
    assert spread.table["index"].to_pylist() == list(range(10))
    cost = ["began", "wall_s", "cpu_s"]
    assert spread.table.slice(0, 4).drop_columns(cost).equals(session.table.drop_columns(cost))


@pytest.mark.slow
def test_side_by_side_agrees_with_one_after_the_other(campaign, session, tmp_path):
    batch = run_campaign(campaign, tmp_path, on_this_machine(1), lanes=2)
    for name in ("effort_n2s", "position_error_rms_m", "thruster_activity_n_per_s", "bound_surge_m"):
        np.testing.assert_allclose(column(batch.table, name), column(session.table, name), rtol=1e-9)
    assert set(column(batch.table, "lanes")) == {2}


@pytest.mark.slow
def test_processes_of_this_machine(campaign, session, tmp_path):
    with on_this_machine(2) as crew:
        assert isinstance(crew, Dask) and crew.cores == 2
    spread = run_campaign(campaign, tmp_path, on_this_machine(2))
    assert spread.table["effort_n2s"].equals(session.table["effort_n2s"])


def test_a_campaign_that_is_refused_says_so_and_fails(tmp_path):
    """It said "missions flown" and ended with 0."""
    path = tmp_path / "swept.yaml"
    changes = {"autopilot": "model_based", "world.current.velocity[0]": 5.0}
    path.write_text(yaml.safe_dump({"scenario": "lawnmower_calm", "samples": 2, "set": changes, "vary": {}}))
    command = [
        sys.executable,
        "-m",
        "rovtwin.cli",
        "campaign",
        str(path),
        "--out",
        str(tmp_path / "out"),
        "--no-report",
    ]
    ended = subprocess.run([*command, "--workers", "1"], capture_output=True, text=True, check=False)
    assert ended.returncode == 1, ended.stderr
    assert "swept: 1 core, " in ended.stderr, "there is no terminal for a bar"
    assert "2 of 2 were refused, none of them was flown" in ended.stdout and "missions flown" not in ended.stdout
