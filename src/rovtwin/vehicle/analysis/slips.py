"""Slips of units in a vehicle file that is valid: millimetres, litres, grams, milliseconds, radians, degrees."""

import math
from collections.abc import Iterator

import numpy as np

from rovtwin.core.user_files.quantity import plain
from rovtwin.vehicle.analysis.plausible import Slip, implausible
from rovtwin.vehicle.constants import AXES, GRAVITY
from rovtwin.vehicle.description.schema import Body, Thruster
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.totals.assembly import bodies
from rovtwin.vehicle.description.vehicle import Vehicle
from rovtwin.vehicle.physics.actuation import size, wrench_limits
from rovtwin.vehicle.physics.model import Model

# Between a shape and what its part displaces or weighs: lead is 11 times water, the box around an open frame some 50
# times its tubes; a slip of units is 1000 (litres, grams) or more.
_SLIP = 100.0
# Of a mesh without `scale`: what its solid displaces over the mass, and its length over that of any other part, beyond
# which its file is taken to be in millimetres (lengths 1000 times, volumes 1e9).
_HEAVY, _LONG, _LONG_M = 50.0, 20.0, 5.0  # the last [m]: 5 mm, the least of a part, read as metres
_FAR, _SLOW = 10.0, 5.0  # sizes of the vehicle from CG, and [s] that a thruster takes, beyond which units are doubted
# An angle below 2 pi, written with so many decimals or more, that is a multiple of 5 degrees if it is in radians.
_MULTIPLE_DEG, _DECIMALS = 5.0, 2
_FEEBLE = 0.05  # of the force along the other horizontal axis; 35 degrees taken for radians leave 0.015
_NAMED = 3  # things whose units are doubted that a verdict names


def doubted_units(vehicle: Vehicle, model: Model) -> list[str]:
    """One reservation that names what looks like a slip of units; empty where nothing does."""
    found = list(dict.fromkeys(slip.what for slip in slips(vehicle, model)))
    if not found:
        return []
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return [f"units look wrong ({', '.join(found[:_NAMED])}{more})"]


def slips(vehicle: Vehicle, model: Model) -> Iterator[Slip]:
    """Everything in a vehicle that nobody builds and that another unit would explain."""
    for name, body in bodies(vehicle.file, vehicle.name):
        line = _about_scale(name, body, vehicle) or _about_size(name, body, vehicle.assembly.density)
        if line:
            yield Slip(name, line)
    yield from _about_places(vehicle, model)
    angles = list(_about_angles(vehicle))
    yield from angles or _about_feeble_axes(model)
    yield from implausible(vehicle, model)


def _about_scale(name: str, body: Body, vehicle: Vehicle) -> str | None:
    """Whether a mesh without `scale` is far too large for its part's mass, or where it has none, for the vehicle."""
    if body.shape is None or body.shape.mesh is None or body.shape.scale is not None:
        return None
    shape, fix = Solid.of(body.shape), "is its file in millimetres? Then give scale: 0.001"
    mass = body.mass or vehicle.assembly.solid.mass
    if vehicle.assembly.density * shape.volume() > _HEAVY * mass > 0:
        whose = "its mass is" if body.mass else "the whole vehicle weighs"
        held = vehicle.assembly.density * shape.volume()
        return f"{name}: its mesh displaces {plain(held, 3)} kg of water and {whose} {plain(mass, 3)} kg: {fix}"
    others = [Solid.of(b.shape) for _, b in bodies(vehicle.file, vehicle.name) if b.shape is not None and b is not body]
    longest, rest = float(shape.size.max()), max((float(other.size.max()) for other in others), default=0.0)
    if not body.mass and rest > 0 and longest > max(_LONG * rest, _LONG_M):
        return (
            f"{name}: its mesh is {plain(longest, 3)} m long and no other part is longer than {plain(rest, 3)} m: {fix}"
        )
    return None


