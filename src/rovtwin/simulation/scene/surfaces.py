"""What renderers draw: flat rectangles and triangle meshes in n, each with a material."""

from dataclasses import dataclass

import numpy as np

from rovtwin.simulation.scene.schema import Surface
from rovtwin.vehicle.solids.placement import Placement

QUIET = 1  # cells of white around a marker's black border, so that it is found on any ground


@dataclass(frozen=True)
class Material:
    """How a surface looks; colours are linear reflectances, shapes (3,).

    albedo = mix(colour, second, joints and patches) x (1 + mottle x noise)

    Attributes:
        colour: Of most of it.
        second: Of joints between tiles, of patches.
        mottle: Strength of the noise.
        grain: Its coarsest length [m].
        tile: Side of a tile [m]; 0: none.
        joint: Width of a joint [m].
        patches: Share of the noise that changes the colour to `second`.
    """

    colour: np.ndarray
    second: np.ndarray
    mottle: float = 0.0
    grain: float = 1.0
    tile: float = 0.0
    joint: float = 0.0
    patches: float = 0.0

    @classmethod
    def of(cls, surface: Surface) -> "Material":
        colour = linear(np.array(surface.colour))
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
    def numbers(self) -> np.ndarray:
        """All of it, shape (11,), as shaders take it."""
        rest = [self.mottle, self.grain, self.tile, self.joint, self.patches]
        return np.concatenate([self.colour, self.second, rest])


def linear(srgb: np.ndarray) -> np.ndarray:
    """Reflectance of an sRGB colour of shares 0 to 1. IEC 61966-2-1."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


@dataclass(frozen=True)
class Rectangle:
    """A flat rectangle, seen from the side to which `right` x `up` points, or from both.

    Attributes:
        corner: Bottom left for who looks at it, n [m], shape (3,).
        right: Its lower edge [m], shape (3,).
        up: Its left edge, at a right angle to it [m], shape (3,).
        material: How it looks.
        origin: Texture coordinates of the corner [m], shape (2,).
        both: Whether its back is seen too.
        print: Cells of a marker, 1 white, rows from the top, or None.
        indoor: Edges at which another wall or the floor shuts off light: 1 left and right, 2 below, 4 above, added.
    """

    corner: np.ndarray
    right: np.ndarray
    up: np.ndarray
    material: Material
    origin: tuple[float, float] = (0.0, 0.0)
    both: bool = False
    print: np.ndarray | None = None
    indoor: int = 0

    @property
    def normal(self) -> np.ndarray:
        """Towards who looks at it, shape (3,)."""
        n = np.cross(self.right, self.up)
        return n / np.linalg.norm(n)

    @property
    def corners(self) -> np.ndarray:
        """Counter-clockwise for who looks at it, from the bottom left, n [m], shape (4, 3)."""
        return self.corner + np.array([0 * self.right, self.right, self.right + self.up, self.up])


@dataclass(frozen=True)
class Mesh:
    """Triangles in n.

    Attributes:
        vertices: [m], shape (n, 3).
        normals: Outwards, shape (n, 3).
        triangles: Indices, shape (m, 3).
        material: How it looks.
        name: For messages.
    """

    vertices: np.ndarray
    normals: np.ndarray
    triangles: np.ndarray
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


def side(size: np.ndarray, name: str, inside: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle of a side of a box at the origin, and its edges to the right and up for who looks at it, shapes (3,).

    Args:
        size: Of the box [m], shape (3,).
        name: Of the side.
        inside: Seen from within, as the wall of a tank: its north wall looks south.
    """
    out = np.array(SIDES[name][0], dtype=float)
    right, up = (np.array(axis, dtype=float) for axis in SIDES[OPPOSITE[name] if inside else name][1:])
    return 0.5 * size * out, (np.abs(right) @ size) * right, (np.abs(up) @ size) * up


def rectangle(
    middle: np.ndarray,
    right: np.ndarray,
    up: np.ndarray,
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
