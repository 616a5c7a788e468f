"""What a camera sees of a point: pinhole, lens distortion as OpenCV has it, and a flat port that refracts.

Renderers, detectors and estimators use the same equations. The camera frame `c` is OpenCV's: x right, y down, z along
the optical axis, origin at the centre of projection. Pixel (0, 0) is the *centre* of the first pixel, so that an image
of W columns spans -0.5 to W - 0.5.

Reference: Brown (1971), Close-range camera calibration; OpenCV, calib3d, its rational model. Flat port: Treibitz et al.
(2012), Flat refractive geometry, IEEE PAMI 34(1).
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Index, Scalar, Vector2

WATER, GLASS = 1.333, 1.49  # refractive indices: fresh water at 20 deg C, acrylic
_OFF = 0.01  # a ray that comes back further from its pixel than this is none [px]
_NEWTON = 12  # steps to invert distortion and to find the way through a port; each converges quadratically

# A camera's device frame (x forward, y right, z down) from its image frame (x right, y down, z forward).
R_DEVICE_C = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


class Port(eqx.Module):
    """A flat window before the lens, its normal along the optical axis; air behind it, water before it.

    Attributes:
        distance: From the centre of projection to its inner face [m].
        thickness: Of the window [m].
        glass: Refractive index of the window.
        water: Refractive index of the water.
    """

    distance: Scalar
    thickness: Scalar
    glass: Scalar
    water: Scalar

    @classmethod
    def of(cls, distance: float, thickness: float = 0.0, glass: float = GLASS, water: float = WATER) -> "Port":
        return cls(*(as_array(value) for value in (distance, thickness, glass, water)))


class Lens(eqx.Module):
    """Parameters of a camera.

    Attributes:
        focal: f_x, f_y [px].
        principal: c_x, c_y [px].
        distortion: k_1, k_2, p_1, p_2, k_3, k_4, k_5, k_6.
        port: None: the lens looks straight into the water, or its calibration was made there.
        size: Width and height of the image [px].
    """

    focal: Vector2
    principal: Vector2
    distortion: Float[Array, "8"]
    port: Port | None = None
    size: tuple[int, int] = eqx.field(static=True, default=(1920, 1080))

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """K, as OpenCV wants it."""
        (fx, fy), (cx, cy) = np.asarray(self.focal), np.asarray(self.principal)
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def scaled(self, factor: float) -> "Lens":
        """The same camera with an image of `factor` times the pixels a side; pixel centres, not corners, are whole."""
        size = tuple(round(factor * n) for n in self.size)
        principal = factor * (self.principal + 0.5) - 0.5
        return Lens(factor * self.focal, principal, self.distortion, self.port, (size[0], size[1]))


def lens_from(
    focal: object, principal: object, size: tuple[int, int], distortion: object = (), port: Port | None = None
) -> Lens:
    """A Lens; distortion in OpenCV's order, 0 to 8 numbers."""
    d = np.zeros(8)
    given = np.asarray(distortion, dtype=float).ravel()
    d[: len(given)] = given
    return Lens(as_array(focal), as_array(principal), as_array(d), port, size)


def distort(lens: Lens, xy: Float[Array, "*axes 2"]) -> Float[Array, "*axes 2"]:
    """Where the lens puts a ray, in units of the focal length: Brown's model, rational as OpenCV's."""
    k1, k2, p1, p2, k3, k4, k5, k6 = lens.distortion
    x, y = xy[..., 0], xy[..., 1]
    r2 = x * x + y * y
    radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
    tangential = jnp.stack([2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y], axis=-1)
    return radial[..., None] * xy + tangential


def undistort(lens: Lens, xy: Float[Array, "*axes 2"]) -> Float[Array, "*axes 2"]:
    """The inverse of `distort`, by Newton's method.

    Fixed-point iteration, which OpenCV uses, is off by tens of pixels at the corners of a lens with k_1 = 0.31 unless
    it gets a hundred rounds.
    """

    def one(target: Vector2) -> Vector2:
        def newton(_: Index, guess: Vector2) -> Vector2:
            J = jax.jacfwd(lambda p: distort(lens, p))(guess)
            e = distort(lens, guess) - target
            determinant = J[0, 0] * J[1, 1] - J[0, 1] * J[1, 0]
            return guess - jnp.stack([J[1, 1] * e[0] - J[0, 1] * e[1], J[0, 0] * e[1] - J[1, 0] * e[0]]) / determinant

        # From the radius of a pure k_1: near enough for any lens whose model is invertible over its image.
        r2 = target @ target
        return jax.lax.fori_loop(0, _NEWTON, newton, target / (1 + jnp.maximum(lens.distortion[0], 0.0) * r2))

    flat = xy.reshape(-1, 2)
    return jax.vmap(one)(flat).reshape(xy.shape)


