"""All of a run at once, thinned, for the lines that plots, chart and scene draw behind the vehicle.

As one block of numbers, which a browser takes apart into states (`static/history.js`): the length of a header
(uint32, little endian), the header (JSON, padded to a multiple of 4 bytes), then `count` rows of float32. The header
says when the rows are (`start`, `step` [s]) and what is in them: `columns`, each a path into a state and how many
numbers stand there; 0 for one that is no array. What is not there is NaN.
"""

import json
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.console.engine.reporting.state import HIDDEN, progress
from rovtwin.console.replays.replay import Recording
from rovtwin.console.replays.tape import Held
from rovtwin.core.flow import PHASES
from rovtwin.core.sensors import kind_of

MOST = 6000  # rows
STEP = 0.1  # between two rows at least [s]
PLAIN = ("eta", "nu", "reference", "reference_rate", "tau", "u", "truth", "current")

Column = tuple[str, int, np.ndarray]  # path, numbers there, values (n, max(numbers, 1))


def history(recording: Recording) -> bytes:
    """The block."""
    start, duration = recording.start, recording.end - recording.start
    step = max(STEP, duration / (MOST - 1))
    t = start + step * np.arange(int(duration / step) + 1)
    columns = [*_plain(recording, t), *_course(recording, t), *_consistency(recording, t), *_sensors(recording, t)]
    rows = np.concatenate([values.reshape(len(t), -1) for _, _, values in columns], axis=1).astype("<f4")
    listed = [[path, width] for path, width, _ in columns]
    header = json.dumps({"count": len(t), "start": start, "step": step, "columns": listed}).encode()
    header += b" " * (-len(header) % 4)
    return len(header).to_bytes(4, "little") + header + rows.tobytes()


def _plain(recording: Recording, t: Float[np.ndarray, " n"]) -> list[Column]:
    tape = recording.tape
    found = [(name, tape[name].values.shape[1], tape[name].at(t)) for name in PLAIN if name in tape]
    if "std" in tape:
        found.append(("sd", 6, tape["std"].at(t)[:, :6]))
    if "timing" in tape:
        found += [(name, 0, tape["timing"].at(t)[:, i]) for i, name in enumerate(("late_ms", "link_age"))]
    return found


def _course(recording: Recording, t: Float[np.ndarray, " n"]) -> list[Column]:
    """Distance to go, and share of the mission."""
    tape = recording.tape
    if not {"eta", "leg", "mode"} <= tape.keys():
        return []
    leg, mode = tape["leg"].at(t), tape["mode"].at(t).astype(int)
    to_go = np.linalg.norm(leg[:, 3:] - tape["eta"].at(t)[:, :3], axis=1)
    length = np.linalg.norm(leg[:, 3:] - leg[:, :3], axis=1)
    shares = [
        progress(PHASES[phase], waypoint, recording.count(at), *distances)
        for at, (phase, _, waypoint, _), *distances in zip(
            t.tolist(), mode.tolist(), to_go.tolist(), length.tolist(), strict=True
        )
    ]
    return [("to_go", 0, to_go), ("progress", 0, np.array(shares))]


def _consistency(recording: Recording, t: Float[np.ndarray, " n"]) -> list[Column]:
    reports = [recording.consistency.report(at) for at in t.tolist()]
    names = sorted({name for one in reports for name in one})
    nothing = [np.nan] * 4
    return [(f"nis.{name}", 4, np.array([one.get(name, nothing) for one in reports])) for name in names]


def _sensors(recording: Recording, t: Float[np.ndarray, " n"]) -> list[Column]:
    found = []
    for name, held in recording.readings.items():
        last = held.last(t)
        received = last >= 0
        found.append((f"sensors.{name}.age", 0, np.where(received, t - held.t[np.maximum(last, 0)], np.nan)))
        if kind_of(name) not in HIDDEN:
            found.append((f"sensors.{name}.value", held.values.shape[1], _where(received, held, t)))
    return found


def _where(received: Float[np.ndarray, " k"], held: Held, t: Float[np.ndarray, " n"]) -> Any:
    return np.where(received[:, None], held.at(t), np.nan)
