"""Recording: a vehicle's readings into a log, whoever steers it."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rovtwin.core.datum import utc_now
from rovtwin.core.link import Link, Source
from rovtwin.core.log import LogWriter
from rovtwin.core.sensors import SENSORS
from rovtwin.live.readiness import SensorMux
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.sensors import kinds_on_board
from rovtwin.runs.interrupt import Interrupt
from rovtwin.runs.pace import Clock
from rovtwin.runs.recording.channels import sensor_channel
from rovtwin.runs.recording.provenance import beginning
from rovtwin.scenario.files import dump_scenario
from rovtwin.scenario.schema import Scenario

EVERY = 0.01  # until the next look where nothing has come [s of the vehicle's time]


def record(
    scenario: Scenario,
    link: Link,
    sources: Sequence[Source],
    clock: Clock,
    path: Path,
    duration: float | None = None,
    progress: Callable[[float], None] = lambda t: None,
    warn: Callable[[str], None] = lambda line: None,
) -> dict[str, int]:
    """Write what link and sources measure until Ctrl-C or for `duration` [s]; the number of readings by sensor.

    There is a channel for each kind of sensor, and for each further one of a kind that is on board. A reading of
    another is left out, and `warn` gets a line about it once.

    Raises:
        ConfigError: The scenario's sensors do not fit its vehicle.
        LinkError: The vehicle is lost; what came before is in the log.
        LogError: The file cannot be written.
    """
    counts: Counter[str] = Counter()
    kinds = SENSORS | kinds_on_board(scenario, vehicle_of(scenario))
    left_out: set[str] = set()
    channels = [sensor_channel(name, kind) for name, kind in kinds.items()]
    metadata = {"name": scenario.name, "scenario": dump_scenario(scenario), "live": "true"}
    metadata |= beginning(scenario, utc_now())
    with LogWriter(path, channels, metadata) as log, Interrupt() as interrupt:
        mux = SensorMux(link, sources)
        mux.drain()
        mux.zero = began = clock()
        log.annotate(beginning(scenario, utc_now()))
        shown = 0.0
        while not interrupt.asked and (duration is None or clock() - began < duration):
            readings = mux.read()
            for reading in readings:
                if reading.sensor in kinds:
                    log.write(f"sensor/{reading.sensor}", clock() - began, np.append(reading.value, reading.t_valid))
                    counts[reading.sensor] += 1
                elif reading.sensor not in left_out:
                    left_out.add(reading.sensor)
                    warn(f"{reading.sensor}: received, but left out of the log: {scenario.name} has no such sensor")
            if clock() - began - shown > 1.0:
                shown = clock() - began
                progress(shown)
            # A twin computes one period a look, so whoever rested after each would fall behind a fast clock.
            if not readings:
                time.sleep(EVERY / max(clock.speed, 1.0))
    return dict(counts)