def _about_size(name: str, body: Body, density: float) -> str | None:
    """Whether a part's shape does not fit what it displaces and weighs, in water of a density [kg/m3]."""
    if body.shape is None:
        return None
    solid = Solid.of(body.shape).volume()
    for key, given, held, unit, slip in (
        ("volume", body.volume, solid, "m3", "litres"),
        ("mass", body.mass, density * solid, "kg of water", "grams"),
    ):
        if given and not 1.0 / _SLIP < held / given < _SLIP:
            why = "is the shape in millimetres?" if held > given else f"is the {key} in {slip}?"
            return f"{name}: its shape holds {plain(held, 3)} {unit} and its {key} is {plain(given, 3)}: {why}"
    return None


def _about_places(vehicle: Vehicle, model: Model) -> Iterator[Slip]:
    """Places, inertias and times that nobody builds: most are millimetres and milliseconds."""
    length = size(model)
    center = np.asarray(model.center_of_gravity)
    placed = [("CB", np.asarray(model.center_of_buoyancy))]
    placed += [(f"sensor '{one.name}'", one.position) for one in vehicle.assembly.sensors]
    for one in vehicle.assembly.thrusters:
        assert isinstance(one.item, Thruster)
        placed.append((f"thruster '{one.name}'", one.placement.point(np.array(one.item.position))))
    for what, position in placed:
        away = float(np.linalg.norm(position - center))
        if away > _FAR * length:
            times = f"{away / length:.0f} times the size of the vehicle"
            yield Slip(what, f"{what} is {plain(away, 3)} m from CG, {times}: is it in metres?")
    radii = np.sqrt(np.diagonal(np.asarray(model.rigid_body_mass))[3:] / (float(model.weight) / GRAVITY))
    for radius, axis in zip(radii, "xyz", strict=True):
        if radius > 0.5 * _FAR * length:
            line = f"radius of gyration about {axis} is {plain(radius, 3)} m: are inertia and places in kg m2 and m?"
            yield Slip("inertia", line)
    for name, constant in zip(vehicle.thruster_names, np.asarray(model.thrusters.time_constant), strict=True):
        if constant > _SLOW:
            what = f"thruster '{name}'"
            yield Slip(
                what, f"{what} takes {plain(constant, 3)} s to follow its command: is its time_constant in seconds?"
            )


def _about_angles(vehicle: Vehicle) -> Iterator[Slip]:
    """Parts all of whose thrusters have angles that are round in radians: 0.61, 0.785, 1.57."""
    for name, body in bodies(vehicle.file, vehicle.name):
        given = [one.direction for one in body.thrusters if isinstance(one.direction, dict)]
        angles = [abs(float(angle)) for direction in given for angle in direction.values() if angle]
        if angles and all(_round_in_radians(angle) for angle in angles):
            text = ", ".join(f"{angle:g}" for angle in dict.fromkeys(angles))
            meant = ", ".join(f"{math.degrees(angle):.0f}" for angle in dict.fromkeys(angles))
            line = f"{name}: the angles of its thrusters, {text} deg, look like radians: {meant} deg?"
            yield Slip("angles of thrusters", line)


def _round_in_radians(angle: float) -> bool:
    """Whether an angle, positive, is a multiple of 5 degrees to the digits written, if it is in radians."""
    decimals = len(f"{angle:.10g}".partition(".")[2])
    off = math.remainder(math.degrees(angle), _MULTIPLE_DEG)
    return angle < 2.0 * math.pi and decimals >= _DECIMALS and abs(off) <= math.degrees(0.5 * 10.0**-decimals) + 0.01


def _about_feeble_axes(model: Model) -> Iterator[Slip]:
    """A horizontal axis along which thrusters make next to nothing beside the other one."""
    if model.thrusters.count == 0:
        return
    T = np.asarray(model.thrusters.configuration)[:2]
    low, high = (np.asarray(limit)[:2] for limit in wrench_limits(model.thrusters))
    force = np.maximum(-low, high)
    weak = int(np.argmin(force))
    if 1e-6 * force.max() < force[weak] < _FEEBLE * force.max() and np.linalg.matrix_rank(T) > 1:
        yield Slip(
            "angles of thrusters",
            f"all thrusters together make {force[weak]:.2g} N in {AXES[weak]}, {100 * force[weak] / force.max():.1f} % "
            f"of those in {AXES[1 - weak]}: are their directions right, and their angles in degrees?",
        )
