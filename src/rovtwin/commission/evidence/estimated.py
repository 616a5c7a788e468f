"""The estimate on what was flown so far, with its vehicle file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rovtwin.commission.work import Work
from rovtwin.core.log.files import keeping
from rovtwin.core.user_files.files import whole
from rovtwin.identification.identify import Identification, identify
from rovtwin.identification.joint.result.overlay import to_yaml
from rovtwin.identification.logs.record import Record
from rovtwin.scenario.assets import MESHES, kept_beside


def estimated(work: Work, records: Sequence[Record], anchors: Sequence[Any]) -> Identification:
    """From all tests, the pulls on a scale and an earlier identification where there is one.

    Raises:
        IdentificationError: The evidence cannot be turned into parameters.
    """
    return identify(
        work.vehicle,
        records,
        anchors=anchors,
        old=work.request.load_prior(),
        progress=lambda what, share: work.person.progress(f"estimating: {what}", share),
    )


def written(work: Work, result: Identification, name: str) -> Path:
    """Write the vehicle file into the attempt's folder, with the meshes that it needs beside it; its path.

    Raises:
        LogError: It cannot be written.
    """
    out = work.folder / name
    data = kept_beside(result.file(), work.folder, f"{out.stem}/{MESHES}")
    with keeping(work.folder, "Nothing of the result was written"), whole(out) as beside:
        beside.write_text(to_yaml(data, f"rovtwin commission {work.vehicle.name}"), encoding="utf-8")
    return out
