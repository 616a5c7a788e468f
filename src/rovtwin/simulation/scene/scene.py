"""A Scene: what stands in the water, read from a file; where its markers hang; the surfaces that renderers draw."""

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from pydantic import ValidationError

from rovtwin.core.errors import ConfigError
from rovtwin.core.markers import Layout, Marker, pattern
from rovtwin.core.user_files.config import near, parse, read_yaml
from rovtwin.core.user_files.files import is_file
from rovtwin.simulation.relief import Relief
from rovtwin.simulation.scene import schema
from rovtwin.simulation.scene.shapes import cylinder, mesh_from_file, seabed, wreck
from rovtwin.simulation.scene.surfaces import QUIET, SIDES, Material, Mesh, Rectangle, rectangle, side
from rovtwin.vehicle.solids.placement import Placement

LIBRARY = Path(__file__).parent / "library"
_WHITE, _BLACK = np.full(3, 0.80), np.full(3, 0.03)  # reflectances of a laminated print


@dataclass(frozen=True)
class Scene:
    """What stands in the water.

    Attributes:
        file: As its file describes it.
        where: File name, for messages.
        folder: What its mesh files are relative to.
        bodies: What else is seen, such as a vehicle from outside.
        given_floor: The bottom's shape in place of that of the file: that of the world a run is in.
    """

    file: schema.SceneFile
    where: str
    folder: Path = Path()
    bodies: tuple[Mesh, ...] = ()
    given_floor: Relief | None = None

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def depth(self) -> float:
        """Of the water [m]."""
        if self.file.tank is not None:
            return self.file.tank.depth
        if self.given_floor is not None:
            return float(self.given_floor.depth)
        return np.inf if self.file.bottom is None else self.file.bottom.depth

    @cached_property
    def floor(self) -> Relief | None:
        """The floor's shape, of a tank or a bottom; None where there is none."""
        if self.given_floor is not None:
            return self.given_floor
        bottom = self.file.bottom
        if self.file.tank is None and bottom is None:
            return None
        level = Relief.of(self.depth)
        if bottom is None or bottom.relief is None:
            return level
        relief = bottom.relief
        return level.with_hills(relief.height, relief.length, relief.seed, relief.size)

    @property
    def floor_surface(self) -> schema.Surface | None:
        """How the floor looks; None where there is none."""
        if self.file.tank is not None:
            return self.file.tank.floor
        return None if self.file.bottom is None else self.file.bottom.surface

    def on_floor(self, floor: Relief) -> "Scene":
        """The same scene with its bottom on the floor of the world that a run is in; a tank keeps its own."""
        return self if self.file.bottom is None else replace(self, given_floor=floor)

    @cached_property
    def layout(self) -> Layout:
        """Where the markers hang, in n."""
        given = self.file.markers
        markers = [*given.free, *(marker for on in given.on_faces for marker in self._on_face(on))]
        try:
            return Layout(dictionary=given.dictionary, markers=markers)
        except ValidationError as error:
            message = str(error.errors()[0].get("ctx", {}).get("error", error.errors()[0]["msg"]))
            raise ConfigError(f"{self.where}: markers: {message}") from None

    def with_water(self, **changed: Any) -> "Scene":
        """The same scene in other water: `type`, `absorption`, `scattering`, `beam_attenuation` as in a file."""
        water = parse(schema.Water, changed, f"{self.where}: water")
        return replace(self, file=self.file.model_copy(update={"water": water}))

    def with_layout(self, layout: Layout) -> "Scene":
        """The same scene with other markers."""
        markers = schema.Markers(dictionary=layout.dictionary, on_faces=[], free=layout.markers)
        return replace(self, file=self.file.model_copy(update={"markers": markers}))

    @cached_property
    def rectangles(self) -> list[Rectangle]:
        """All that is flat: walls, boxes, plates, and the markers last."""
        found = [] if self.file.tank is None else _tank(self.file.tank)
        bottom = self.file.bottom
        if bottom is not None and not self._uneven:
            found.append(_flat_bottom(self.depth, bottom.surface))
        return found + self.standing

    @cached_property
    def standing(self) -> list[Rectangle]:
        """What is flat and stands on the floor: boxes, plates, and the markers last."""
        found = [rectangle for item in self.file.objects for rectangle in _flat(item)]
        return found + [_board(marker, bits) for marker, bits in zip(self.layout.markers, self._prints, strict=True)]

    @property
    def _uneven(self) -> bool:
        floor = self.given_floor
        if floor is not None:
            return floor.ripples is not None or floor.amplitude.size > 0 or bool(np.any(np.asarray(floor.slope)))
        return self.file.bottom is not None and self.file.bottom.relief is not None

    @cached_property
    def meshes(self) -> list[Mesh]:
        """All that is not flat."""
        found = []
        bottom = self.file.bottom
        if bottom is not None and self._uneven:
            assert self.floor is not None
            size = schema.Relief.model_validate({}).size if bottom.relief is None else bottom.relief.size
            found.append(seabed(self.floor, size, Material.of(bottom.surface)))
        for item in self.file.objects:
            material, place = Material.of(item.surface), Placement.of(item.pose.position, item.pose.attitude_deg)
            if item.cylinder is not None:
                found.append(cylinder(item.cylinder.radius, item.cylinder.length, place, material, item.name))
            elif item.mesh is not None:
                path = self.folder / Path(item.mesh.file).expanduser()
                where = f"{self.where}: objects.{item.name}.mesh.file"
                found.append(mesh_from_file(path, item.mesh.scale, place, material, where))
            elif item.wreck is not None:
                found.append(wreck(item.wreck, place, material, item.name))
        return found

    @property
    def _prints(self) -> list[UInt8[np.ndarray, "cells cells"]]:
        """Black and white of the markers with their white rims, rows from the top, 1 is white."""
        white = [~pattern(self.layout.dictionary, marker.id) for marker in self.layout.markers]
        return [np.pad(cells.astype(np.uint8), QUIET, constant_values=1) for cells in white]

    def _on_face(self, on: schema.OnFace) -> list[Marker]:
        """Markers that a face carries, with their place in n."""
        middle, right, up, place = self._face(on)
        right, up = right / np.linalg.norm(right), up / np.linalg.norm(up)
        found = []
        for m in on.markers:
            position = place.point(middle + m.at[0] * right + m.at[1] * up)
            R = place.rotation @ np.column_stack([right, up, np.cross(right, up)])
            upright = Marker(id=m.id, size=m.size, position=position.tolist(), faces=R[:, 2].tolist(), roll_deg=0.0)
            turned = upright.R_nm.T @ R[:, 0]  # how the face itself lies against an upright marker
            roll = m.roll_deg + np.degrees(np.arctan2(turned[1], turned[0]))
            found.append(upright.model_copy(update={"roll_deg": float((roll + 180.0) % 360.0 - 180.0)}))
        return found

    def _face(
        self, on: schema.OnFace
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"], Placement]:
        if on.object == "tank":
            if self.file.tank is None:
                raise ConfigError(f"{self.where}: markers.on_faces: found object 'tank', but the scene has none")
            if on.face == "top":
                raise ConfigError(
                    f"{self.where}: markers.on_faces: the tank has no face 'top': that is the water's surface"
                )
            return *side(_tank_size(self.file.tank), on.face, inside=True), _tank_place(self.file.tank)
        boxes = {item.name: item for item in self.file.objects if item.box is not None}
        if on.object not in boxes:
            hint = near(on.object, [*boxes, "tank"])
            raise ConfigError(f"{self.where}: markers.on_faces: no box is called '{on.object}'.{hint}")
        item = boxes[on.object]
        return *side(np.array(item.box), on.face), Placement.of(item.pose.position, item.pose.attitude_deg)


def _board(marker: Marker, bits: UInt8[np.ndarray, "cells cells"]) -> Rectangle:
    """The print of a marker with its white rim; its back is white."""
    R, size = marker.R_nm, marker.size * len(bits) / (len(bits) - 2 * QUIET)
    right, up = size * R[:, 0], size * R[:, 1]
    corner = np.array(marker.position) - 0.5 * (right + up)
    return Rectangle(corner, right, up, Material(_WHITE, _BLACK), both=True, print=bits)


def _tank_size(tank: schema.Tank) -> Float[np.ndarray, "3"]:
    return np.array([tank.length, tank.width, tank.depth])


def _tank_place(tank: schema.Tank) -> Placement:
    return Placement.of(np.array(tank.position) + [0.0, 0.0, 0.5 * tank.depth], [0.0, 0.0, tank.heading_deg])


def _tank(tank: schema.Tank) -> list[Rectangle]:
    place, size = _tank_place(tank), _tank_size(tank)
    found = []
    for name in ("north", "south", "east", "west", "bottom"):
        material = Material.of(tank.floor if name == "bottom" else tank.walls)
        found.append(rectangle(*side(size, name, inside=True), place, material, indoor=7 if name == "bottom" else 3))
    return found


def _flat_bottom(depth: float, surface: schema.Surface) -> Rectangle:
    middle, right, up = np.array([0.0, 0.0, depth]), np.array([0.0, 400.0, 0.0]), np.array([400.0, 0.0, 0.0])
    return rectangle(middle, right, up, Placement.of(np.zeros(3)), Material.of(surface))


def _flat(item: schema.Object) -> list[Rectangle]:
    place, material = Placement.of(item.pose.position, item.pose.attitude_deg), Material.of(item.surface)
    if item.box is not None:
        return [rectangle(*side(np.array(item.box), name), place, material) for name in SIDES]
    if item.plane is not None:
        return [rectangle(*side(np.array([*item.plane, 0.0]), "top"), place, material, both=True)]
    return []


def list_scenes() -> list[str]:
    """Names of the scenes that ship with rovtwin."""
    return sorted(p.stem for p in LIBRARY.glob("*.yaml"))


def is_scene_file(name: str) -> bool:
    """Whether a scene is meant by its file, not by its name in the library."""
    return Path(name).suffix in (".yaml", ".yml") or "/" in name


def load_scene(name_or_path: str | Path) -> Scene:
    """A scene of the library by name, or any scene file by path.

    Raises:
        ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.
    """
    text = str(name_or_path)
    path = Path(text).expanduser()
    if not is_scene_file(text):
        path = LIBRARY / f"{text}.yaml"
        if not is_file(path):
            raise ConfigError(f"{text}: no such scene in the library, and no file.{near(text, list_scenes())}")
    scene = Scene(parse(schema.SceneFile, read_yaml(path), path.name), path.name, path.parent)
    _ = scene.layout  # so that mistakes show here
    return scene


def scene_from_dict(data: dict[str, Any], where: str = "scene", folder: Path | None = None) -> Scene:
    """A scene from data as a file would hold it; mesh files are relative to `folder`."""
    scene = Scene(parse(schema.SceneFile, data, where), where, folder or Path())
    _ = scene.layout
    return scene


def scene_schema() -> dict[str, Any]:
    """JSON Schema of scene files, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema.SceneFile.model_json_schema()
