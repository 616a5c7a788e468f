"""rovtwin calibrate: the lens of a camera from pictures of a chessboard."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rovtwin.cli.output import AsJson, Overwrite, check_free, console, emit, table
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.files import write_text

if TYPE_CHECKING:
    from rovtwin.positioning.calibration.lens import Calibration

_NAMES = ("f_x [px]", "f_y [px]", "c_x [px]", "c_y [px]", "k_1", "k_2", "p_1", "p_2", "k_3")


def calibrate(
    images: Annotated[list[Path], typer.Argument(help="Pictures of a chessboard, such as images/*.png.")],
    board: Annotated[str, typer.Option(help="Inner corners along its sides, such as 9x6.")] = "9x6",
    square: Annotated[str, typer.Option(help="Side of a square.")] = "25mm",
    name: Annotated[str, typer.Option(help="Name of the camera.")] = "camera",
    out: Annotated[Path, typer.Option("-o", "--out", help="Camera file to write.")] = Path("camera.yaml"),
    picture: Annotated[Path | None, typer.Option("--figure", help="Draw the residuals: .png, .svg or .pdf.")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Calibrate a camera from pictures of a chessboard.

    Take 10 to 20 pictures with the board tilted, near and far, and in every corner of the image. Taken under water, the
    lens with its port is calibrated as one, which is right at the distance of the board.

    Example: [bold]rovtwin calibrate images/*.png --board 9x6 --square 25mm -o camera.yaml[/bold]
    """
    from rovtwin.core.user_files.quantity import LENGTH, positive
    from rovtwin.core.user_files.yamlfile import dump_yaml
    from rovtwin.positioning.calibration.camera_file import as_data
    from rovtwin.positioning.calibration.lens import calibrate

    check_free(out, overwrite)
    result = calibrate(images, _board(board), positive(square, LENGTH, "--square"))
    source = f"{len(result.used)} pictures of a chessboard {board}, {square}; {result.rms:.3f} px rms"
    data = as_data(name, result.lens, source)
    write_text(out, dump_yaml(data, default_flow_style=None))
    if picture is not None:
        _draw(result, picture)
    values = [
        *map(float, result.lens.focal),
        *map(float, result.lens.principal),
        *map(float, result.lens.distortion[:5]),
    ]
    if as_json:
        emit(data | {"rms_px": result.rms, "std": result.std.tolist(), "used": len(result.used), "notes": result.notes})
        return
    rows = table(f"{len(result.used)} of {len(images)} pictures, {result.rms:.3f} px rms", "", "value", "std")
    for label, value, std in zip(_NAMES, values, result.std, strict=True):
        digits = 2 if "px" in label else 4
        rows.add_row(label, f"{value:.{digits}f}", f"{std:.{digits}f}")
    screen = console(False)
    screen.print(rows)
    for note in result.notes:
        screen.print(f"- {note}", markup=False, soft_wrap=True)
    screen.print(f"wrote {out}", markup=False)


def _draw(result: "Calibration", path: Path) -> None:
    from numpy import concatenate

    from rovtwin.report.cameras.lens import residual_figure

    figure = residual_figure(result.lens, concatenate(result.points), concatenate(result.residuals))
    figure.savefig(path, dpi=110)


def _board(text: str) -> tuple[int, int]:
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        columns = rows = 0
    if min(columns, rows) < 3:
        raise ConfigError(f"--board: found '{text}', expected inner corners along both sides, 3 or more, such as 9x6")
    return columns, rows
