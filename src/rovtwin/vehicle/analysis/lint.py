"""What to know about a vehicle file that is valid: things that are legal and still surprise in the water."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovtwin.core.user_files.quantity import plain
from rovtwin.vehicle.analysis.overlap import overlaps
from rovtwin.vehicle.analysis.slips import doubted_units, slips
from rovtwin.vehicle.analysis.stability import (
    SPEED_LIMIT,
    by_products,
    hang,
    reach,
    stability,
    steady_speed,
    tilt_of_thrust,
)
from rovtwin.vehicle.constants import AXES
from rovtwin.vehicle.description.schema import Thruster
from rovtwin.vehicle.description.totals.added_mass import Solid
from rovtwin.vehicle.description.totals.assembly import bodies
from rovtwin.vehicle.description.vehicle import Vehicle, load_vehicle
from rovtwin.vehicle.physics.actuation import (
    BY_PRODUCT,
    YAW,
    configuration_about_cg,
    pure_force_limits,
    rank,
    size,
    uncontrollable_directions,
)
from rovtwin.vehicle.physics.model import Model
from rovtwin.vehicle.physics.thrusters import force_limits

_UNNOTICED = 1e-6  # net buoyancy as a share of the weight
_TILTING = 5.0  # roll or pitch by thrust that is worth a word [deg]
_PURE = 0.85  # share of an axis's thrust without a moment, below which that is worth a word
_SPINNING = 2.0  # speed of the vehicle's ends in a turn over its speed ahead; 1.7 at most in the library
_SEVERAL = 3  # horizontal thrusters
_IDLE = 0.05  # mean lever of their forces over the vehicle's size; of three or more 0.16 at least in the library
_UPRIGHT = 20.0  # [deg]; a trim beyond it is more than lopsided
_DOWNWARD = 0.5  # cosine of the angle to the vertical, below which an echo of the floor is no altitude
SYMBOLS = ("X", "Y", "Z", "K", "M", "N")


@dataclass(frozen=True)
class Check:
    """What is to be said about a vehicle file that can be used.

    Attributes:
        reservations: What the vehicle will do that nobody wants of one: sink, capsize, only drift; and units in doubt.
        findings: One line each on all that may surprise.
    """

    reservations: list[str]
    findings: list[str]

    @property
    def verdict(self) -> str:
        """`usable`, or `usable, but: ` and the reservations."""
        return f"usable, but: {'; '.join(self.reservations)}" if self.reservations else "usable"


def check(name_or_path: str | Path) -> Check:
    """The verdict on a vehicle file.

    Raises:
        ConfigError: It cannot be used; a line per mistake.
    """
    vehicle = load_vehicle(name_or_path)
    model = vehicle.model()
    return Check([*reservations(model), *doubted_units(vehicle, model)], findings(vehicle, model))


def reservations(model: Model) -> list[str]:
    """What spoils a vehicle in still water; empty for one that can be flown."""
    found = []
    floating, limits = hang(model), reach(model)[2]
    net, little = floating.net_buoyancy, _UNNOTICED * float(model.weight)
    # z is down: the lowest heave force is the thrusters' lift.
    if net < -little:
        weak = model.thrusters.count > 0 and net < limits[0]
        lift = f", and its thrusters lift {plain(-limits[0], 3)} N" if weak else ""
        found.append(f"it sinks with {plain(-net, 3)} N{lift}")
    elif net > max(limits[1], little):
        found.append(f"it floats with {plain(net, 3)} N, and its thrusters push down {plain(limits[1], 3)} N")
    roll, pitch = np.degrees(floating.trim)
    if floating.stiffness[0] < 0:
        found.append("it capsizes: CG is above CB")
    elif not np.isfinite([roll, pitch]).all():
        found.append("nothing rights it: CG is at CB")
    elif max(abs(roll), abs(pitch)) > _UPRIGHT:
        found.append(f"it hangs at roll {roll:z.0f}, pitch {pitch:z.0f} deg")
    if model.thrusters.count == 0:
        found.append("it has no thrusters")
    return found


def findings(vehicle: Vehicle, model: Model) -> list[str]:
    """The same for a vehicle already loaded."""
    doubts = [f"what was identified is not to be relied on: {doubt}" for doubt in vehicle.doubts]
    parts = [*doubts, *(slip.line for slip in slips(vehicle, model)), *_about_parts(vehicle), *_about_sensors(vehicle)]
    water = [*_about_floating(model), *_about_tilting(model), *_about_turning(model), *_about_speed(model)]
    return [*parts, *_about_thrusters(vehicle, model), *water]


def uncontrollable(T: np.ndarray) -> list[str]:
    """Directions that no combination of thrusters reaches, in words, for an allocation matrix T, shape (6, n)."""
    return [_named(direction) for direction in uncontrollable_directions(T)]


def _named(direction: np.ndarray) -> str:
    scaled = direction / np.abs(direction).max()
    parts = [(f, a, s) for f, a, s in zip(scaled, AXES, SYMBOLS, strict=True) if abs(f) > 1e-6]
    (factor, axis, symbol), *others = sorted(parts, key=lambda part: -abs(part[0]))
    if all(abs(f) < BY_PRODUCT for f, _, _ in others):
        comes = " ".join(f"{-f / factor:+.2g} {s}" for f, _, s in others).removeprefix("+")
        return f"{axis} ({symbol})" + (f" by itself, only {symbol} = {comes}" if others else "")
    return " ".join(f"{f:+.2g} {s}" for f, _, s in parts)


def _about_parts(vehicle: Vehicle) -> Iterator[str]:
    for name, body in bodies(vehicle.file, vehicle.name):
        if body.mass and body.inertia is None and body.shape is None and body.rigid_body is None:
            yield f"{name}: {body.mass:g} kg counted as a point: neither 'inertia' nor 'shape' is given"
        mesh = None if body.shape is None else Solid.of(body.shape).mesh
        if mesh is not None:
            yield from (f"{name}: {note}" for note in mesh.notes)
    if vehicle.file.identified is None:
        yield from (one.line() for one in overlaps(vehicle.file, vehicle.name))
    if vehicle.file.hydrodynamics is None or vehicle.file.hydrodynamics.added_mass is None:
        yield "added mass is the sum over the parts' shapes, each alone in the water: their interaction is not in it"
    mass, displaced = vehicle.assembly.solid.mass, vehicle.assembly.density * vehicle.assembly.volume
    if not vehicle.file.restoring and abs(displaced - mass) > 0.2 * mass:
        missing = "is a mass missing, or a volume in litres?" if displaced > mass else "is a volume missing?"
        yield (
            f"the parts displace {displaced:.4g} kg of water and weigh {mass:.4g} kg: {missing} "
            "A vehicle trimmed to float says 'restoring: {buoyancy: neutral}'"
        )


def _about_sensors(vehicle: Vehicle) -> Iterator[str]:
    for mounted in vehicle.sensors:
        down = mounted.rotation[2, 0]
        if getattr(mounted.item, "kind", "") == "altimeter" and down < _DOWNWARD:
            yield (
                f"{mounted.name}: an altimeter that looks {np.degrees(np.arccos(np.clip(down, -1, 1))):.0f} deg off "
                "the vertical; its x axis is its beam: attitude_deg [0, -90, 0] looks down"
            )


def _about_thrusters(vehicle: Vehicle, model: Model) -> Iterator[str]:
    T = np.asarray(model.thrusters.configuration)
    if T.shape[1] == 0:
        yield "no thrusters: it drifts"
        return
    missing = uncontrollable(T)
    if missing:
        yield f"allocation has rank {rank(T)} of 6: no thruster reaches {', '.join(missing)}"
    if not np.any(np.asarray(model.thrusters.time_constant)):
        yield "no thruster states a time_constant: the twin's follow at once, real ones in 0.1 to 0.3 s"
    for mounted in vehicle.assembly.thrusters:
        item = mounted.item
        if not isinstance(item, Thruster):
            continue
        if item.health < 1:
            yield f"thruster '{mounted.name}' has {100 * item.health:.0f} % of its force left (health)"
        if isinstance(item.direction, list) and abs(np.linalg.norm(item.direction) - 1) > 1e-3:
            yield f"thruster '{mounted.name}': direction {item.direction} is not a unit vector and was normalised"


def _about_floating(model: Model) -> Iterator[str]:
    floating = hang(model)
    limits = reach(model)[2]
    net = floating.net_buoyancy
    if abs(net) > _UNNOTICED * float(model.weight):
        way, limit = ("floats", limits[1]) if net > 0 else ("sinks", -limits[0])
        share = "" if limit <= 0 else f", {100 * abs(net) / limit:.0f} % of the heave thrust"
        if 0 < limit < abs(net):
            share = ", more than the thrusters have"
        drift = steady_speed(model, 2, -net, thrust=False)
        yield f"{way} with {plain(abs(net), 3)} N{share}; without thrust it drifts {drift:.2f} m/s"
    for i, axis in enumerate(("roll", "pitch")):
        if floating.stiffness[i] <= 0:
            yield (
                f"{axis} has no righting moment ({floating.stiffness[i]:.3g} N m/rad): CG must be below CB (z is down)"
                "; raise the buoyancy or lower the weight"
            )
        elif abs(floating.trim[i]) > np.radians(2):
            yield f"{axis} trim {np.degrees(floating.trim[i]):.1f} deg: CG and CB are not above each other"


# Where a force acts whose moment about CG is positive, or negative: force along surge, sway, heave; roll or pitch.
_ACTS = {
    (0, 1): ("below", "above"),
    (1, 0): ("above", "below"),
    (2, 0): ("to starboard of", "to port of"),
    (2, 1): ("behind", "ahead of"),
}


def _about_tilting(model: Model) -> Iterator[str]:
    """Roll or pitch that full thrust ahead, aside, and up or down makes, where no other thrusters balance it."""
    angles, levers = np.degrees(tilt_of_thrust(model)), 1e3 * by_products(model)
    for i, axis in enumerate(AXES[:3]):
        for j, tilts in ((0, "rolls"), (1, "pitches")):
            lever = levers[j, i]
            if angles[j, i] > _TILTING:
                where = _ACTS.get((i, j), ("beside", "beside"))[int(lever < 0)]
                yield (
                    f"full thrust in {axis} {tilts} it by {angles[j, i]:.0f} deg: it acts {abs(lever):.0f} mm "
                    f"{where} CG, and no other thrusters balance it"
                )


def _about_turning(model: Model) -> Iterator[str]:
    """Forces that turn the vehicle, too, and a turn that nothing brakes."""
    if model.thrusters.count == 0:
        return
    alone = reach(model)
    for i, axis in enumerate(AXES[:2]):
        most, pure = min(-alone[i, 0], alone[i, 1]), pure_force_limits(model.thrusters, i)
        if (left := min(-pure[0], pure[1])) < _PURE * most:
            yield (
                f"of {plain(most, 3)} N in {axis} {plain(left, 3)} N neither turn the vehicle nor push it another way: "
                f"it keeps up less than what 'vehicle show' says of {axis} alone"
            )
    yield from _about_yaw(model, min(-alone[YAW, 0], alone[YAW, 1]))
    rate, ahead = (steady_speed(model, i, alone[i, 1]) for i in (YAW, 0))
    if rate * size(model) > _SPINNING * ahead > 0.0:
        turn = f"{np.degrees(rate):.0f} deg/s" if np.isfinite(rate) else "a rate without end"
        yield (
            f"full thrust in yaw turns it at {turn}: its ends would go more than {_SPINNING:.0f} times as fast as it "
            "goes ahead. Frame and thrusters without a shape have no drag: give them one, or state quadratic_damping"
        )


def _about_yaw(model: Model, most: float) -> Iterator[str]:
    """Horizontal thrusters that could turn the vehicle from where they sit, and hardly do."""
    T = np.asarray(configuration_about_cg(model))
    force = np.min(np.abs(np.stack([np.asarray(limit) for limit in force_limits(model.thrusters)])), axis=0)
    turning = np.abs(T[YAW]) * force
    lying = np.hypot(T[0], T[1]) > np.abs(T[2])
    if lying.sum() >= _SEVERAL and 0.0 < turning[lying].sum() < _IDLE * size(model) * force[lying].sum():
        yield (
            f"{lying.sum()} horizontal thrusters make {plain(most, 2)} N m in yaw, for they push nearly through CG: "
            "have their azimuths, or their y, the wrong sign?"
        )


def _about_speed(model: Model) -> Iterator[str]:
    steady = stability(model)
    top = steady_speed(model, 0, reach(model)[0, 1])
    seen = min(top if np.isfinite(top) else SPEED_LIMIT, SPEED_LIMIT)
    if 0 < steady.pitch_depth_held < seen:
        yield (
            f"pitch diverges above {steady.pitch_depth_held:.2f} m/s when depth is held (Munk moment: heave added mass "
            f"exceeds surge by {steady.munk_pitch:.3g} kg); top speed is {top:.2f} m/s"
        )
    aside = min(steady_speed(model, 1, float(np.abs(reach(model)[1]).max())), SPEED_LIMIT)
    if 0 < steady.roll_static < aside:
        yield (
            f"left to itself, roll diverges above {steady.roll_static:.2f} m/s in sway, depth held (Munk moment: "
            f"heave added mass exceeds sway by {steady.munk_roll:.3g} kg); top speed in sway is {aside:.2f} m/s"
        )
    if steady.pitch_free < seen:
        yield f"left free, pitch and heave grow above {steady.pitch_free:.2f} m/s"
    if steady.yaw_free < seen:
        yield f"left free, it does not keep its course above {steady.yaw_free:.2f} m/s: heading needs control"
    for i, axis in enumerate(AXES):
        if not np.isfinite(steady_speed(model, i, 1.0, thrust=False)):
            yield f"{axis} has no damping at all"
