"""Rectangles of a scene as the ray-caster wants them: those that may be in the picture, in the camera's frame."""

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.numerics import Array, jnp
from rovtwin.simulation.camera.rays import Rays
from rovtwin.simulation.scene.surfaces import Rectangle

_MOST_CELLS = 11  # 7 x 7 bits with border and rim


class Faces(eqx.Module):
    """Rectangles in c at one instant, float32; first axis: faces."""

    corner: Float[Array, "faces 3"]
    normal: Float[Array, "faces 3"]
    normal_n: Float[Array, "faces 3"]  # in n
    right: Float[Array, "faces 3"]  # unit
    up: Float[Array, "faces 3"]  # unit
    size: Float[Array, "faces 2"]
    origin: Float[Array, "faces 2"]
    material: Float[Array, "faces 11"]
    indoor: Int[Array, " faces"]
    below: Float[Array, " faces"]  # 1 where only what is below the surface counts, -1 above it (mirrored), 0 all
    print: Float[Array, " faces"]  # 1 where it is a marker
    cells: Float[Array, " faces"]  # along a side of its print
    bits: Float[Array, "faces 11 11"]


def faces_in_view(
    rectangles: list[tuple[Rectangle, bool]], eye: Float[np.ndarray, "3"], R_nc: Float[np.ndarray, "3 3"], rays: Rays
) -> Faces:
    """Rectangles that may be in the picture, in c; how many there are is rounded up, so that little is compiled.

    Args:
        rectangles: Each with whether it is what the surface mirrors.
        eye: Where the camera is, n [m].
        R_nc: Maps c to n.
        rays: Of the camera's pixels.
    """
    border = np.concatenate([rays.direction[i] for i in (0, -1)] + [rays.direction[:, i] for i in (0, -1)])
    tangent = border[:, :2] / np.maximum(border[:, 2:], 1e-3)
    low, high = tangent.min(axis=0), tangent.max(axis=0)
    rows, tank = [], any(mirrored for _, mirrored in rectangles)
    for rectangle, mirrored in rectangles:
        flip = np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
        corners = (rectangle.corners * flip - eye) @ R_nc
        normal = R_nc.T @ (rectangle.normal * flip)
        in_front = corners[0] @ normal < 0
        if not (in_front or rectangle.both) or (corners[:, 2] < 0).all():
            continue
        margin = 0.1  # a port moves rays aside by less than this
        outside = [(corners[:, i] > high[i] * corners[:, 2] + margin).all() for i in range(2)]
        outside += [(corners[:, i] < low[i] * corners[:, 2] - margin).all() for i in range(2)]
        if not any(outside):
            rows.append((rectangle, corners, normal, -1.0 if mirrored else float(tank)))
    return _as_faces(rows, R_nc)


_SHAPES: dict[str, tuple[int, ...]] = {
    "corner": (3,), "normal": (3,), "normal_n": (3,), "right": (3,), "up": (3,), "size": (2,), "origin": (2,),
    "material": (11,), "indoor": (), "below": (), "print": (), "cells": (), "bits": (_MOST_CELLS, _MOST_CELLS),
}  # fmt: skip


def _as_faces(
    rows: list[tuple[Rectangle, Float[np.ndarray, "4 3"], Float[np.ndarray, "3"], float]],
    R_nc: Float[np.ndarray, "3 3"],
) -> Faces:
    count = max(-(-len(rows) // 8) * 8, 8)
    table = {name: np.zeros((count, *shape)) for name, shape in _SHAPES.items()}
    table["size"] -= 1.0  # of those that are not there: nothing is inside of them
    table["material"] += 1.0
    table["cells"] += 1.0
    for k, (rectangle, corners, normal, below) in enumerate(rows):
        right, up = corners[1] - corners[0], corners[3] - corners[0]
        table["size"][k] = np.linalg.norm(right), np.linalg.norm(up)
        table["corner"][k], table["normal"][k], table["normal_n"][k] = corners[0], normal, R_nc @ normal
        table["right"][k], table["up"][k] = right / table["size"][k, 0], up / table["size"][k, 1]
        table["origin"][k], table["material"][k] = rectangle.origin, rectangle.material.numbers
        table["indoor"][k], table["below"][k] = rectangle.indoor, below
        if rectangle.print is not None:
            cells = len(rectangle.print)
            table["print"][k], table["cells"][k] = 1.0, cells
            table["bits"][k, :cells, :cells] = rectangle.print
    return Faces(**{k: jnp.asarray(v, jnp.int32 if k == "indoor" else jnp.float32) for k, v in table.items()})
