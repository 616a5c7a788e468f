"""Added mass of simple solids, and its move from a part's frame to the vehicle's.

Exact for spheres and ellipsoids; for boxes and cylinders from published three-dimensional data; for meshes a mean of
these (`mesh_solid`). Flow interaction between parts is neglected: each part is alone in the water. Plain NumPy: done
once per vehicle, on the host.

References: DNV-RP-N103 (2017), Modelling and analysis of marine operations, table A-2 and sec. 4.6.3 (boxes and
cylinders); Lamb (1932), Hydrodynamics, sec. 114-115 (ellipsoids); Fossen (2021), eq. 3.34 ff. (system transformation).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.vehicle.description.schema import Shape
from rovtwin.vehicle.description.totals.rigid_body import MassProperties
from rovtwin.vehicle.solids.mesh_solid import MeshSolid, mesh_solid, open_share
from rovtwin.vehicle.solids.placement import Placement

# DNV-RP-N103, table A-2: rectangular plate a x b moving across itself, C_A on the reference volume pi/4 a^2 b.
_PLATE_ASPECT = np.array([1.0, 1.25, 1.5, 1.59, 2.0, 2.5, 3.0, 4.0, 5.0, 6.25, 8.0, 10.0])
_PLATE_C_A = np.array([0.579, 0.642, 0.690, 0.704, 0.757, 0.801, 0.830, 0.871, 0.897, 0.917, 0.934, 0.947])
# The same table: circular cylinder of radius a and length b moving across its axis, C_A on pi a^2 b.
_CYLINDER_ASPECT = np.array([0.0, 1.2, 2.5, 5.0, 9.0])
_CYLINDER_C_A = np.array([0.0, 0.62, 0.78, 0.90, 0.96])

# A rectangle 2a x 2b turning in plane flow, a >= b: m = k pi rho a^4 at b / a. Plate and square: Newman (1977), Marine
# Hydrodynamics, table 4.3; between them, and the loss at the open ends, height / (height + 0.16 length), fitted to our
# own panel runs of seven boxes: within 10 % of coarse ones; of the limit of fine panels (docs/scripts/priors.py) within
# 12 % in translation and 22 % in rotation.
_SECTION_ASPECT = np.array([0.0, 0.2, 0.5, 0.75, 1.0])
_SECTION_TURNING = np.array([0.125, 0.147, 0.153, 0.178, 0.231])
_END_LOSS = 0.16

# Usual drag coefficients for Re 1e4 to 1e5: blunt prism, cylinder along and across, sphere. Hoerner (1965), ch. 3.
_BOX_C_D, _CYLINDER_C_D, _SPHERE_C_D = (1.1, 1.1, 1.1), (0.9, 1.0, 1.0), (0.47, 0.47, 0.47)

# The same by axis for a box, cylinders along x, y, z, and an ellipsoid: a mesh is a mean of these.
_MESH_C_D = np.array([_BOX_C_D, *(np.roll(_CYLINDER_C_D, axis) for axis in range(3)), _SPHERE_C_D])

_LAMB_X, _LAMB_W = np.polynomial.legendre.leggauss(100)  # of Lamb's integrals: 1e-10 up to 50 times as long as wide


@dataclass(frozen=True)
class Solid:
    """A shape in numbers.

    Attributes:
        kind: "box", "cylinder" (along x), "ellipsoid" or "mesh".
        size: Full dimensions along its own axes [m]; of a mesh those of the box around it.
        drag_coefficient: On the projected areas.
        placement: Of the middle and axes of the box around it.
        mesh: What there is to know of a mesh.
    """

    kind: str
    size: Float[np.ndarray, "3"]
    drag_coefficient: Float[np.ndarray, "3"]
    placement: Placement
    mesh: MeshSolid | None = None

    @classmethod
    def of(cls, shape: Shape) -> "Solid":
        if shape.mesh is not None:
            return cls._of_mesh(shape, mesh_solid(shape.mesh, shape.scale or 1.0))
        if shape.box is not None:
            kind, size, usual = "box", shape.box, _BOX_C_D
        elif shape.cylinder is not None:
            kind, usual = "cylinder", _CYLINDER_C_D
            size = [shape.cylinder.length, 2 * shape.cylinder.radius, 2 * shape.cylinder.radius]
        elif shape.sphere is not None:
            kind, size, usual = "ellipsoid", [2 * shape.sphere] * 3, _SPHERE_C_D
        else:
            kind, size, usual = "ellipsoid", [2 * a for a in shape.ellipsoid or []], _SPHERE_C_D
        given = usual if shape.drag_coefficient is None else shape.drag_coefficient
        return cls(kind, np.array(size), np.array(given), Placement.of(shape.center, shape.attitude_deg))

    @classmethod
    def _of_mesh(cls, shape: Shape, mesh: MeshSolid) -> "Solid":
        given = mesh.weights @ _MESH_C_D if shape.drag_coefficient is None else shape.drag_coefficient
        box = Placement(mesh.middle, mesh.rotation).after(Placement.of(shape.center, shape.attitude_deg))
        return cls("mesh", mesh.size, np.array(given), box, mesh)

    def centered(self) -> Placement:
        """Its axes with the origin at its centre of volume, in the part's frame."""
        center = np.zeros(3) if self.mesh is None else self.mesh.centroid
        return Placement(self.placement.point(center), self.placement.rotation)

    def volume(self) -> float:
        """[m3]."""
        if self.mesh is not None:
            return self.mesh.volume
        fill = {"box": 1.0, "cylinder": np.pi / 4, "ellipsoid": np.pi / 6}[self.kind]
        return float(fill * np.prod(self.size))

    def homogeneous(self, mass: float) -> MassProperties:
        """Mass properties of the solid filled evenly, in the part's frame."""
        if self.mesh is not None:
            second = self.mesh.second_moment
            inertia = mass * (np.trace(second) * np.eye(3) - second)
            return MassProperties(mass, np.zeros(3), inertia).moved(self.centered())
        squares = self.size**2
        if self.kind == "cylinder":
            share = np.array([1 / 12, 1 / 16, 1 / 16])
        else:
            share = np.full(3, 1 / 12 if self.kind == "box" else 1 / 20)
        second = share * squares
        inertia = mass * np.diag(second.sum() - second)
        return MassProperties(mass, np.zeros(3), inertia).moved(self.placement)

    def projected_areas(self) -> Float[np.ndarray, "3"]:
        """Seen along x, y, z [m2]."""
        if self.mesh is not None:
            return self.mesh.areas
        length, width, height = self.size
        areas = np.array([width * height, length * height, length * width])
        if self.kind == "ellipsoid":
            return np.pi / 4 * areas
        return areas * np.array([np.pi / 4, 1, 1]) if self.kind == "cylinder" else areas


