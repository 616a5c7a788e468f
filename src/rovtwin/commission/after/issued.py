"""A certificate that was issued: what its bundle says of the vehicle, for dives that come later."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rovtwin.commission.certified.make import AUTOPILOT, IDENTIFIED, REQUEST
from rovtwin.commission.certified.manifest import NAME, read_manifest
from rovtwin.commission.certified.opening import manifest_bytes, opened
from rovtwin.commission.dossier import OUTCOME
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Outcome
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import read_yaml
from rovtwin.core.user_files.files import read_text
from rovtwin.vehicle import Vehicle, load_vehicle


@dataclass(frozen=True)
class Issued:
    """What a bundle says.

    Attributes:
        folder: Of the bundle, or what of it is unpacked.
        name: Of the vehicle.
        date: When it was issued, UTC.
        seal: Of its evidence.
        request: What was asked for; its vehicle is the identified file.
        autopilot: Section `autopilot` that was proven; None: it was not.
        measured: Figures of the last attempt at each stage, by its name.
        flight: Log of the certified flight; None: there was none.
    """

    folder: Path
    name: str
    date: str
    seal: str
    request: Request
    autopilot: dict[str, Any] | None
    measured: dict[str, dict[str, Any]]
    flight: Path | None

    @property
    def vehicle_file(self) -> Path:
        """The identified vehicle."""
        return self.folder / IDENTIFIED

    @property
    def vehicle(self) -> Vehicle:
        """The same, read; ConfigError where it cannot be used."""
        return load_vehicle(str(self.vehicle_file))


@contextmanager
def issued(path: Path) -> Iterator[Issued]:
    """The certificate in a bundle, its zip, or the folder of a commissioning.

    Raises:
        ConfigError: There is none, it would harm, or it says nothing of a vehicle.
    """
    with opened(path) as bundle:
        manifest = read_manifest(manifest_bytes(bundle), f"{bundle.where}: {NAME}")
        if missing := [one for one in (IDENTIFIED, REQUEST) if one not in bundle.sizes]:
            raise ConfigError(f"{bundle.where}: found no {missing[0]}, expected one: commission up to `certificate`")
        with bundle.on_disk([one.path for one in manifest.files if one.path in bundle.sizes]) as folder:
            yield _read(folder, manifest.vehicle, manifest.issued, manifest.seal)


def _read(folder: Path, name: str, date: str, seal: str) -> Issued:
    request_file = folder / REQUEST
    try:
        request = replace(Request.from_dict(json.loads(read_text(request_file))), vehicle=str(folder / IDENTIFIED))
        pages = {stage: _last(folder, stage) for stage in ("bench", "prove", "predict")}
        measured = {stage: dict(page.measured) for stage, (_, page) in pages.items() if page is not None}
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{folder}: found {error!r:.80}, expected what rovtwin commission writes") from None
    flight = pages["predict"][0] / str(measured.get("predict", {}).get("log", "none"))
    autopilot = folder / AUTOPILOT
    section = read_yaml(autopilot) if autopilot.exists() else None
    return Issued(folder, name, date, seal, request, section, measured, flight if flight.is_file() else None)


def _last(folder: Path, stage: str) -> tuple[Path, Outcome | None]:
    """Folder and page of the last attempt at a stage."""
    pages = sorted(folder.glob(f"stages/*-{stage}/*/{OUTCOME}"), key=lambda page: int(page.parent.name))
    if not pages:
        return folder, None
    return pages[-1].parent, Outcome.from_dict(json.loads(read_text(pages[-1])))
