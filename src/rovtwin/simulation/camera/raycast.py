"""A ray-caster for what is flat: every pixel's own ray, through lens and port as they are.

Pixels that an edge crosses are cast again with 4 x 4 rays. What lies below the surface of a tank is seen a second time
in it, as in a mirror. Runs wherever JAX does.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache, partial
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import Array, jax, jnp
from rovtwin.core.types import Index, Matrix3, Scalar, ScalarLike, Vector3
from rovtwin.simulation.camera.faces import Faces, faces_in_view
from rovtwin.simulation.camera.lighting import Lighting
from rovtwin.simulation.camera.rays import Rays
from rovtwin.simulation.camera.shading import albedo, bend, mottled, net, ripple, shade
from rovtwin.simulation.scene.scene import Scene

BLOCK = 1 << 14  # rays at a time: what fits into the processor's cache
ACROSS = 4  # rays along a side of a pixel that an edge crosses
_NEAR = 0.02  # nothing is seen closer to the camera [m]
_ENDLESS = 1e3  # where nothing is seen [m]
DARK, DARKNESS = 0.25, 0.45  # of the corners of a basin: how far they reach [m], how dark they are


class _Light(eqx.Module):
    surface: Vector3
    below: Scalar
    caustics: Scalar
    beam: Vector3
    diffuse: Vector3
    veil: Vector3
    lamps: Float[Array, "n 8"]
    glow: Vector3
    gain: Vector3
    eye: Vector3


class Raycaster:
    """Draws a scene of rectangles through one lens."""

    def __init__(self, scene: Scene, rays: Rays):
        if scene.meshes or scene.bodies:
            names = ", ".join(mesh.name for mesh in (*scene.meshes, *scene.bodies))
            raise ConfigError(
                f"{scene.where}: {names}: the ray-caster draws boxes, planes and markers only. Meshes, cylinders, "
                "relief and wrecks need the renderer 'gl': pip install 'rovtwin[render]'"
            )
        self.rays, self.scene = rays, scene
        mirrors = (False, True) if scene.file.tank is not None else (False,)
        self._rectangles = [(rectangle, mirrored) for mirrored in mirrors for rectangle in scene.rectangles]
        self._pixel = float(np.median(np.linalg.norm(rays.along[0], axis=-1)))

    def draw(
        self, light: Lighting, R_nc: Float[np.ndarray, "3 3"]
    ) -> tuple[Float[np.ndarray, "H W 3"], Float[np.ndarray, "H W"]]:
        """Brightness, linear, and way to what is seen [m], inf where nothing is."""
        faces = faces_in_view(self._rectangles, light.eye, R_nc, self.rays)
        cast = partial(self._cast, faces, _light_arrays(light), jnp.asarray(R_nc, jnp.float32))
        height, width = self.rays.direction.shape[:2]
        point = np.broadcast_to(self.rays.point, self.rays.direction.shape).reshape(-1, 3)
        colour, way, code = cast(point, self.rays.direction.reshape(-1, 3))
        code = code.reshape(height, width)
        edge = np.flatnonzero(_edges(code))
        if len(edge):
            colour[edge] = self._finer(cast, edge)
        return colour.reshape(height, width, 3), way.reshape(height, width)

    def _finer(self, cast: Any, pixels: Int[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
        """Means over ACROSS x ACROSS rays in each of the pixels (flat indices)."""
        steps = (np.arange(ACROSS) + 0.5) / ACROSS - 0.5
        a, b = (s.ravel().astype(np.float32)[None, :, None] for s in np.meshgrid(steps, steps))

        def spread(field: np.ndarray, slopes: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
            dx, dy = (s.reshape(-1, 3)[pixels][:, None] for s in slopes)
            return (field.reshape(-1, 3)[pixels][:, None] + a * dx + b * dy).reshape(-1, 3)

        direction = spread(self.rays.direction, self.rays.along)
        if self.rays.point_along is None:
            point = np.zeros_like(direction)
        else:
            point = spread(self.rays.point, self.rays.point_along)
        colour, _, _ = cast(point, direction)
        return np.clip(colour, 0.0, 1.0).reshape(len(pixels), ACROSS**2, 3).mean(axis=1)

    def _cast(
        self,
        faces: Faces,
        light: _Light,
        R_nc: Matrix3,
        point: Float[np.ndarray, "n 3"],
        direction: Float[np.ndarray, "n 3"],
    ) -> Any:
        """Of any number of rays, a block at a time."""
        n = len(direction)
        colour, way, code = np.empty((n, 3), np.float32), np.empty(n, np.float32), np.empty(n, np.int32)

        def one(start: int) -> None:
            part = slice(start, min(start + BLOCK, n))
            rays = [np.zeros((BLOCK, 3), np.float32) for _ in range(2)]
            rays[0][: part.stop - start], rays[1][: part.stop - start] = point[part], direction[part]
            found = _block(faces, light, R_nc, rays[0].T, rays[1].T, self._pixel)
            colour[part], way[part], code[part] = (np.asarray(f)[: part.stop - start] for f in found)

        one(0)  # by itself, so that what is not compiled yet is compiled once
        list(_threads().map(one, range(BLOCK, n, BLOCK)))
        return colour, way, code


@lru_cache(maxsize=1)
def _threads() -> ThreadPoolExecutor:
    """As many as there are processors: each block is a call of its own, during which Python is free."""
    many = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return ThreadPoolExecutor(many)


def _edges(code: Int[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """Where a neighbour, also across a corner, shows something else."""
    edge = np.zeros(code.shape, bool)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = code[: code.shape[0] - dy, max(-dx, 0) : code.shape[1] - max(dx, 0)]
        there = code[dy:, max(dx, 0) : code.shape[1] - max(-dx, 0)]
        differs = here != there
        edge[: code.shape[0] - dy, max(-dx, 0) : code.shape[1] - max(dx, 0)] |= differs
        edge[dy:, max(dx, 0) : code.shape[1] - max(-dx, 0)] |= differs
    return edge


def _block(
    faces: Faces, light: _Light, R_nc: Matrix3, o: Any, d: Any, pixel: float
) -> tuple[Float[Array, "n 3"], Float[Array, " n"], Int[Array, " n"]]:
    """Colour, way and a code of what is seen, of rays in c.

    In steps, each a program of its own: in one, XLA computes the noise anew for every band.
    """
    place = _trace(faces, R_nc, light.eye, o, d, pixel)
    rough, bent, rippled = _noises(faces, light, place)
    lines = _lines(place, bent)
    return _colours(faces, light, place, rough, lines, rippled)


class _Place(eqx.Module):
    """What rays hit: way, coordinates on the face, which face (-1: none), point and direction in n, cosine."""

    way: Float[Array, " n"]
    u: Float[Array, " n"]
    v: Float[Array, " n"]
    face: Int[Array, " n"]
    point: tuple[Float[Array, " n"], ...]
    direction: tuple[Float[Array, " n"], ...]
    towards: Float[Array, " n"]
    wide: Float[Array, " n"]


@jax.jit
def _trace(
    faces: Faces,
    R_nc: Matrix3,
    eye: Vector3,
    o: Float[Array, "3 n"],
    d: Float[Array, "3 n"],
    pixel: ScalarLike,
) -> _Place:
    zero = jnp.zeros_like(d[0])

    def nearer(k: Index, best: Any) -> Any:
        n, corner, a, b = faces.normal[k], faces.corner[k], faces.right[k], faces.up[k]
        towards = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
        q = [corner[i] - o[i] for i in range(3)]
        t = (n[0] * q[0] + n[1] * q[1] + n[2] * q[2]) / jnp.where(towards == 0, 1e-12, towards)
        at = [t * d[i] - q[i] for i in range(3)]
        u, v = (at[0] * e[0] + at[1] * e[1] + at[2] * e[2] for e in (a, b))
        inside = (u >= 0) & (v >= 0) & (u <= faces.size[k, 0]) & (v <= faces.size[k, 1]) & (t > _NEAR)
        depth = (
            eye[2] + R_nc[2, 0] * (o[0] + t * d[0]) + R_nc[2, 1] * (o[1] + t * d[1]) + R_nc[2, 2] * (o[2] + t * d[2])
        )
        inside = inside & (faces.below[k] * depth >= 0)
        # A print lies in the face that carries it and is seen before it.
        ahead = inside & (t < best[0] * jnp.where(faces.print[k] > 0, 1.0 + 1e-4, 1.0))
        new = (t, u, v, jnp.full_like(zero, k, dtype=jnp.int32), towards)
        return tuple(jnp.where(ahead, one, other) for one, other in zip(new, best, strict=True))

    nothing = (zero + _ENDLESS, zero, zero, jnp.full_like(zero, -1, dtype=jnp.int32), zero + 1)
    t, u, v, face, towards = jax.lax.fori_loop(0, faces.normal.shape[0], nearer, nothing)
    point = [eye[i] + x for i, x in enumerate(_turned(R_nc, [o[i] + t * d[i] for i in range(3)]))]
    wide = t * jnp.asarray(pixel, jnp.float32) / jnp.maximum(jnp.abs(towards), 0.02)
    return _Place(t, u, v, face, tuple(point), tuple(_turned(R_nc, d)), towards, wide)


@jax.jit
def _noises(
    faces: Faces, light: _Light, place: _Place
) -> tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, " n"]]:
    face = jnp.maximum(place.face, 0)
    u, v = faces.origin[face, 0] + place.u, faces.origin[face, 1] + place.v
    rough = mottled(u, v, place.wide, faces.material[face, 7])
    return rough, bend(place.point), ripple(light, place.point, place.direction, place.wide)


@jax.jit
def _lines(place: _Place, bent: Float[Array, " n"]) -> Float[Array, " n"]:
    return net(place.point, bent, place.wide)


@jax.jit
def _colours(
    faces: Faces,
    light: _Light,
    place: _Place,
    rough: Float[Array, " n"],
    lines: Float[Array, " n"],
    rippled: Float[Array, " n"],
) -> tuple[Float[Array, "n 3"], Float[Array, " n"], Int[Array, " n"]]:
    none, face = place.face < 0, jnp.maximum(place.face, 0)
    u, v = place.u, place.v
    material = [faces.material[face, i] for i in range(faces.material.shape[1])]
    look = albedo(material, faces.origin[face, 0] + u, faces.origin[face, 1] + v, place.wide, rough)
    # Of a marker: white or black, row 0 above.
    count = faces.cells[face]
    cell = faces.size[face, 0] / count
    column = jnp.clip(jnp.floor(u / cell), 0, count - 1).astype(jnp.int32)
    row = jnp.clip(count - 1 - jnp.floor(v / cell), 0, count - 1).astype(jnp.int32)
    printed = (faces.print[face] > 0) & (place.towards < 0)
    bit = jnp.where(printed, faces.bits[face, row, column], 0)
    look = [
        jnp.where(printed, jnp.where(bit > 0, material[i], material[3 + i]), jnp.where(none, 0.0, look[i]))
        for i in range(3)
    ]
    sign = -jnp.sign(place.towards)
    hit = {
        "way": place.way,
        "direction": place.direction,
        "normal": [sign * faces.normal_n[face, i] for i in range(3)],
        "point": place.point,
        "albedo": look,
        "corner": _corner(faces, face, u, v),
        "none": none,
        "net": lines,
        "ripple": rippled,
    }
    colour = jnp.stack(shade(light, hit), axis=-1)
    return colour, jnp.where(none, jnp.inf, place.way), 2 * place.face + bit.astype(jnp.int32)


def _turned(R: Matrix3, p: Any) -> list[Float[Array, " *n"]]:
    return [R[i, 0] * p[0] + R[i, 1] * p[1] + R[i, 2] * p[2] for i in range(3)]


def _corner(faces: Faces, face: Int[Array, " n"], u: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " n"]:
    """How much light reaches a place on a wall or a floor: less towards the edges that others adjoin."""
    size = faces.size[face]
    indoor = faces.indoor[face]  # bit 1: left and right, 2: below, 4: above
    light = jnp.ones_like(u)
    for bits, far in ((1, u), (1, size[:, 0] - u), (2, v), (4, size[:, 1] - v)):
        shut = (indoor & bits) > 0
        light = light * jnp.where(shut, 1 - DARKNESS * jnp.exp(-far / DARK), 1.0)
    return light


def _light_arrays(light: Lighting) -> _Light:
    fields = {name: jnp.asarray(getattr(light, name), jnp.float32) for name in _Light.__dataclass_fields__}
    return _Light(**fields)
