"""Programs of flights that are kept between processes: that they are those which would be compiled, and give the same.

The check (`ROVTWIN_CHECK_KEPT`) traces although a program is kept, and compares the two. What a user may change is
composed one after the other with one cache: where two need different programs and had one key, the second is refused.
"""

import subprocess
import sys

import numpy as np
import pytest

from rovtwin.core.numerics import jax
from rovtwin.core.programs import kept
from rovtwin.core.programs.compiled import Compiled
from rovtwin.runs import loop
from rovtwin.runs.compose.composition import compose
from rovtwin.scenario.files import list_scenarios, load_scenario

pytestmark = pytest.mark.system

CHANGES: list[tuple[str, list[str]]] = [
    ("lawnmower_calm", []),
    ("lawnmower_calm", ["autopilot=model_based"]),
    ("lawnmower_calm", ["seed=7"]),
    ("lawnmower_calm", ["rates.control=100"]),
    ("lawnmower_calm", ["world.current=[0.1,0,0]"]),
    ("lawnmower_calm", ["world.surface=true"]),
    ("lawnmower_calm", ["vehicle=bluerov2_heavy"]),
    ("lawnmower_calm", ["vehicle=bluerov2_heavy", "autopilot=model_based"]),
    ("lawnmower_calm", ["sensors.position.rate_hz=2"]),
    ("lawnmower_calm", ["sensors.position.noise=0.1"]),
    ("lawnmower_calm", ["autopilot=model_based", "autopilot.guidance.steering=los"]),
    ("lawnmower_waves", []),
    ("lawnmower_sea", []),
]


def programs(scenario):
    """Keys and sources of the programs that begin and advance a flight, lowered and not compiled."""
    run = compose(scenario)
    loop_, memory = jax.eval_shape(
        lambda *given: loop._begin(*given, control_dt=scenario.control_dt), run.loop, run.key, run.start
    )
    found = {}
    for program, given, static in (
        (loop._start, (run.loop, run.key, run.start), {"control_dt": scenario.control_dt}),
        (loop._advance[True], (loop_, memory, np.asarray(0)), {"control_dt": scenario.control_dt, "ticks": 50}),
    ):
        assert isinstance(program, Compiled)
        key = kept.key_of(program, given, static)
        jax.clear_caches()
        lowered = program._jit(program._whole).trace(*given, **static).lower()
        found[program._function.__name__] = key, lowered.as_text()
    return found


def test_flights_with_one_key_have_one_program_whatever_a_user_changes():
    """The audit over all reference scenarios and what is changed in them; nothing is compiled."""
    seen: dict[str, str] = {}
    shipped = [(one, []) for one in list_scenarios()]
    for name, overrides in [*CHANGES, *shipped]:
        for what, (key, source) in programs(load_scenario(name, overrides)).items():
            assert key is not None, f"{name} {overrides}: {what} is not kept"
            assert seen.setdefault(key, source) == source, f"{name} {overrides}: {what} has the key of another program"
    assert len({*seen.values()}) > 20  # there was something to tell apart


def test_the_next_process_flies_the_same_to_the_last_bit(tmp_path, monkeypatch):
    script = (
        "import sys, numpy as np, rovtwin\n"
        "flight = rovtwin.fly('lawnmower_calm', overrides=['autopilot=thesis', 'duration=2'], say=lambda line: None)\n"
        "np.save(sys.argv[1], flight.log['truth/eta'].values)\n"
        "print(any(m.startswith(('matplotlib', 'pandas', 'xarray', 'scipy.optimize', 'nicegui')) for m in sys.modules))"
    )
    monkeypatch.setenv("ROVTWIN_CACHE", str(tmp_path / "cache"))
    heavy = []
    for name, checked in (("first", ""), ("second", ""), ("checked", "1")):
        monkeypatch.setenv("ROVTWIN_CHECK_KEPT", checked)
        done = subprocess.run(
            [sys.executable, "-c", script, str(tmp_path / f"{name}.npy")], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        heavy.append(done.stdout.split()[-1])
    first, second, checked = (np.load(tmp_path / f"{name}.npy") for name in ("first", "second", "checked"))
    assert first.tobytes() == second.tobytes() == checked.tobytes() and len(first) > 10
    assert heavy[1] == "False"  # a cached flight loads none of what takes long to import
    assert {file.name.split("-")[0] for file in (tmp_path / "cache" / "programs").iterdir()} >= {
        "begin",
        "advance_flat",
    }
