"""The truth of a served twin in an MCAP file."""

from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.core.errors import LinkError
from rovtwin.core.log import Channel, LogWriter
from rovtwin.scenario.channels import ETA, ETA_UNITS, NU, NU_UNITS


class TruthLog:
    """The truth of a served twin: what it was at each `take`."""

    def __init__(self, writer: LogWriter):
        self._writer = writer
        self._rows: dict[str, list[np.ndarray]] = {}
        self._times: list[float] = []

    def take(self, vehicle: Any) -> None:
        self._times.append(vehicle.now)
        for name, values in vehicle.truth.items():
            self._rows.setdefault(name, []).append(np.array(values))
        if len(self._times) >= 50:
            self.flush()

    def flush(self) -> None:
        for name, rows in self._rows.items():
            self._writer.write_many(f"truth/{name}", np.array(self._times), np.stack(rows))
        self._rows, self._times = {}, []

    def __enter__(self) -> "TruthLog":
        self._writer.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        if self._times:
            self.flush()
        self._writer.__exit__(*error)  # type: ignore[arg-type]  (handed on as they came)


def truth_log(path: Path, vehicle: Any) -> TruthLog:
    """A new log for a vehicle with `dt`, `thrusters`, `now` and `truth`, see `host.ServedVehicle`.

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
    return TruthLog(LogWriter(path, channels, {"name": "served"}))
