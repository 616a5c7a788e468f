"""rovtwin render: a picture of a scene, from the vehicle's camera or from outside."""

from pathlib import Path
from typing import Annotated, Any

import typer

from rovtwin.cli.output import AsJson, console, emit, refuse_idle
from rovtwin.core.errors import ConfigError


def render(
    scene: Annotated[str, typer.Argument(help="A scene of the library (mclab, pool, seabed) or a YAML file.")],
    vehicle: Annotated[str, typer.Option(help="A library name or a file.")] = "double_blueye",
    camera: Annotated[str | None, typer.Option(help="Name of its camera; default the first.")] = None,
    at: Annotated[
        str, typer.Option(metavar="X,Y,Z,HEADING", help="Where the vehicle is: north, east, depth [m], heading [deg].")
    ] = "0,0,0.7,0",
    view: Annotated[str, typer.Option(help="camera, or third-person: the vehicle from outside.")] = "camera",
    scale: Annotated[float, typer.Option(min=0.05, max=2.0, help="Pixels a side over the camera's own.")] = 1.0,
    renderer: Annotated[str, typer.Option(help="auto, gl (OpenGL) or raycast.")] = "auto",
    beam_attenuation: Annotated[
        float | None, typer.Option(min=0.06, max=20.0, help="Murkier water: in green [1/m]; default the scene's water.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the image noise; default no noise.")] = None,
    out: Annotated[Path, typer.Option("-o", "--out", help="Picture to write: .png or .jpg.")] = Path("picture.png"),
    as_json: AsJson = False,
) -> None:
    """Draw what a vehicle's camera sees in a scene, or the vehicle itself.

    Example: [bold]rovtwin render mclab --at 3,0.3,0.7,0 -o picture.png[/bold]
    """
    from rovtwin.simulation.scene import load_scene
    from rovtwin.vehicle import load_vehicle

    if view not in ("camera", "third-person"):
        raise ConfigError(f"--view: found '{view}', expected camera or third-person")
    if view == "third-person":
        given = {"--camera": camera is not None, "--renderer": renderer != "auto", "--seed": seed is not None}
        refuse_idle(given, "the vehicle is drawn from outside, without a camera of its own and its noise")
    shown, seen = load_scene(scene), load_vehicle(vehicle)
    if beam_attenuation is not None:
        kept = shown.file.water.model_dump(exclude={"beam_attenuation", "scattering"}, exclude_none=True)
        shown = shown.with_water(**kept, beam_attenuation=beam_attenuation)
    position, R_nb = _pose(at)
    if view == "third-person":
        from rovtwin.simulation.camera.outside import outside_view

        size = (round(1280 * scale), round(720 * scale))
        picture, data = outside_view(shown, seen, position, R_nb, size=size), {"view": view}
    else:
        picture, data = _through_camera(shown, seen, camera, scale, renderer, position, R_nb, seed)
    _write(out, picture)
    found = data | {"scene": shown.name, "width": picture.shape[1], "height": picture.shape[0], "picture": str(out)}
    if as_json:
        emit(found)
        return
    how = ", ".join(f"{key} {value}" for key, value in data.items())
    size = f"{picture.shape[1]} x {picture.shape[0]}"
    console(False).print(f"wrote {out}: {size}, {how}", markup=False, soft_wrap=True)


def _through_camera(scene: Any, vehicle: Any, name: str | None, scale: float, kind: Any, *rest: Any) -> Any:
    from rovtwin.simulation.camera.renderer import renderer
    from rovtwin.simulation.camera.sensor import camera_named

    position, R_nb, seed = rest
    chosen = camera_named(vehicle, name, scale)
    drawn = renderer(scene, chosen, kind)
    return drawn.image(position, R_nb, seed=seed), {"camera": chosen.name, "renderer": drawn.kind}


def _pose(text: str) -> Any:
    """Position and R_nb of "x,y,z,heading" in m and degrees."""
    import numpy as np

    from rovtwin.core.arrays.rotations import rotation_from_euler

    try:
        x, y, z, heading = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--at: found '{text}', expected x,y,z,heading such as 3,0.3,0.7,0 (m and degrees)") from None
    if not np.isfinite([x, y, z, heading]).all():
        raise ConfigError(f"--at: found '{text}', expected finite numbers")
    return np.array([x, y, z]), rotation_from_euler(np.array([0.0, 0.0, np.radians(heading)]))


def _write(path: Path, picture: Any) -> None:
    from matplotlib.image import imsave

    if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise ConfigError(f"--out: found '{path.name}', expected a name that ends in .png or .jpg")
    imsave(path, picture)
