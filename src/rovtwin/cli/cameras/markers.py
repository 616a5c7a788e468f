"""rovtwin markers: a PDF of printed markers, to scale."""

from pathlib import Path
from typing import Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit


def markers(
    ids: Annotated[str, typer.Option(help="Numbers of the markers: 0-11, or 0,3,7-9.")] = "0-11",
    size: Annotated[str, typer.Option(help="Side of the black square: 150mm, 0.15.")] = "150mm",
    dictionary: Annotated[str, typer.Option(help="A dictionary of OpenCV.")] = "DICT_4X4_50",
    page: Annotated[str, typer.Option(help="a4, a3 or letter.")] = "a4",
    out: Annotated[Path, typer.Option("-o", "--out", help="PDF to write.")] = Path("markers.pdf"),
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Print markers to scale, with cut marks and a ruler to check the printer's scale.

    Example: [bold]rovtwin markers --ids 0-11 --size 150mm -o markers.pdf[/bold]

    Print at 100 % ("actual size"), measure the ruler, cut along the marks: the white rim belongs to the marker.
    """
    from rovtwin.core.user_files.quantity import LENGTH, positive
    from rovtwin.report.cameras.markers import numbers, write_markers

    side = positive(size, LENGTH, "--size")
    check_free(out, overwrite)
    pages = write_markers(out, dictionary, numbers(ids, "--ids"), side, page)
    if as_json:
        emit({"pdf": str(out), "pages": pages, "markers": len(numbers(ids, "--ids")), "size_m": side})
        return
    many = "1 page" if pages == 1 else f"{pages} pages"
    console(False).print(
        f"wrote {out}: {many} of {page}; print at 100 %, then measure the ruler", markup=False, soft_wrap=True
    )
