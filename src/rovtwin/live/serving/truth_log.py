"""The truth of a served twin in an MCAP file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.log import Channel, LogWriter
from rovtwin.runs.recording.channels import ETA, ETA_UNITS, NU, NU_UNITS


class TruthLog:
    """The truth of a served twin: what it was at each `take`."""

    def __init__(self, writer: LogWriter):
        """`writer` is open; see `truth_log`."""
        self._writer = writer
        self._rows: dict[str, list[np.ndarray]] = {}
        self._times: list[float] = []

    def take(self, vehicle: Any) -> None:
        """What is true of the vehicle now."""
        self._times.append(vehicle.now)
        for name, values in vehicle.truth.items():
            self._rows.setdefault(name, []).append(np.array(values))
        if len(self._times) >= 50:
            self.flush()

    def flush(self) -> None:
        """Write what was taken since the last time."""
        for name, rows in self._rows.items():
            self._writer.write_many(f"truth/{name}", np.array(self._times), np.stack(rows))
        self._rows, self._times = {}, []


@contextmanager
def truth_log(path: Path, vehicle: Any) -> Iterator[TruthLog]:
    """A new log for a vehicle with `dt`, `thrusters`, `now` and `truth`, see `host.ServedVehicle`; whole at the end.

    Its metadata say which code of one's own the twin ran, as those of a flight do, where the vehicle has `own_code`.

    Raises:
        LinkError: A replayed vehicle, which has no truth.
    """
    thrusters = tuple(getattr(vehicle, "thrusters", ()))
    if not thrusters:
        raise LinkError(f"{path}: a replayed vehicle has no truth to log")
    rate = 1.0 / vehicle.dt
    channels = [
        Channel("truth/eta", ETA, ETA_UNITS, "n", description="true pose of CO", rate=rate),
        Channel("truth/nu", NU, NU_UNITS, "b", description="true velocity over ground", rate=rate),
        Channel("truth/thrust", thrusters, "N", "b", description="true force of each thruster", rate=rate),
        Channel("truth/command", thrusters, "1", "", description="normalised command of each thruster", rate=rate),
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    with LogWriter(path, channels, {"name": "served"} | getattr(vehicle, "own_code", {})) as writer:
        log = TruthLog(writer)
        try:
            yield log
        finally:
            log.flush()
