"""What renderers draw: flat rectangles and triangle meshes in n, each with a material."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int, UInt8

from rovtwin.imaging.spectra.materials import reflectance
from rovtwin.simulation.scene.schema import BANDS, Surface
from rovtwin.vehicle.solids.placement import Placement

QUIET = 1  # cells of white around a marker's black border, so that it is found on any ground


@dataclass(frozen=True)
class Material:
    """How a surface looks; colours are linear reflectances.

    albedo = mix(colour, second, joints and patches) x (1 + mottle x noise)

    Attributes:
        colour: Of most of it.
        second: Of joints between tiles, of patches.
        mottle: Strength of the noise.
        grain: Its coarsest length [m].
        tile: Side of a tile [m]; 0: none.
        joint: Width of a joint [m].
        patches: Share of the noise that changes the colour to `second`.
        spectrum: Name of the material whose spectrum it has; "": as smooth as its colour.
    """

    colour: Float[np.ndarray, "3"]
    second: Float[np.ndarray, "3"]
    mottle: float = 0.0
    grain: float = 1.0
    tile: float = 0.0
    joint: float = 0.0
    patches: float = 0.0
    spectrum: str = ""

    @classmethod
    def of(cls, surface: Surface) -> "Material":
        """As a scene file says it; a material without a colour of its own has that of its spectrum."""
        colour = linear(np.array(surface.colour))
        if surface.material is not None and "colour" not in surface.model_fields_set:
            colour = reflectance(surface.material, BANDS)
        return replace(cls._textured(surface, colour), spectrum=surface.material or "")

    @classmethod
    def _textured(cls, surface: Surface, colour: Float[np.ndarray, "3"]) -> "Material":
        match surface.texture:
            case "tiles":
                return cls(colour, 0.45 * colour, 0.10, 0.9, surface.tile, 0.03 * surface.tile)
            case "concrete":
                return cls(colour, 0.72 * colour, 0.22, 0.7, patches=0.35)
            case "sand":
                return cls(colour, 0.62 * colour, 0.30, 0.9, patches=0.45)
            case "rust":
                return cls(colour, np.array([0.16, 0.045, 0.015]), 0.40, 0.5, patches=0.9)
        return cls(colour, colour, 0.06, 0.5)

    @property
    def numbers(self) -> Float[np.ndarray, "11"]:
        """All of it, as shaders take it."""
        rest = [self.mottle, self.grain, self.tile, self.joint, self.patches]
        return np.concatenate([self.colour, self.second, rest])


def linear(srgb: Float[np.ndarray, "*axes"]) -> Float[np.ndarray, "*axes"]:
    """Reflectance of an sRGB colour of shares 0 to 1. IEC 61966-2-1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


@dataclass(frozen=True)
class Rectangle:
    """A flat rectangle, seen from the side to which `right` x `up` points, or from both.

    Attributes:
        corner: Bottom left for who looks at it, n [m].
        right: Its lower edge [m].
        up: Its left edge, at a right angle to it [m].
        material: How it looks.
        origin: Texture coordinates of the corner [m].
        both: Whether its back is seen too.
        print: Cells of a marker, 1 white, rows from the top, or None.
        indoor: Edges at which another wall or the floor shuts off light: 1 left and right, 2 below, 4 above, added.
    """

    corner: Float[np.ndarray, "3"]
    right: Float[np.ndarray, "3"]
    up: Float[np.ndarray, "3"]
    material: Material
    origin: tuple[float, float] = (0.0, 0.0)
    both: bool = False
    print: UInt8[np.ndarray, "cells cells"] | None = None
    indoor: int = 0

    @property
    def normal(self) -> Float[np.ndarray, "3"]:
        """Towards who looks at it."""
        n = np.cross(self.right, self.up)
        return n / np.linalg.norm(n)

    @property
    def corners(self) -> Float[np.ndarray, "4 3"]:
        """Counter-clockwise for who looks at it, from the bottom left, n [m]."""
        return self.corner + np.array([0 * self.right, self.right, self.right + self.up, self.up])


@dataclass(frozen=True)
class Mesh:
    """Triangles in n.

    Attributes:
        vertices: [m].
        normals: Outwards.
        triangles: Indices.
        material: How it looks.
        name: For messages.
    """

    vertices: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    triangles: Int[np.ndarray, "m 3"]
    material: Material
    name: str = ""


# Sides of a box by where they look: outward normal, and right and up for who looks at it.
SIDES: dict[str, tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]] = {
    "north": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "south": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "east": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    "west": ((0, -1, 0), (-1, 0, 0), (0, 0, -1)),
    "top": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "bottom": ((0, 0, 1), (0, -1, 0), (1, 0, 0)),
}
OPPOSITE = {"north": "south", "south": "north", "east": "west", "west": "east", "top": "bottom", "bottom": "top"}


def side(
    size: Float[np.ndarray, "3"], name: str, inside: bool = False
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Middle of a side of a box at the origin, and its edges to the right and up for who looks at it.

    Args:
        size: Of the box [m].
        name: Of the side.
        inside: Seen from within, as the wall of a tank: its north wall looks south.
    """
    out = np.array(SIDES[name][0], dtype=float)
    right, up = (np.array(axis, dtype=float) for axis in SIDES[OPPOSITE[name] if inside else name][1:])
    return 0.5 * size * out, (np.abs(right) @ size) * right, (np.abs(up) @ size) * up


def rectangle(
    middle: Float[np.ndarray, "3"],
    right: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"],
    place: Placement,
    material: Material,
    both: bool = False,
    indoor: int = 0,
) -> Rectangle:
    """A rectangle given in a frame that sits at `place` in n; its texture lies in that frame."""
    R = place.rotation
    corner = middle - 0.5 * (right + up)
    origin = (float(corner @ right / np.linalg.norm(right)), float(corner @ up / np.linalg.norm(up)))
    return Rectangle(place.position + R @ corner, R @ right, R @ up, material, origin, both, indoor=indoor)
