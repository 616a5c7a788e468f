"""A vehicle as URDF, for RViz, Gazebo and others: looks, mass and inertia, frames of cameras and sensors.

URDF has x forward, y left, z up (REP 103); a camera's optical frame is OpenCV's. Thrust and water are not in it.
"""

from xml.etree import ElementTree

import numpy as np

from rovtwin.core.arrays.rotations import euler_from_rotation
from rovtwin.vehicle.analysis.visuals import Piece, pieces_of
from rovtwin.vehicle.description.schema import Camera
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.camera import R_DEVICE_C
from rovtwin.vehicle.solids.placement import Placement

_FLU = np.diag([1.0, -1.0, -1.0])  # b to x forward, y left, z up, and back
_Z_TO_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # URDF's cylinders stand along z, ours along x


def urdf(vehicle: Vehicle) -> str:
    """The whole file. Ellipsoids come as boxes, since URDF has none, and spheres as spheres."""
    robot = ElementTree.Element("robot", name=vehicle.name)
    base = ElementTree.SubElement(robot, "link", name="base_link")
    solid = vehicle.assembly.solid
    inertial = ElementTree.SubElement(base, "inertial")
    _origin(inertial, _FLU @ solid.center_of_gravity, np.eye(3))
    ElementTree.SubElement(inertial, "mass", value=_number(solid.mass))
    I = _FLU @ solid.inertia @ _FLU
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": _number(I[i, j]) for i in range(3) for j in range(i, 3)}
    ElementTree.SubElement(inertial, "inertia", entries)
    for piece in pieces_of(vehicle):
        _visual(base, piece)
    for mounted in [*vehicle.cameras, *vehicle.sensors]:
        optical = isinstance(mounted.item, Camera)
        R = _FLU @ mounted.rotation @ (R_DEVICE_C if optical else _FLU)
        _frame(robot, mounted.name.replace(".", "_") + ("_optical" if optical else ""), _FLU @ mounted.position, R)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _visual(link: ElementTree.Element, piece: Piece) -> None:
    visual = ElementTree.SubElement(link, "visual", name=piece.name)
    place: Placement = piece.placement
    R = _FLU @ place.rotation @ (_Z_TO_X if piece.kind == "cylinder" else np.eye(3) if piece.mesh else _FLU)
    _origin(visual, _FLU @ place.position, R)
    geometry = ElementTree.SubElement(visual, "geometry")
    if piece.kind == "mesh":
        scale = " ".join(_number(x) for x in piece.size)
        ElementTree.SubElement(geometry, "mesh", filename=f"file://{piece.mesh}", scale=scale)
    elif piece.kind == "cylinder":
        size = {"radius": _number(0.5 * piece.size[1]), "length": _number(piece.size[0])}
        ElementTree.SubElement(geometry, "cylinder", size)
    elif piece.kind == "ellipsoid" and np.ptp(piece.size) == 0:
        ElementTree.SubElement(geometry, "sphere", radius=_number(0.5 * piece.size[0]))
    else:
        ElementTree.SubElement(geometry, "box", size=" ".join(_number(x) for x in piece.size))
    material = ElementTree.SubElement(visual, "material", name=f"{piece.name}_colour")
    ElementTree.SubElement(material, "color", rgba=" ".join(_number(c) for c in (*piece.colour, 1.0)))


def _frame(robot: ElementTree.Element, name: str, position: np.ndarray, R: np.ndarray) -> None:
    ElementTree.SubElement(robot, "link", name=name)
    joint = ElementTree.SubElement(robot, "joint", name=f"{name}_joint", type="fixed")
    ElementTree.SubElement(joint, "parent", link="base_link")
    ElementTree.SubElement(joint, "child", link=name)
    _origin(joint, position, R)


def _origin(parent: ElementTree.Element, position: np.ndarray, R: np.ndarray) -> None:
    """URDF's rpy is roll, pitch, yaw (zyx) as ours."""
    rpy = list(euler_from_rotation(R))
    if abs(R[2, 0]) > 1 - 1e-9:  # straight up or down: roll and yaw are one turn
        rpy = [0.0, -np.sign(R[2, 0]) * np.pi / 2, np.arctan2(-R[0, 1], R[1, 1])]
    text = {"xyz": " ".join(_number(x) for x in position), "rpy": " ".join(_number(x) for x in rpy)}
    ElementTree.SubElement(parent, "origin", text)


def _number(value: float) -> str:
    return f"{round(float(value), 9) + 0.0:.9g}"
