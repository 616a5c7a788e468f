"""A renderer on OpenGL without a window (EGL): meshes, depth, multisampling; a GPU's or Mesa's on a processor.

It draws a pinhole picture, just wide enough for what the lens sees, and `cv2.remap` bends it as lens and port do. With
k_1 > 0 the lens sees *less* at its corners than a pinhole of the same focal length, so that this picture is narrower.
A flat port has no one centre of projection: the pinhole sits where most rays seem to come from, and its picture is bent
once for things at PORT_RANGE, then again for the range that is seen there. What is left are pixels beside edges in
depth.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError
from rovtwin.core.extras import imported
from rovtwin.core.vision import opencv
from rovtwin.simulation.camera.lighting import Lighting
from rovtwin.simulation.camera.rays import Rays
from rovtwin.simulation.camera.shaders import BACKGROUND, BACKGROUND_VERTEX, FRAGMENT, VERTEX
from rovtwin.simulation.scene.scene import Scene
from rovtwin.simulation.scene.surfaces import Material, Mesh, Rectangle

PORT_RANGE = 2.0  # for which a picture through a flat port is bent first [m]
_PORT_ROUNDS = 2  # in which it is then bent for the range that is seen
NEAR, FAR = 0.05, 250.0  # [m]
_AHEAD = 6e-4 * NEAR  # prints before their faces, in clip space: 0.3 per mille of the range
_SAMPLES = 4
_CLIP_DISTANCE0 = 0x3000  # OpenGL's number of it
_WIDEST = 4.0  # tangent of half the field of view that a pinhole picture can reasonably have
_FINE = 0.6  # share of the lens's pixels that the pinhole picture shows at least as finely
_MARGIN = 2  # pixels of the pinhole picture beyond what the lens sees


@lru_cache(maxsize=1)
def context() -> Any:
    """The process's OpenGL context.

    Raises:
        ConfigError: moderngl is not installed, or the machine has no OpenGL.
    """
    moderngl = imported("moderngl", "render", "the renderer 'gl'")
    try:
        settings: dict[str, Any] = {"standalone": True, "backend": "egl", "require": 330}
        made = moderngl.create_context(**settings)
    except Exception as error:
        raise ConfigError(
            f"the renderer 'gl' found no OpenGL 3.3 over EGL ({error}). On a machine without a GPU install Mesa "
            "(Debian: apt install libegl1 libgl1-mesa-dri), or use the renderer 'raycast'"
        ) from None
    made.gc_mode = "auto"
    return made


class Pinhole:
    """The picture that OpenGL draws, and where each pixel of the lens lies in it.

    Attributes:
        size: Width and height [px].
        focal: [px].
        principal: Two numbers [px].
        center: In c [m].
        map_x: Columns of the lens's pixels in it, shape (H, W), float32; map_y rows.
        through_port: Whether these depend on range, and hold for PORT_RANGE.
    """

    def __init__(self, rays: Rays, name: str):
        points, d = rays.point.astype(float), rays.direction.astype(float)
        self.center = np.array([0.0, 0.0, _center(points, d)])
        seen = points + (PORT_RANGE if points.shape[0] > 1 else 1.0) * d - self.center
        tangent = seen[..., :2] / np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        if not np.nanmax(np.abs(tangent)) < _WIDEST or np.isnan(tangent).any():
            raise ConfigError(
                f"camera {name}: sees more than 150 degrees, too much for 'gl'; use the renderer 'raycast'"
            )
        steps = [np.linalg.norm(np.diff(tangent, axis=axis), axis=-1) for axis in (0, 1)]
        self.focal = 1.0 / min(float(np.quantile(step, 1 - _FINE)) for step in steps)
        low, high = tangent.min(axis=(0, 1)), tangent.max(axis=(0, 1))
        self.principal = _MARGIN - self.focal * low
        self.size = tuple(int(n) for n in np.ceil(self.focal * (high - low)) + 2 * _MARGIN + 1)
        self.map_x, self.map_y = self._columns_and_rows(seen)
        self.through_port = points.shape[0] > 1
        if self.through_port:
            from_center = points - self.center
            self._start, self._direction = from_center.astype(np.float32), rays.direction
            self._ahead = (from_center * d).sum(axis=-1).astype(np.float32)

    def maps_at(self, way: Float[np.ndarray, "H W"]) -> tuple[Float[np.ndarray, "H W"], Float[np.ndarray, "H W"]]:
        """The maps for things at a way from the center [m]."""
        along = np.minimum(way, FAR) - self._ahead  # of the ray itself, which starts at the port
        return self._columns_and_rows(self._start + along[..., None] * self._direction)

    def _columns_and_rows(
        self, seen: Float[np.ndarray, "H W 3"]
    ) -> tuple[Float[np.ndarray, "H W"], Float[np.ndarray, "H W"]]:
        x, y = (self.focal * seen[..., i] / seen[..., 2] + self.principal[i] for i in range(2))
        return x.astype(np.float32), y.astype(np.float32)

    @property
    def clip(self) -> Float[np.ndarray, "4 4"]:
        """From c, seen from the centre, to clip space; row 0 of the picture is its top."""
        (w, h), f, c = self.size, self.focal, self.principal
        return np.array(
            [
                [2 * f / w, 0, (2 * c[0] + 1) / w - 1, 0],
                [0, 2 * f / h, (2 * c[1] + 1) / h - 1, 0],
                [0, 0, (FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)],
                [0, 0, 1, 0],
            ]
        )

    @property
    def ray(self) -> Float[np.ndarray, "3 3"]:
        """From (x, y, 1) of the screen, each -1 to 1, to a direction in c."""
        return np.linalg.inv(np.delete(np.delete(self.clip, 2, axis=0), 3, axis=1))


def _center(points: Float[np.ndarray, "_ _ 3"], d: Float[np.ndarray, "H W 3"]) -> float:
    """Where rays seem to come from on the axis [m]: 0, and with a port the middle of where they cross the axis."""
    if points.shape[0] == 1:
        return 0.0
    radius, slope = np.linalg.norm(points[..., :2], axis=-1), np.linalg.norm(d[..., :2], axis=-1)
    off_axis = slope > 1e-3
    return float(np.median((points[..., 2] - radius * d[..., 2] / np.maximum(slope, 1e-9))[off_axis]))


class GlDrawer:
    """Draws a scene through one lens."""

    def __init__(self, scene: Scene, rays: Rays, name: str):
        cv2 = opencv("bending the pictures of the renderer 'gl'")
        self._remap, self._linear = cv2.remap, cv2.INTER_LINEAR
        self.ctx = context()
        self.pinhole = Pinhole(rays, name)
        self.pixel = float(np.median(np.linalg.norm(rays.along[0], axis=-1)))
        self.tank = scene.file.tank is not None
        self._targets()
        self._program = self.ctx.program(vertex_shader=VERTEX, fragment_shader=FRAGMENT)
        self._background = self.ctx.program(vertex_shader=BACKGROUND_VERTEX, fragment_shader=BACKGROUND)
        screen = self.ctx.buffer(np.array([-1, -1, 3, -1, -1, 3], np.float32).tobytes())
        self._screen = self.ctx.vertex_array(self._background, [(screen, "2f", "at")])
        self._upload(scene)

    def _targets(self) -> None:
        size, ctx = self.pinhole.size, self.ctx
        colour = ctx.renderbuffer(size, 4, samples=_SAMPLES, dtype="f2")
        depth = ctx.depth_renderbuffer(size, samples=_SAMPLES)
        self._many = ctx.framebuffer([colour], depth)
        self._one = ctx.framebuffer([ctx.renderbuffer(size, 4, dtype="f2")])

    def _upload(self, scene: Scene) -> None:
        vertices, index, materials, prints = gathered(scene.rectangles, [*scene.meshes, *scene.bodies])
        ctx = self.ctx
        self._materials = ctx.texture((3, len(materials)), 4, materials.astype("f4").tobytes(), dtype="f4")
        side = max((len(p) for p in prints), default=1)
        layers = np.zeros((max(len(prints), 1), side, side), np.float32)
        for layer, cells in zip(layers, prints, strict=False):
            layer[: len(cells), : len(cells)] = cells
        self._prints = ctx.texture_array((side, side, len(layers)), 1, layers.tobytes(), dtype="f4")
        counts = np.array([len(p) for p in prints] or [1], np.float32)
        self._cells = ctx.texture((len(counts), 1), 1, counts.tobytes(), dtype="f4")
        content = [(ctx.buffer(vertices.tobytes()), "3f 3f 2f 2f 4f 2f", *_ATTRIBUTES)]
        self._things = ctx.vertex_array(self._program, content, index_buffer=ctx.buffer(index.tobytes()))

    def draw(
        self, light: Lighting, R_nc: Float[np.ndarray, "3 3"]
    ) -> tuple[Float[np.ndarray, "H W 3"], Float[np.ndarray, "H W"]]:
        """As `Raycaster.draw`."""
        picture = self._pinhole_picture(light, R_nc)
        at = self.pinhole.map_x, self.pinhole.map_y
        if self.pinhole.through_port:
            way = np.ascontiguousarray(picture[..., 3])
            for _ in range(_PORT_ROUNDS):
                at = self.pinhole.maps_at(self._remap(way, *at, self._linear))
        seen = self._remap(picture, *at, self._linear)
        return seen[..., :3], np.where(seen[..., 3] < 0.5 * FAR, seen[..., 3], np.inf)

    def _pinhole_picture(self, light: Lighting, R_nc: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "h w 4"]:
        ctx, pinhole = self.ctx, self.pinhole
        eye = light.eye + R_nc @ pinhole.center
        turn = np.eye(4)
        turn[:3, :3] = R_nc.T
        for program in (self._program, self._background):
            _shared(program, light, eye)
        _set(self._program, "clip", pinhole.clip @ turn)
        _set(self._background, "towards", R_nc @ pinhole.ray)
        _set(self._background, "endless", FAR)
        given = {"surface": light.surface, "diffuse": light.diffuse, "below": light.below, "strength": light.caustics}
        for name, value in (given | {"pixel": self.pixel, "ahead": _AHEAD, "cut": float(self.tank)}).items():
            _set(self._program, name, value)
        for unit, (name, texture) in enumerate(
            (("materials", self._materials), ("prints", self._prints), ("cells", self._cells))
        ):
            texture.use(unit)
            self._program[name] = unit
        self._many.use()
        ctx.disable(ctx.DEPTH_TEST | ctx.CULL_FACE)
        self._many.clear(depth=1.0)
        self._screen.render(vertices=3)
        ctx.enable(ctx.DEPTH_TEST)
        if self.tank:
            ctx.enable_direct(_CLIP_DISTANCE0)  # at the surface of the water
        for flip in (1.0, -1.0) if self.tank else (1.0,):
            self._program["flip"] = flip
            self._things.render()
        ctx.disable_direct(_CLIP_DISTANCE0)
        ctx.copy_framebuffer(self._one, self._many)
        raw = np.frombuffer(self._one.read(components=4, dtype="f2"), np.float16)
        return raw.reshape(pinhole.size[1], pinhole.size[0], 4).astype(np.float32)


def gl_drawer(scene: Scene, rays: Rays, name: str) -> GlDrawer:
    """A drawer.

    Raises:
        ConfigError: What OpenGL needs is missing, or it refuses: its shaders, or a picture larger than it can hold.
    """
    context()  # says what is missing, and that moderngl is there
    import moderngl

    try:
        return GlDrawer(scene, rays, name)
    except moderngl.Error as error:
        raise ConfigError(
            f"camera {name}: OpenGL refuses to draw {rays.direction.shape[1]} x {rays.direction.shape[0]} pixels "
            f"({' '.join(str(error).split())}); make it smaller, update the driver, or use the renderer 'raycast'"
        ) from None


def _shared(program: Any, light: Lighting, eye: Float[np.ndarray, "3"]) -> None:
    for name in ("beam", "veil", "glow", "gain"):
        _set(program, name, getattr(light, name))
    _set(program, "eye", eye)
    _set(program, "lamps", len(light.lamps))
    lamps = np.zeros((8, 4), np.float32)
    for i, lamp in enumerate(light.lamps):
        lamps[2 * i], lamps[2 * i + 1] = (*lamp[:3], lamp[6]), (*lamp[3:6], lamp[7])
    _set(program, "lamp", lamps)


def _set(program: Any, name: str, value: Any) -> None:
    if name not in program:  # left out by the compiler, as nothing depends on it
        return
    if isinstance(value, int):
        program[name] = value
        return
    value = np.asarray(value, np.float32)
    matrix = value.ndim == 2 and value.shape[0] == value.shape[1] and name != "lamp"
    program[name].write((value.T.copy() if matrix else value).tobytes())  # OpenGL has columns first


_ATTRIBUTES = ("at", "out_", "texture_", "local_", "face_", "look_")


def gathered(
    rectangles: list[Rectangle], meshes: list[Mesh]
) -> tuple[Float[np.ndarray, "n 16"], Int[np.ndarray, " k"], Float[np.ndarray, "m 12"], list[np.ndarray]]:
    """Vertices (n, 16), indices, materials (m, 12), prints: all that is drawn, float32 and int32.

    What stands in front comes first, walls last: what is hidden is not shaded.
    """
    materials: list[Material] = []
    vertices, index, prints, start = [], [], [], 0
    for r in rectangles:
        layer = -1.0
        if r.print is not None:
            layer, prints = float(len(prints)), [*prints, r.print]
        size = np.array([np.linalg.norm(r.right), np.linalg.norm(r.up)])
        local = size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        rows = [r.corners, np.tile(r.normal, (4, 1)), np.array(r.origin) + local, local]
        rows += [np.tile([*size, r.indoor, r.both], (4, 1)), np.tile([_number(materials, r.material), layer], (4, 1))]
        vertices.append(np.column_stack(rows))
        index.append(start + np.array([0, 1, 2, 0, 2, 3]))
        start += 4
    for m in meshes:
        n = len(m.vertices)
        rows = [m.vertices, m.normals, _unrolled(m), np.zeros((n, 2)), np.zeros((n, 4))]
        rows += [np.tile([_number(materials, m.material), -1.0], (n, 1))]
        vertices.append(np.column_stack(rows))
        index.append(start + m.triangles.ravel())
        start += n
    if not vertices:
        return np.zeros((3, 16), "f4"), np.zeros(3, "i4"), np.zeros((1, 12), "f4"), []
    index, table = index[::-1], np.array([[*m.numbers, 0.0] for m in materials])
    return np.concatenate(vertices).astype("f4"), np.concatenate(index).astype("i4"), table, prints


def _number(materials: list[Material], material: Material) -> float:
    """Of the material in the list, to which it is added."""
    for i, known in enumerate(materials):
        if known is material:
            return float(i)
    materials.append(material)
    return float(len(materials) - 1)


def _unrolled(mesh: Mesh) -> Float[np.ndarray, "n 2"]:
    """Texture coordinates [m]: a vertex seen along the axis to which its normal is nearest."""
    axis = np.abs(mesh.normals).argmax(axis=1)
    pairs = np.array([[1, 2], [0, 2], [0, 1]])[axis]
    return np.take_along_axis(mesh.vertices, pairs, axis=1)
