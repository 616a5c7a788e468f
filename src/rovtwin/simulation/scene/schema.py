"""What a scene file may say: water, a tank or a bottom, objects in it, markers, light. Everything stands still."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from rovtwin.core.markers import DICTIONARIES, Marker
from rovtwin.core.user_files.config import Degrees, NonNegative, Number, Positive, Share, Strict, Vector3, near
from rovtwin.imaging.spectra.materials import MATERIALS
from rovtwin.imaging.spectra.water import Constituents
from rovtwin.vehicle.description.fields import Colour
from rovtwin.vehicle.description.schema import Cylinder, Pose

WATERS = (
    "clear_tank",
    *(f"jerlov_{kind}" for kind in ("I", "IA", "IB", "II", "III", "1C", "3C", "5C", "7C", "9C")),
)


BANDS = np.array([600.0, 550.0, 450.0])  # red, green and blue of a camera [nm]
ThreeBands = Annotated[list[NonNegative], Field(min_length=3, max_length=3)]


class Surface(Strict):
    """How a surface looks."""

    colour: Colour = Field([0.8, 0.8, 0.8], description="sRGB, '#rrggbb' or three shares")
    texture: Literal["plain", "tiles", "concrete", "sand", "rust"] = "plain"
    tile: Positive = Field(0.2, description="side of a tile, with texture 'tiles' [m]")
    material: str | None = Field(
        None, description=f"whose spectrum it has, instead of one as smooth as its colour: {', '.join(MATERIALS)}"
    )

    @model_validator(mode="after")
    def _known(self) -> "Surface":
        _require_material(self.material)
        return self


def _require_material(name: str | None) -> None:
    if name is not None and name not in MATERIALS:
        raise ValueError(f"material: found {name!r}, expected one of {', '.join(MATERIALS)}.{near(name, MATERIALS)}")


class Water(Strict):
    """How far one sees. Bands are red, green, blue: 600, 550, 450 nm."""

    type: str = Field("clear_tank", description=", ".join(WATERS))
    absorption: ThreeBands | None = Field(None, description="a, instead of the type's [1/m]")
    scattering: ThreeBands | None = Field(None, description="b, instead of the type's [1/m]")
    beam_attenuation: Positive | None = Field(
        None, description="c = a + b in green [1/m]: scattering follows, the same in all bands (turbid water)"
    )
    constituents: Constituents | None = Field(
        None, description="what is in the water beside water, by which it is known at all wavelengths"
    )

    @model_validator(mode="after")
    def _known(self) -> "Water":
        if self.type not in WATERS:
            raise ValueError(f"type: found {self.type!r}, expected one of {', '.join(WATERS)}")
        if self.scattering is not None and self.beam_attenuation is not None:
            raise ValueError("found scattering and beam_attenuation, expected one of them")
        others = ("absorption", "scattering", "beam_attenuation")
        if self.constituents is not None and (also := [key for key in others if getattr(self, key) is not None]):
            raise ValueError(f"found constituents and {also[0]}, expected one of them")
        return self


class Tank(Strict):
    """A rectangular basin filled to the brim; x along its length."""

    length: Positive = Field(description="[m]")
    width: Positive = Field(description="[m]")
    depth: Positive = Field(description="of the water [m]")
    position: Vector3 = Field([0.0, 0.0, 0.0], description="middle of the water's surface, n [m]")
    heading_deg: Degrees = Field(0.0, description="of its length")
    walls: Surface = Field(default_factory=lambda: Surface.model_validate({}))
    floor: Surface = Field(default_factory=lambda: Surface.model_validate({}))

    @model_validator(mode="after")
    def _level(self) -> "Tank":
        if self.position[2] != 0:
            raise ValueError(f"position: found depth {self.position[2]:g} of the surface, expected 0")
        return self


class Relief(Strict):
    """Ups and downs of a bottom, made from a seed: ripples on hills."""

    size: Positive = Field(80.0, description="side of the square that is shown [m]")
    height: NonNegative = Field(0.6, description="of the hills, trough to crest [m]")
    length: Positive = Field(12.0, description="from hill to hill [m]")
    seed: Annotated[int, Field(ge=0, strict=True)] = 1


class Cover(Strict):
    """A material that lies on the bottom in patches, made from a seed; imagers see it, cameras do not."""

    material: str = Field(description=f"one of {', '.join(MATERIALS)}")
    share: Share = Field(description="of the bottom that it covers")
    length: Positive = Field(2.0, description="of the largest patches [m]")
    seed: Annotated[int, Field(ge=0, strict=True)] = 1

    @model_validator(mode="after")
    def _known(self) -> "Cover":
        _require_material(self.material)
        return self


class Bottom(Strict):
    """The bottom of open water."""

    depth: Positive = Field(description="[m]")
    surface: Surface = Field(default_factory=lambda: Surface.model_validate({"colour": "#b8a888", "texture": "sand"}))
    relief: Relief | None = None
    cover: list[Cover] = Field([], max_length=8, description="what lies on it, each over those before")


class MeshFile(Strict):
    """A body from a file."""

    file: str = Field(description="STL, OBJ, PLY or GLB, relative to the scene file; x forward, y right, z down")
    scale: Positive = Field(1.0, description="0.001 where the file is in mm")


class Wreck(Strict):
    """The hull of a small boat, made here: open above, planks gone on one side."""

    length: Positive = Field(8.0, description="[m]")
    seed: Annotated[int, Field(ge=0, strict=True)] = 1


class Object(Strict):
    """Something solid."""

    name: str
    box: list[Positive] | None = Field(None, min_length=3, max_length=3, description="length, width, height [m]")
    cylinder: Cylinder | None = Field(None, description="along its x")
    plane: list[Positive] | None = Field(
        None, min_length=2, max_length=2, description="length, width [m]: a thin plate that faces up"
    )
    mesh: MeshFile | None = None
    wreck: Wreck | None = None
    pose: Pose = Field(default_factory=lambda: Pose.model_validate({}), description="of its middle, n")
    surface: Surface = Field(default_factory=lambda: Surface.model_validate({}))

    @model_validator(mode="after")
    def _one_kind(self) -> "Object":
        kinds = [k for k in ("box", "cylinder", "plane", "mesh", "wreck") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise ValueError(
                f"found {' and '.join(kinds) or 'none'}, expected one of box, cylinder, plane, mesh, wreck"
            )
        return self


class FaceMarker(Strict):
    """A marker on a face."""

    id: Annotated[int, Field(ge=0, strict=True)]
    size: Positive = Field(description="side of the black square [m]")
    at: Annotated[list[Number], Field(min_length=2, max_length=2)] = Field(
        description="right and up from the middle of the face, for who looks at it [m]"
    )
    roll_deg: Degrees = 0.0


class OnFace(Strict):
    """Markers on a face of a box, named by where it looks when the box is not turned, or on a wall of the tank."""

    object: str = Field(description="name of a box, or 'tank'")
    face: Literal["north", "south", "east", "west", "top", "bottom"]
    markers: list[FaceMarker]


class Markers(Strict):
    """Markers of one dictionary."""

    dictionary: str = Field("DICT_4X4_50", description="of OpenCV's, " + ", ".join(DICTIONARIES[:4]) + " ..")
    free: list[Marker] = Field([], description="with their place in n; each a thin board")
    on_faces: list[OnFace] = Field([], description="hung on boxes and walls")


class Lamp(Strict):
    """A lamp of the vehicle."""

    position: Vector3 = Field(description="in b at CO [m]")
    direction: Vector3 = Field([1.0, 0.0, 0.0], description="of its axis, b")
    beam_deg: Annotated[Number, Field(gt=0, le=180)] = Field(90.0, description="between half-power directions")
    power: NonNegative = Field(1.0, description="on its axis at 1 m in clear air, over full daylight at the surface")


class Light(Strict):
    """What lights the scene."""

    surface: NonNegative = Field(1.0, description="daylight or ceiling lamps at the water's surface, 1 as exposed for")
    below: Share = Field(0.35, description="of it on a face that looks down: light from the bottom and the sides")
    caustics: Share = Field(0.25, description="strength of the bright net that a moving surface throws on things")
    lamps: list[Lamp] = Field([], max_length=4)


class SceneFile(Strict):
    """A scene file."""

    name: str
    description: str = ""
    water: Water = Field(default_factory=lambda: Water.model_validate({}))
    tank: Tank | None = None
    bottom: Bottom | None = None
    objects: list[Object] = []
    markers: Markers = Field(default_factory=lambda: Markers.model_validate({}))
    light: Light = Field(default_factory=lambda: Light.model_validate({}))

    @model_validator(mode="after")
    def _consistent(self) -> "SceneFile":
        names = [o.name for o in self.objects]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"objects: the name '{twice[0]}' is given twice; names must differ")
        if self.tank is not None and self.bottom is not None:
            raise ValueError("found tank and bottom, expected one of them: a tank has its own floor")
        if "tank" in names:
            raise ValueError("objects: the name 'tank' means the walls; give the object another one")
        return self
