"""How a camera on a vehicle sees a marker: geometry that detector, observers and smoother share.

Attitude as measured is R_meas; the true one is exp(o) R_meas exp(d), with an offset o in n (a compass that does not
know north of the tank) and noise d in b. A marker of pose (p_nm, R_nm) is disturbed as (p_nm + e, R_nm exp(f)).
"""

from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.frames import skew
from rovtwin.core.markers import CORNERS
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import Flag, Index, Matrix3, Scalar, Vector3
from rovtwin.vehicle.description.cameras import Camera
from rovtwin.vehicle.physics.camera import Lens, Port, project

NEAREST = 0.05  # a corner nearer than this to the plane of the lens is not seen [m]
_THIN = 1e-6  # distance of a port that is none [m]
DEFAULT_SIZE = 0.15  # side of a marker nobody said anything about: the thesis's [m]


class Eyes(eqx.Module):
    """Cameras of one vehicle, stacked: leading axis is the camera.

    Attributes:
        lens: All their parameters; `size` is that of the first.
        position: Centres of projection in b [m].
        R_bc: Map c to b.
    """

    lens: Lens
    position: Float[Array, "cameras 3"]
    R_bc: Float[Array, "cameras 3 3"]

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> "Eyes":
        """Stacked; beside one with a port, one without gets a port that does not bend light."""
        size = cameras[0].lens.size
        ports = [c.lens.port for c in cameras]
        if any(ports):
            ports = [port or Port.of(_THIN, glass=1.0, water=1.0) for port in ports]
        both = zip(cameras, ports, strict=True)
        lenses = [Lens(c.lens.focal, c.lens.principal, c.lens.distortion, port, size) for c, port in both]
        lens = jax.tree.map(lambda *leaves: jnp.stack(leaves), *lenses)
        return cls(lens, as_array([c.position for c in cameras]), as_array([c.R_bc for c in cameras]))

    def __getitem__(self, camera: Index | int) -> "Eyes":
        return jax.tree.map(lambda leaf: leaf[camera], self)


class Seen(eqx.Module):
    """Corners of one marker as one camera should see them, and how that changes.

    Attributes:
        pixels: x and y of the four corners in turn.
        by_position: Derivative by the vehicle's position [px/m].
        by_offset: By the offset o of the attitude [px/rad].
        by_noise: By its noise d.
        by_marker: By the marker's e and f.
        visible: Whether all corners are before the camera.
    """

    pixels: Float[Array, "8"]
    by_position: Float[Array, "8 3"]
    by_offset: Float[Array, "8 3"]
    by_noise: Float[Array, "8 3"]
    by_marker: Float[Array, "8 6"]
    visible: Flag


def see(eye: Eyes, p_nb: Vector3, R_nb: Matrix3, p_nm: Vector3, R_nm: Matrix3, size: Scalar) -> Seen:
    """What a camera sees of a marker.

    Args:
        eye: One camera (no leading axis).
        p_nb: Position of the vehicle [m].
        R_nb: Its attitude.
        p_nm: Position of the marker [m].
        R_nm: Its attitude.
        size: Side of the marker [m].
    """
    flat = size * jnp.asarray(CORNERS)
    around = flat @ R_nm.T  # corners from the marker's middle, n
    from_b = (p_nm + around - p_nb) @ R_nb  # from CO, b
    in_c = (from_b - eye.position) @ eye.R_bc
    visible = (in_c[:, 2] > NEAREST).all()
    # A point that is not seen is replaced: NaN, even where it is not used, would spoil gradients.
    in_c = jnp.where(visible, in_c, jnp.array([0.0, 0.0, 1.0]))
    pixels = project(eye.lens, in_c)
    slope = jax.vmap(jax.jacfwd(lambda p: project(eye.lens, p)))(in_c)  # (4, 2, 3)
    by_b = slope @ eye.R_bc.T  # by a shift in b
    by_n = by_b @ R_nb.T
    turned = jax.vmap(skew)
    return Seen(
        pixels.reshape(8),
        -by_n.reshape(8, 3),
        (by_n @ turned(p_nm + around - p_nb)).reshape(8, 3),
        (by_b @ turned(from_b)).reshape(8, 3),
        jnp.concatenate([by_n, -by_n @ R_nm @ turned(flat)], axis=-1).reshape(8, 6),
        visible,
    )


def sizes_of(table: dict[int, float], count: int = 1000, default: float = DEFAULT_SIZE) -> Float[Array, " {count}"]:
    """Side of each marker by its id [m]."""
    sizes = np.full(count, default)
    for number, size in table.items():
        sizes[number] = size
    return as_array(sizes)