def added_mass(solid: Solid, density: float) -> Float[np.ndarray, "6 6"]:
    """M_A in the part's frame at its origin, of a solid alone in water of a density [kg/m3]."""
    if solid.kind == "ellipsoid":
        diagonal = _ellipsoid(solid.size / 2)
    elif solid.kind == "cylinder":
        diagonal = _cylinder(solid.size)
    elif solid.mesh is not None:
        diagonal = _mesh(solid.mesh)
    else:
        diagonal = _box(solid.size)
    return move_matrix(density * np.diag(diagonal), solid.centered())


def _ellipsoid(axes: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6"]:
    """Exact, per unit density: Lamb (1932), sec. 114 (5) and 115."""
    # alpha_i = abc int_0^inf ds / ((a_i^2 + s) sqrt(prod(a_j^2 + s))), with s = t^2 / (1 - t)^2 scaled to the size.
    scale = float(np.prod(axes) ** (1 / 3))
    a2 = (axes / scale) ** 2
    t, w = 0.5 * (_LAMB_X + 1), 0.5 * _LAMB_W
    s, ds = (t / (1 - t)) ** 2, 2 * t / (1 - t) ** 3
    root = np.sqrt(np.prod(a2[:, None] + s, axis=0))
    alpha = np.array([np.sum(w * ds / ((a + s) * root)) for a in a2])
    volume = 4 / 3 * np.pi * np.prod(axes)
    rotation = [_ellipsoid_rotation(a2[j], a2[k], alpha[j], alpha[k]) for j, k in ((1, 2), (2, 0), (0, 1))]
    return volume * np.concatenate([alpha / (2 - alpha), scale**2 * np.array(rotation)])


def _ellipsoid_rotation(b2: float, c2: float, beta: float, gamma: float) -> float:
    # A body of revolution carries no water when it spins; the formula is 0 / 0 there.
    if abs(b2 - c2) < 1e-9 * (b2 + c2):
        return 0.0
    return (b2 - c2) ** 2 * (gamma - beta) / (5 * (2 * (b2 - c2) + (b2 + c2) * (beta - gamma)))


def _plate(side: float, other: float) -> float:
    """Added mass per density of a thin rectangular plate moving across itself [m3]."""
    a, b = sorted((side, other))
    aspect = min(b / a, 1e3)
    # 1 - C_A falls as 1 / aspect beyond the table, whose last row is 10.
    known = np.interp(aspect, _PLATE_ASPECT, _PLATE_C_A)
    coefficient = known if aspect <= 10 else 1 - (1 - _PLATE_C_A[-1]) * 10 / aspect
    return float(coefficient * np.pi / 4 * a * a * b)


def _height_factor(area: float, height: float) -> float:
    """How much the sides of a solid add to the added mass of its flat plate: DNV-RP-N103, sec. 4.6.3."""
    share = np.sqrt(area) / (height + np.sqrt(area))
    return float(1 + np.sqrt((1 - share**2) / (2 * (1 + share**2))))


def _box(size: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6"]:
    """Per unit density."""
    length, width, height = size
    linear = np.array(
        [
            _plate(width, height) * _height_factor(width * height, length),
            _plate(length, height) * _height_factor(length * height, width),
            _plate(length, width) * _height_factor(length * width, height),
        ]
    )
    return np.concatenate([linear, _turning(size, linear)])


def _cylinder(size: Float[np.ndarray, "3"]) -> Float[np.ndarray, "6"]:
    """Of a circular or elliptic cylinder along x, per unit density.

    The axial value is that of a disc, 8/3 a^3, with its sides. An ellipse across it is taken as the circle as wide
    across the motion, which strip theory has exactly.
    """
    length, width, height = size
    radius = 0.5 * np.sqrt(width * height)
    axial = 8 / 3 * radius**3 * _height_factor(np.pi * radius**2, length)
    linear = np.array([axial, _across(0.5 * height, length), _across(0.5 * width, length)])
    # Across its axis it turns like the box of the same cross-section.
    rotation = _turning(size * np.array([1.0, np.sqrt(np.pi) / 2, np.sqrt(np.pi) / 2]), linear)
    # About its axis, strips of an ellipse: pi / 8 (a^2 - b^2)^2, Newman (1977), table 4.3; 0 of a circle.
    rotation[0] = np.pi / 128 * (width**2 - height**2) ** 2 * length / (1 + _END_LOSS * max(width, height) / length)
    return np.concatenate([linear, rotation])


def _across(radius: float, length: float) -> float:
    """Of a circular cylinder moving across its axis [m3]."""
    aspect = length / (2 * radius)
    known = np.interp(aspect, _CYLINDER_ASPECT, _CYLINDER_C_A)
    coefficient = known if aspect <= 9 else 1 - (1 - _CYLINDER_C_A[-1]) * 9 / aspect
    return float(coefficient) * np.pi * radius**2 * length


def _mesh(mesh: MeshSolid) -> Float[np.ndarray, "6"]:
    """The mean of the simple solids that it is like, with the water between its walls, less what gaps let through.

    Per unit density. Added mass goes with the 3/2 power of the area that a body shows.
    """
    solids = [_box(mesh.size), *(_turned(mesh.size, axis) for axis in range(3)), _ellipsoid(mesh.size / 2)]
    mean = mesh.weights @ np.array(solids)
    share = open_share(mesh.solidity)
    linear = share * (mesh.fullness**1.5 * mean[:3] + mesh.trapped)
    others = np.array([[1, 2], [2, 0], [0, 1]])
    turning = np.prod((share * mesh.fullness**1.5)[others], axis=1) ** 0.5 * mean[3:]
    # Water between walls turns with them like a block of it, of the box's extent.
    held = mesh.trapped[others].mean(axis=1) * np.sum(mesh.size[others] ** 2, axis=1) / 12
    return np.concatenate([linear, turning + held])


def _turned(size: Float[np.ndarray, "3"], axis: int) -> Float[np.ndarray, "6"]:
    """Of a cylinder along an axis."""
    order = [axis, (axis + 1) % 3, (axis + 2) % 3]
    values = _cylinder(size[order])
    result = np.zeros(6)
    result[order], result[[3 + i for i in order]] = values[:3], values[3:]
    return result


def _turning(size: Float[np.ndarray, "3"], linear: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Rotational added inertia of a box per unit density.

    Compact bodies by sections across the axis, with open ends; slender ones by strips along their length, which share
    the translational value evenly. Each is too large where the other holds.
    """
    inertia = np.zeros(3)
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        across, along = (j, k) if size[j] <= size[k] else (k, j)
        height, long = size[axis], size[along]
        shape = np.interp(size[across] / long, _SECTION_ASPECT, _SECTION_TURNING)
        section = shape * np.pi * (long / 2) ** 4 * height * height / (height + _END_LOSS * long)
        inertia[axis] = min(section, linear[across] * long**2 / 12)
    return inertia


def move_matrix(matrix: Float[np.ndarray, "6 6"], placement: Placement) -> Float[np.ndarray, "6 6"]:
    """A part's added mass or linear damping as the parent's origin feels it, H' M H. Fossen (2021), eq. 3.34 ff."""
    H = placement.twist()
    return H.T @ matrix @ H
