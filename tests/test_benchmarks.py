"""The benchmarks run, and the NumPy closed loop they compare with does the same as the compiled one."""

import json

import numpy as np
import pytest
from benchmarks import run
from benchmarks.closed_loop import same_flight


@pytest.mark.slow
def test_compiled_loop_flies_like_plain_numpy():
    """Dive, turn, go, reach and turn again: 30 s apart by less than 0.1 mm, in truth and in estimate.

    The NumPy loop shares no equation with the package, so this is a test of the whole chain too.
    """
    compiled, plain = same_flight(30.0)
    assert compiled.shape == plain.shape == (1500, 6)
    np.testing.assert_allclose(compiled, plain, atol=1e-4)
    assert np.ptp(plain[:, 0]) > 1.0 and np.ptp(plain[:, 1]) > 1.0 and np.ptp(plain[:, 2]) > 0.1  # it went places


@pytest.mark.slow  # compiles every benchmark
def test_quick_run_writes_figures_and_prints_them(tmp_path, capsys):
    out = tmp_path / "bench" / "figures.json"
    parts = ["single_vehicle", "closed_loop", "latency"]
    assert run.main(["--quick", "--out", str(out), "--only", *parts]) == 0
    results = json.loads(out.read_text())
    assert set(results) == {"machine", "quick", *parts} and results["quick"] is True
    assert results["single_vehicle"]["ratio"]["median"] > 1
    assert results["closed_loop"]["ratio"]["median"] > 1
    assert 0 < results["latency"]["median_s"] <= results["latency"]["p99_s"]
    assert {"cpu", "cores", "python", "jax", "numpy", "rovtwin"} <= set(results["machine"])
    printed = capsys.readouterr().out
    assert "RK4 steps/s" in printed and "QUICK" in printed


@pytest.mark.slow
def test_every_part_runs(tmp_path, capsys):
    rest = [name for name in run.PARTS if name not in ("single_vehicle", "closed_loop", "latency")]
    assert run.main(["--quick", "--out", str(tmp_path / "b.json"), "--only", *rest]) == 0
    assert len(capsys.readouterr().out.splitlines()) > len(rest)


def test_unknown_part_is_refused(capsys):
    with pytest.raises(SystemExit) as error:
        run.main(["--only", "sped"])
    assert error.value.code == 2
    assert "single_vehicle" in capsys.readouterr().err
