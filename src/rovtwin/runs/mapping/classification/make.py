"""Classes of a mosaic: what is asked for, done, judged and written."""

import os
from collections.abc import Callable
from pathlib import Path

from rovtwin.core.errors import ConfigError, exists_already
from rovtwin.runs.mapping.classification.judging import against_scene, by_points, scene_of
from rovtwin.runs.mapping.classification.page import write_classes_page
from rovtwin.runs.mapping.classification.request import ClassifyRequest
from rovtwin.runs.mapping.classification.result import Classification
from rovtwin.runs.mapping.classification.sources import prepare
from rovtwin.runs.mapping.classification.work import classified
from rovtwin.runs.mapping.classification.writing import Judged, write_files
from rovtwin.runs.mapping.result import Mosaic


def classify(
    mosaic: Mosaic,
    request: ClassifyRequest,
    out: Path,
    progress: Callable[[str, int, int], None] = lambda what, done, count: None,
) -> Classification:
    """Classify a mosaic.

    Args:
        mosaic: Of reflectance; of radiance with training places.
        request: What is asked for.
        out: Folder to make.
        progress: Called with what is done, how much of it, and how much there is.

    Raises:
        ConfigError: Something that is asked for is not there or does not go together.
        LogError: A file cannot be read or written, or no cell can be classified.
    """
    if out.exists():
        raise ConfigError(exists_already(out))
    _require_folder(out)
    scene = None if request.truth is None else scene_of(request.truth)
    prepared = prepare(mosaic, request)
    found = classified(prepared, progress)
    checked = None if request.check is None else by_points(found, request.check)
    progress("truth", 0, 1)
    judged = Judged(found, None if scene is None else against_scene(found, scene), checked)
    progress("writing", 0, 1)
    out.mkdir(parents=True)
    write_classes_page(out, judged)
    return write_files(judged, out)


def _require_folder(out: Path) -> None:
    """That it can be made is known before the work; what is refused later leaves none."""
    there = next(parent for parent in out.absolute().parents if parent.exists())
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        found = "is no folder" if not there.is_dir() else "cannot be written to"
        raise ConfigError(f"-o {out}: {there} {found}, expected one that a folder can be made in. Choose another")