def project(lens: Lens, p_c: Float[Array, "*axes 3"]) -> Float[Array, "*axes 2"]:
    """Where points before the camera [m] are in its image [px]; what lies behind it is no number.

    Args:
        lens: The camera's.
        p_c: Points in c; with a port, in the water, beyond its outer face.
    """
    z = jnp.where(p_c[..., 2] > 0, p_c[..., 2], jnp.nan)
    if lens.port is None:
        xy = p_c[..., :2] / z[..., None]
    else:
        radius = jnp.sqrt(jnp.sum(p_c[..., :2] ** 2, axis=-1) + 1e-30)
        xy = (_through(lens.port, radius, z) / radius)[..., None] * p_c[..., :2]
    return lens.focal * distort(lens, xy) + lens.principal


def ray(lens: Lens, pixel: Float[Array, "*axes 2"]) -> tuple[Float[Array, "*axes 3"], Float[Array, "*axes 3"]]:
    """What a pixel [px] looks at: a point [m] and a unit direction in c.

    The point is the centre of projection, or with a port where the ray enters the water.
    """
    return refracted(lens.port, undistort(lens, (pixel - lens.principal) / lens.focal))


def refracted(
    port: Port | None, xy: Float[Array, "*axes 2"]
) -> tuple[Float[Array, "*axes 3"], Float[Array, "*axes 3"]]:
    """A ray behind the port, by its tangents to the right and down, as it goes on in the water: point [m], direction.

    The point is the centre of projection, or with a port where the ray enters the water.
    """
    straight = jnp.concatenate([xy, jnp.ones((*xy.shape[:-1], 1))], axis=-1)
    if port is None:
        direction = straight / jnp.linalg.norm(straight, axis=-1, keepdims=True)
        return jnp.zeros_like(direction), direction
    tangent = jnp.sqrt(jnp.sum(xy**2, axis=-1, keepdims=True) + 1e-30)
    sine = tangent / jnp.sqrt(1 + tangent**2)  # Snell: the same in every medium times its index
    in_glass = sine / jnp.sqrt(port.glass**2 - sine**2)
    in_water = sine / jnp.sqrt(port.water**2 - sine**2)
    outward = xy / tangent
    depth = jnp.full_like(tangent, port.distance + port.thickness)
    point = jnp.concatenate([(port.distance * tangent + port.thickness * in_glass) * outward, depth], axis=-1)
    direction = jnp.concatenate([in_water * outward, jnp.ones_like(tangent)], axis=-1)
    return point, direction / jnp.linalg.norm(direction, axis=-1, keepdims=True)


def seen_ray(lens: Lens, pixel: Float[Array, "*axes 2"]) -> tuple[Float[Array, "*axes 3"], Float[Array, "*axes 3"]]:
    """As `ray`; no number for the direction where the lens's model leads no ray to a pixel."""
    point, direction = ray(lens, pixel)
    back = project(lens, point + direction)
    true = jnp.all(jnp.abs(back - pixel) < _OFF, axis=-1, keepdims=True)
    return point, jnp.where(true, direction, jnp.nan)


def _through(port: Port, radius: Float[Array, "*axes"], z: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
    """Tangent in air of the ray that ends at a radius from the axis, at depth z, through a flat port.

    Radii of the ways through air, glass and water add up; with y the tangent in the water the sum is convex and grows,
    so that Newton's method from above converges.
    """
    n, d, t = port.water, port.distance, port.thickness
    way = jnp.maximum(z - d - t, 1e-6)
    most = 1.0 / jnp.sqrt(n**2 - 1.0)  # beyond this tangent in the water no light gets into the air

    def tangents(y: Float[Array, "*axes"]) -> tuple[Float[Array, "*axes"], Float[Array, "*axes"]]:
        sine = n * y / jnp.sqrt(1 + y**2)
        return sine / jnp.sqrt(1 - sine**2), sine / jnp.sqrt(port.glass**2 - sine**2)

    def reach(y: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
        air, glass = tangents(y)
        return d * air + t * glass + way * y

    def newton(_: Index, y: Float[Array, "*axes"]) -> Float[Array, "*axes"]:
        value, slope = jax.jvp(reach, (y,), (jnp.ones_like(y),))
        return jnp.clip(y - (value - radius) / slope, 0.0, (1 - 1e-9) * most)

    y = jax.lax.fori_loop(0, _NEWTON, newton, jnp.minimum(radius / way, 0.999 * most))
    return tangents(y)[0]
