"""The page of a mosaic."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from rovtwin.report.mapping.viewer import Viewer
from rovtwin.report.parts.page import Picture, write_page
from rovtwin.report.parts.tables import Table


def write_map_page(
    folder: Path,
    title: str,
    table: Table,
    remarks: Sequence[str],
    pictures: Sequence[Picture],
    files: Mapping[str, str],
    viewer: Viewer | None = None,
) -> Path:
    """Write `report.html`.

    Args:
        folder: Of the mosaic.
        title: On top.
        table: Figures.
        remarks: Sentences for people.
        pictures: In order, saved into the folder.
        files: By name, what each is.
        viewer: Spectra that are shown where one clicks.
    """
    return write_page(
        folder / "report.html", "mosaic.html.j2", title=title, table=table, remarks=remarks, pictures=pictures,
        files=files, viewer=None if viewer is None else viewer.data(),
        canvas=(1, 1) if viewer is None else viewer.picture_size,
    )  # fmt: skip
