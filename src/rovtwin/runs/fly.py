"""Flying a scenario: run it, log it while it runs, score it, report it."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from rovtwin.core.block import Block
from rovtwin.core.errors import ConfigError, exists_already
from rovtwin.core.flow import PHASES
from rovtwin.core.log import Channel, Log, LogWriter
from rovtwin.core.log.files import keeping
from rovtwin.core.user_files.files import write_text
from rovtwin.core.user_files.jsontext import to_json
from rovtwin.runs.compose.composition import Simulation, compose
from rovtwin.runs.compose.fitting import assumptions
from rovtwin.runs.compose.sensors import assumed_sensors
from rovtwin.runs.feasibility.mission import foreseen
from rovtwin.runs.flight import Flight
from rovtwin.runs.interrupt import Interrupt
from rovtwin.runs.loop import SHORT, Record
from rovtwin.runs.recording.channels import log_channels
from rovtwin.runs.recording.provenance import provenance, scenario_to_replay
from rovtwin.runs.recording.recorder import Recorder
from rovtwin.runs.run import chunks, realtime_chunks
from rovtwin.runs.scoring.scores import Flown, distance_to_leg, nees
from rovtwin.runs.scoring.summary import summarise
from rovtwin.scenario.files import dump_scenario
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import Model

Progress = Callable[[float, str], None]  # simulated time [s], phase


def fly(
    scenario: Scenario,
    folder: str | Path | None = None,
    *,
    realtime: bool = False,
    progress: Progress | None = None,
    report: bool = False,
    camera: bool = False,
    film: bool = False,
    say: Callable[[str], None] = lambda line: None,
    refuse: bool = True,
    truth: Model | None = None,
    own: Mapping[str, Block] | None = None,
    short: int = SHORT,
) -> Flight:
    """Fly a scenario.

    Args:
        scenario: What to fly.
        folder: New folder for log, scenario and report; None keeps all in memory.
        realtime: Tick by tick by the wall clock instead of compiled.
        progress: Called about once a simulated second.
        report: Write the HTML report and the figures (needs a folder).
        camera: Record the scenario's cameras (needs a folder).
        film: Write films of them too.
        say: Told before the start what the vehicle cannot do of the mission, and what it does instead.
        refuse: Whether a mission of which it can do nothing is refused.
        truth: The vehicle as it truly is, before what the world does to it; None: as the scenario makes it.
        own: Blocks that were handed over in Python, by key of the scenario's autopilot.
        short: From this tick on the program is optimised, see `loop.SHORT`; a campaign's samples are flown with 0.

    Returns:
        The flight. Ctrl-C ends the run, not the program: what was flown is logged, scored and reported.

    Raises:
        ConfigError: The scenario cannot be composed, or its mission is refused.
        LogError: The folder cannot be written.
    """
    if realtime and (camera or film):
        raise ConfigError(f"{scenario.name}: pictures cannot be rendered by the wall clock; leave out --realtime")
    simulation = compose(scenario, truth, own=own)
    if refuse:
        for line in foreseen(simulation.scenario, simulation.vehicle, simulation.loop.twin.model):
            say(line)
        assumed = assumed_sensors(scenario, simulation.vehicle)
        for line in (*assumptions(scenario, simulation.scenario), *([assumed] if assumed else [])):
            say(line)
    scenario = simulation.scenario
    how = _How(realtime, progress, short)
    if folder is None:
        return _in_memory(scenario, simulation, how)
    folder = new_folder(folder)
    summary = _into_folder(scenario, simulation, folder, how, camera or film, film)
    flight = Flight(scenario, folder, Log.read(folder / "log.mcap"), summary)
    if report:
        from rovtwin.report import write_report

        with keeping(folder, f"The log is whole: {folder / 'log.mcap'}"):
            write_report(flight.log, folder)
    return flight


class _How(NamedTuple):
    """By the wall clock or compiled, to whom progress is reported, and from which tick on the program is optimised."""

    realtime: bool
    progress: Progress | None
    short: int


def _in_memory(scenario: Scenario, simulation: Simulation, how: _How) -> Flight:
    channels = _channels(scenario, simulation)
    pieces: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {channel.name: [] for channel in channels}
    recorder = Recorder(scenario, lambda name, t, values: pieces[name].append((t, values)))
    interrupted = _run(simulation, scenario, [recorder.take], recorder, how)
    flown = recorder.flown()
    summary = summarise(flown, simulation, interrupted)
    data = {name: _joined(parts) for name, parts in pieces.items() if parts} | _scores(flown, scenario)
    metadata = provenance(scenario, simulation) | _truth(simulation) | _closing(summary)
    return Flight(scenario, None, Log.from_arrays(channels, data, metadata), summary)


def _into_folder(
    scenario: Scenario,
    simulation: Simulation,
    folder: Path,
    how: _How,
    camera: bool,
    film: bool,
) -> dict[str, Any]:
    """Log, scenario and pictures are written while the run goes on; its summary."""
    metadata = provenance(scenario, simulation) | _truth(simulation)
    metadata["scenario"] = dump_scenario(scenario_to_replay(scenario, simulation, folder))
    write_text(folder / "scenario.yaml", metadata["scenario"])
    with ExitStack() as stack:
        log = stack.enter_context(LogWriter(folder / "log.mcap", _channels(scenario, simulation), metadata))
        recorder = Recorder(scenario, log.write_many)
        takers = [recorder.take]
        if camera:
            from rovtwin.runs.recording.filming import Filming

            takers.append(stack.enter_context(Filming(scenario, simulation.vehicle, folder, film)).take)
        interrupted = _run(simulation, scenario, takers, recorder, how)
        flown = recorder.flown()
        summary = summarise(flown, simulation, interrupted)
        for name, (t, values) in _scores(flown, scenario).items():
            log.write_many(name, t, values)
        log.annotate(_closing(summary))
    with keeping(folder, f"The log is whole: {folder / 'log.mcap'}"):
        write_text(folder / "summary.json", to_json(summary) + "\n")
    return summary


def _channels(scenario: Scenario, simulation: Simulation) -> list[Channel]:
    return log_channels(
        simulation.thruster_names,
        simulation.sensor_kinds,
        scenario.log.rate,
        scenario.log.sensors,
        scenario.world.moving_surface,
        simulation.battery_names,
        {name: tether.segments + 1 for name, tether in simulation.loop.twin.tethers.items()},
    )


def _run(
    simulation: Simulation,
    scenario: Scenario,
    takers: Sequence[Callable[[Record], None]],
    recorder: Recorder,
    how: _How,
) -> bool:
    """Run to the end or to Ctrl-C; whether it was the latter."""
    source = realtime_chunks if how.realtime else partial(chunks, short=how.short)
    stream: Iterator[Record] = source(
        simulation.loop, simulation.key, simulation.start, scenario.control_dt, scenario.duration
    )
    ticks = 0
    with Interrupt() as interrupt:
        for record in stream:
            for take in takers:
                take(record)
            if how.progress:
                phase = PHASES[int(record.autopilot.setpoint.phase[-1])]
                before, ticks = ticks, ticks + len(record.autopilot.setpoint.phase)
                longer = before < how.short <= ticks and not how.realtime
                how.progress(recorder.seconds, f"{phase}; compiling for a long run" if longer else phase)
            if interrupt.asked:
                return True
    return False


def _scores(flown: Flown, scenario: Scenario) -> dict[str, tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n ..."]]]:
    if scenario.test:
        return {}
    on_leg = flown.mode[:, 3] > 0.5
    distance = np.where(on_leg, distance_to_leg(flown.eta, flown.leg), 0.0)
    return {
        "score/nees": (flown.t, nees(flown)),
        "score/cross_track": (flown.t, np.stack([distance, on_leg.astype(float)], axis=1)),
    }


def _truth(simulation: Simulation) -> dict[str, str]:
    """What a simulated run knows and a vehicle over a link does not: how the true vehicle differs from the model."""
    return {"mismatch": to_json(simulation.mismatch) if simulation.mismatch else ""}


def _closing(summary: dict[str, Any]) -> dict[str, str]:
    return {"summary": to_json(summary)}


def _joined(
    parts: list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, "_ ..."]]],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n ..."]]:
    times, values = zip(*parts, strict=True)
    return np.concatenate(times), np.concatenate(values)


def run_folder(name: str, root: str | Path = "runs") -> Path:
    """A folder name for a run that starts now: `runs/<time>-<name>`, numbered if taken."""
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-{re.sub(r'[^A-Za-z0-9_.-]', '_', name)}"
    path = Path(root) / stem
    for number in range(2, 1000):
        if not path.exists():
            break
        path = Path(root) / f"{stem}-{number}"
    return path


def new_folder(folder: str | Path) -> Path:
    """A folder that was not there before.

    Raises:
        ConfigError: It was, or it cannot be made.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise ConfigError(exists_already(folder)) from None
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be made ({error.strerror}). Choose a folder you may write to") from None
    return folder
