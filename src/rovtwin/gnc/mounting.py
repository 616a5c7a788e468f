"""Where sensors sit and how they point, and their readings as they would be at CO along the axes of b."""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import Measurements, Slot
from rovtwin.core.frames import cross, readings_in_body
from rovtwin.core.numerics import Array, as_array, jnp
from rovtwin.core.sensors import IMU, kind_of
from rovtwin.core.types import Matrix3, Scalar, Vector3


class Mount(eqx.Module):
    """A sensor as an observer knows it.

    Attributes:
        std: Of its noise, of all its axes or of each.
        lever: Its place seen from CO, b [m].
        rotation: R_bs, maps its axes to b.
        sight: Of an acoustic position, in place of `std`: along the line of sight from n's origin and across it [m],
            and how that grows, as the root of the sum of squares, per metre of range; or None.
    """

    std: Scalar | Float[Array, " n"] = eqx.field(converter=as_array)
    lever: Vector3 = eqx.field(converter=as_array, default=(0.0, 0.0, 0.0))
    rotation: Matrix3 = eqx.field(converter=as_array, default_factory=lambda: np.eye(3))
    sight: Vector3 | None = None

    @property
    def variance(self) -> Vector3:
        """Of the noise of three axes, along those of b."""
        return (self.rotation * self.rotation) @ jnp.broadcast_to(self.std**2, 3)


def at_co(measurements: Measurements, mounts: dict[str, Mount], R_nb: Matrix3, omega: Vector3) -> Measurements:
    """Readings as sensors at CO along the axes of b would give them, with an estimated attitude and turn rate.

    Only turned is specific force: what its lever adds takes the angular acceleration, which readings do not tell.

    Args:
        measurements: As they came; sensors that `mounts` lacks pass as they are.
        mounts: By name.
        R_nb: Attitude, maps b to n.
        omega: Angular velocity, b [rad/s].
    """
    return {
        name: slot if name not in mounts else _moved(slot, kind_of(name), mounts[name], R_nb, omega)
        for name, slot in measurements.items()
    }


def _moved(slot: Slot, kind: str, mount: Mount, R_nb: Matrix3, omega: Vector3) -> Slot:
    lever = mount.lever
    if kind == "position":
        value = slot.value - (R_nb @ lever)[:2]
    elif kind == "pressure":
        value = slot.value - (R_nb @ lever)[2]
    elif kind == "dvl":
        value = slot.value @ mount.rotation.T - cross(omega, lever)
    elif kind in IMU:
        value = readings_in_body(slot.value, kind, mount.rotation)
    else:
        return slot
    return Slot(value, slot.valid, slot.t_valid)
