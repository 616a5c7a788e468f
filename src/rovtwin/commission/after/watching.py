"""Later dives against a certificate: what has changed of vehicle and sensors, and whether the envelope holds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rovtwin.commission.after.envelope import Envelope, flown_again
from rovtwin.commission.after.issued import Issued
from rovtwin.commission.after.signals import compared
from rovtwin.commission.stage import Check
from rovtwin.core.log import Log
from rovtwin.runs.watch import Watch, watch_runs

Progress = Callable[[str, float], None]


@dataclass(frozen=True, eq=False)
class Watched:
    """What dives say beside the certificate.

    Attributes:
        certificate: Vehicle, date and seal, in words.
        watch: Drag, added mass, forces and balance, each dive against the identification.
        signals: Lines about sensors, for each dive.
        envelope: Missions of the proof with what the newest dive has found; None: nothing has changed, nothing was
            proven, or they were not asked for.
    """

    certificate: str
    watch: Watch
    signals: list[list[Check]]
    envelope: Envelope | None

    @property
    def changed(self) -> bool:
        """Whether the newest dive finds the vehicle changed."""
        return bool(self.watch.changes[-1] or self.watch.runs[-1].lost)

    @property
    def alarms(self) -> list[Check]:
        """What the newest dive is warned of: sensors, and the envelope; changes of the vehicle stand in the watch."""
        envelope = [] if self.envelope is None else self.envelope.lines()
        return [check for check in (*self.signals[-1], *envelope) if check.verdict in ("warning", "stop")]

    @property
    def good(self) -> bool:
        """Whether the newest dive is as certified, as far as it can tell."""
        return not self.changed and not self.alarms


def watch_certified(
    runs: Sequence[Path], certificate: Issued, prove: bool = True, progress: Progress = lambda name, share: None
) -> Watched:
    """Compare dives with a certificate.

    Args:
        runs: Folders of runs, or logs, the oldest first.
        certificate: Opened.
        prove: Fly the missions of the proof once more if the newest dive finds the vehicle changed.
        progress: Told what is done and how far it is, 0 to 1.

    Raises:
        ConfigError: The bundle's vehicle cannot be used.
        IdentificationError: A log that cannot be read or used; which, and why.
    """
    found = watch_runs(runs, str(certificate.vehicle_file), 0, progress)
    then = None if certificate.flight is None else Log.read(certificate.flight)
    beside = () if certificate.positions is None else ("position",)
    signals = [_signals(one.path, then, beside) for one in found.runs]
    text = f"{certificate.name}, certified {certificate.date[:10]}, seal {certificate.seal[:16]}.."
    watched = Watched(text, found, signals, None)
    if not (prove and watched.changed):
        return watched
    again = flown_again(certificate, found.runs[-1], lambda share: progress("the missions of the proof", share))
    return Watched(text, found, signals, again)


def _signals(log: Path, then: Log | None, beside: Sequence[str]) -> list[Check]:
    if then is None:
        return [Check("note", "sensors", "not compared: the certificate has no flight")]
    if log.suffix != ".mcap":
        return [Check("note", "sensors", f"not compared: {log.name} is no log of rovtwin")]
    return list(compared(Log.read(log), then, beside))
