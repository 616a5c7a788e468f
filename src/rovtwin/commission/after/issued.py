"""A certificate that was issued: what its bundle says of the vehicle, for dives that come later.

Only a bundle whose files are those that were sealed is used, and of it only files that its manifest names.
"""

import json
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from rovtwin.commission.certified.make import AUTOPILOT, IDENTIFIED, REQUEST
from rovtwin.commission.certified.manifest import Manifest, require_inside
from rovtwin.commission.certified.opening import DAMAGED, opened
from rovtwin.commission.certified.verify import verify
from rovtwin.commission.dossier import OUTCOME
from rovtwin.commission.request import Request
from rovtwin.commission.stage import Outcome
from rovtwin.commission.work import positions_of
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import read_yaml
from rovtwin.core.user_files.files import cannot, read_text
from rovtwin.vehicle import Vehicle, load_vehicle

MOST_MISSIONS = 100_000  # in each water: what anybody would fly once more


class Row(BaseModel):
    """What is read of a current and sea of the proof."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)
    sea_m: float = Field(ge=0)
    current_m_s: float = Field(ge=0)


class Limit(BaseModel):
    """Largest current of a sea, None: there was none."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)
    sea_m: float = Field(ge=0)
    current_m_s: float | None = None


class Proven(BaseModel):
    """What is read of the figures of the proof; where they have neither seed nor missions, those asked for."""

    model_config = ConfigDict(frozen=True)
    envelope: tuple[Row, ...] = ()
    largest_currents: tuple[Limit, ...] = ()
    seed: int = Field(ge=0)
    samples: int = Field(ge=1, le=MOST_MISSIONS)


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
        proven: Of the last attempt at the proof.
        positions: Section `sensors.position` that it was proven with; None: as the vehicle has it.
        flight: Log of the certified flight; None: there was none.
        versions: A line for each package that is another one here.
    """

    folder: Path
    name: str
    date: str
    seal: str
    request: Request
    autopilot: dict[str, Any] | None
    proven: Proven
    positions: dict[str, Any] | None
    flight: Path | None
    versions: tuple[str, ...] = ()

    @property
    def vehicle_file(self) -> Path:
        """The identified vehicle."""
        return self.folder / IDENTIFIED

    @property
    def vehicle(self) -> Vehicle:
        """The same, read; ConfigError where it cannot be used."""
        return load_vehicle(str(self.vehicle_file))


@contextmanager
def issued(path: Path, progress: Callable[[str, float], None] = lambda words, share: None) -> Iterator[Issued]:
    """The certificate in a bundle, its zip, or the folder of a commissioning.

    Args:
        path: Where it is.
        progress: Told which file is checked and how far that is, 0 to 1.

    Raises:
        ConfigError: There is none, its files are not those that were sealed, or it says nothing of a vehicle.
    """
    with ExitStack() as stack:
        try:
            found = verify(path, quick=True, progress=progress)
            if not found.good:
                why = str(found.findings[0]) if found.findings else "its seal is not that of its files"
                raise ConfigError(
                    f"{path}: NOT VERIFIED: {why}. Expected what was certified: see rovtwin verify {path}"
                )
            paths = [one.path for one in found.manifest.files]
            if missing := [one for one in (IDENTIFIED, REQUEST) if one not in paths]:
                raise ConfigError(f"{path}: found no {missing[0]}, expected one: commission up to `certificate`")
            bundle = stack.enter_context(opened(path))
            folder = stack.enter_context(bundle.on_disk(paths))
            certificate = replace(_read(folder, found.manifest), versions=found.versions)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read ({cannot(error)})") from None
        except (*DAMAGED, RuntimeError) as error:  # changed since it was checked
            raise ConfigError(f"{path}: cannot be unpacked ({error}); copy the bundle once more") from None
        yield certificate


def _read(folder: Path, manifest: Manifest) -> Issued:
    paths = {one.path for one in manifest.files}
    vehicle, autopilot = folder / IDENTIFIED, folder / AUTOPILOT
    try:
        request = TypeAdapter(Request).validate_python(json.loads(read_text(folder / REQUEST)))
        bench, prove, predict = (_last(paths, stage) for stage in ("bench", "prove", "predict"))
        proven = Proven.model_validate({"seed": request.seed, "samples": request.samples} | _measured(folder, prove))
        positions = positions_of(load_vehicle(str(vehicle)), _measured(folder, bench), request.sensors)
        log = f"{predict.removesuffix(OUTCOME)}{_measured(folder, predict).get('log', 'none')}"
    except (AttributeError, LookupError, TypeError, ValueError, RecursionError) as error:
        text = " ".join(str(error).split())[:120]
        raise ConfigError(f"{folder}: found {text}, expected what rovtwin commission writes") from None
    require_inside(log, str(folder))
    section = read_yaml(autopilot) if AUTOPILOT in paths else None
    flight = folder / log if log in paths else None
    request = replace(request, vehicle=str(vehicle))
    return Issued(folder, manifest.vehicle, manifest.issued, manifest.seal, request, section, proven, positions, flight)


def _last(paths: set[str], stage: str) -> str:
    """The page of the last attempt at a stage, "" where there is none."""
    pattern = re.compile(rf"stages/[0-9]+-{stage}/([0-9]+)/{re.escape(OUTCOME)}")
    pages = [(int(found[1]), path) for path in paths if (found := pattern.fullmatch(path))]
    return max(pages, default=(0, ""))[1]


def _measured(folder: Path, page: str) -> dict[str, Any]:
    """Its figures."""
    return dict(Outcome.from_dict(json.loads(read_text(folder / page))).measured) if page else {}
