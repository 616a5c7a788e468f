"""XLA's banner about slow compiling is kept off the terminal, and nothing else is."""

import subprocess
import sys

import pytest

from rovtwin.core.processes.quiet import Banner

WORDS = b"""E1125 03:10:00.0 77 slow_operation_alarm.cc:73]
********************************
[Compiling module jit_advance for CPU] Very slow compile? If you want to file a bug, run with envvar XLA_FLAGS
********************************
E1125 03:10:09.0 77 slow_operation_alarm.cc:140] The operation took 2m9.5s

********************************
[Compiling module jit_advance for CPU] Very slow compile? If you want to file a bug, run with envvar XLA_FLAGS
********************************
"""
ERROR = b"E1125 03:10:10.0 77 cpu_compiler.cc:90] out of memory\n"

# Events as JAX tells them around a compilation, and what XLA writes in between, by C and by Python.
CODE = """
import os, sys, time
from jax import monitoring
from rovtwin.core.processes import quiet
quiet.Quiet.__init__.__defaults__ = (0.05,)
from rovtwin.core import numerics
monitoring.record_event(quiet.BEGINS)
time.sleep(0.5)
os.write(2, {written!r})
print("python", file=sys.stderr)
monitoring.record_event_duration_secs(quiet.ENDS, 1.0)
os.write(2, b"after\\n")
"""


def test_banner_is_left_out_and_errors_stay():
    banner = Banner()
    kept = [line for line in (b"***\n" + ERROR + WORDS + ERROR).splitlines(keepends=True) if banner.passes(line)]
    assert kept == [b"***\n", ERROR, ERROR]


@pytest.mark.system
def test_what_xla_writes_while_it_compiles_loses_its_banner_only():
    code = CODE.format(written=ERROR + WORDS)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, timeout=60, check=True)
    lines = done.stderr.splitlines(keepends=True)
    assert sorted(lines[:-1]) == sorted([ERROR, b"python\n"]) and lines[-1] == b"after\n"


@pytest.mark.system
def test_jax_tells_of_a_compilation():
    """The names of the events, which JAX does not promise; without them the banner is seen again."""
    code = """
import os
from jax import monitoring
from rovtwin.core.processes import quiet
from rovtwin.core.numerics import jax
told = []
monitoring.register_event_listener(lambda event, **_: told.append(event))
monitoring.register_event_duration_secs_listener(lambda event, _, **__: told.append(event))
jax.jit(lambda x: x * 3 + 1)(2.0)
assert quiet.BEGINS in told and quiet.ENDS in told[told.index(quiet.BEGINS):], told
"""
    subprocess.run([sys.executable, "-c", code], timeout=60, check=True)
