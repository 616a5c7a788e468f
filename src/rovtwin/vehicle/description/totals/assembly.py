"""From a tree of parts to totals at one origin: mass, buoyancy, added mass, damping, and what is mounted where."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import near
from rovtwin.vehicle.constants import FRESH_WATER, GRAVITY
from rovtwin.vehicle.description import schema
from rovtwin.vehicle.description.fields import inertia_matrix
from rovtwin.vehicle.description.totals.added_mass import Solid, added_mass, move_matrix
from rovtwin.vehicle.description.totals.drag import Damping, DragElements, drag_elements, tamed
from rovtwin.vehicle.description.totals.rigid_body import MassProperties, combine
from rovtwin.vehicle.solids.placement import HERE, Box, Placement


@dataclass(frozen=True)
class Mounted:
    """A thruster, camera, sensor or tether seen from the body frame.

    Attributes:
        name: With the names of the parts it sits in, `port.camera`, but of those that keep their names (`Part`).
        item: What the file says of it.
        placement: Its frame in b; of a thruster and a tether, the frame of its part.
        supply_voltage: Of a thruster: that of the nearest part around it that gives one [V].
        spare: Of a sensor: whether it is on board but not read.
        path: Names of all parts it sits in, outermost first.
    """

    name: str
    item: schema.Thruster | schema.Camera | schema.Sensor | schema.Tether
    placement: Placement
    supply_voltage: float | None = None
    spare: bool = False
    path: tuple[str, ...] = ()

    @property
    def position(self) -> Float[np.ndarray, "3"]:
        """In b at CO [m]."""
        return self.placement.position

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """R from its frame (x forward, y right, z down of the device) to b."""
        return self.placement.rotation

    def moved(self, placement: Placement, prefix: str) -> "Mounted":
        name, path = f"{prefix}.{self.name}", (prefix, *self.path)
        return replace(self, name=name, placement=self.placement.after(placement), path=path)


@dataclass(frozen=True)
class Assembly:
    """A body seen from one frame; hydrodynamics at `density`, damping partly not yet collapsed into matrices.

    Attributes:
        solid: Mass properties.
        volume: Displaced, such that buoyancy is density x g x volume [m3].
        center_of_buoyancy: [m].
        added_mass: M_A.
        measured: Damping given as matrices.
        elements: Damping from shapes.
        as_given: Whether `measured` is a full matrix of the file, at its own origin: it is used as it stands.
        density: Of the water [kg/m3].
        boxes: Of the parts that have a shape or a volume: where the hull is, at the surface and at walls.
        thrusters: In order of the file.
        cameras: In order of the file.
        sensors: In order of the file.
        tethers: In order of the file.
    """

    solid: MassProperties
    volume: float
    center_of_buoyancy: Float[np.ndarray, "3"]
    added_mass: Float[np.ndarray, "6 6"]
    measured: Damping
    elements: tuple[DragElements, ...]
    density: float
    boxes: tuple[Box, ...] = ()
    thrusters: tuple[Mounted, ...] = ()
    cameras: tuple[Mounted, ...] = ()
    sensors: tuple[Mounted, ...] = ()
    tethers: tuple[Mounted, ...] = ()
    as_given: bool = False

    def damping(self) -> Damping:
        """All damping as matrices at the origin."""
        total = sum((e.damping() for e in self.elements), self.measured)
        return total if self.as_given else tamed(total)

    def moved(self, placement: Placement, prefix: str) -> "Assembly":
        """The same body seen from the parent's frame."""

        def mounted(items: tuple[Mounted, ...]) -> tuple[Mounted, ...]:
            return tuple(item.moved(placement, prefix) for item in items)

        return Assembly(
            self.solid.moved(placement),
            self.volume,
            placement.point(self.center_of_buoyancy),
            move_matrix(self.added_mass, placement),
            self.measured.moved(placement),
            tuple(e.moved(placement) for e in self.elements),
            self.density,
            tuple(box.moved(placement) for box in self.boxes),
            mounted(self.thrusters),
            mounted(self.cameras),
            mounted(self.sensors),
            mounted(self.tethers),
        )

    def in_water(self, density: float) -> "Assembly":
        """The same body in water of another density: inertia and drag of the water scale with it."""
        ratio = density / self.density
        if ratio == 1.0:
            return self
        elements = tuple(replace(e, quadratic=ratio * e.quadratic) for e in self.elements)
        added, measured = ratio * self.added_mass, self.measured.scaled(ratio)
        return replace(self, added_mass=added, measured=measured, elements=elements, density=density)


def assemble(
    body: schema.Body, where: str, density: float = FRESH_WATER, supply_voltage: float | None = None
) -> Assembly:
    """Totals of a body at its own origin.

    Args:
        body: With all `part:` files already in place.
        where: For messages: file and place in it.
        density: Water of the parent, for bodies that don't say in which water their values hold [kg/m3].
        supply_voltage: Of the parent, for bodies that give none [V].
    """
    density = body.water_density or density
    voltage = body.supply_voltage or supply_voltage
    pieces = [_own(body, density, voltage)]
    for part in body.parts:
        inner = assemble(part, f"{where}: part '{part.name}'", density, voltage).in_water(density)
        pieces.append(inner.moved(Placement.of(part.pose.position, part.pose.attitude_deg), part.name))
    total = _with_names_kept(_sum(pieces, density), {part.name for part in body.parts if part.keeps_names})
    total = _with_spares(total, body.spare_sensors or [], where)
    total = with_rigid_body(total, body.rigid_body)
    total = with_restoring(total, body.restoring, where)
    return with_hydrodynamics(total, body.hydrodynamics, where)


def _own(body: schema.Body, density: float, supply_voltage: float | None) -> Assembly:
    """What the body itself adds to its parts."""
    solid = None if body.shape is None else Solid.of(body.shape)
    center = HERE.position if solid is None else solid.centered().position
    if body.center_of_buoyancy is not None:
        center = np.array(body.center_of_buoyancy)
    volume = body.volume if body.volume is not None else (0.0 if solid is None else solid.volume())
    return Assembly(
        _mass_properties(body, solid),
        volume,
        center,
        np.zeros((6, 6)) if solid is None else added_mass(solid, density),
        Damping.none(),
        () if solid is None else (drag_elements(solid, density),),
        density,
        _boxes(solid, volume, center),
        tuple(Mounted(t.name, t, HERE, supply_voltage) for t in body.thrusters),
        tuple(Mounted(c.name, c, Placement.of(c.pose.position, c.pose.attitude_deg)) for c in body.cameras),
        tuple(Mounted(s.name, s, Placement.of(s.pose.position, s.pose.attitude_deg)) for s in body.sensors),
        tuple(Mounted(t.name, t, HERE) for t in body.tethers),
    )


def _boxes(solid: Solid | None, volume: float, center: np.ndarray) -> tuple[Box, ...]:
    """The shape's own box, or a cube for a volume without a shape."""
    if solid is not None:
        return (Box(solid.size, solid.placement, volume),)
    return (Box(np.full(3, np.cbrt(volume)), Placement.of(center), volume),) if volume > 0 else ()


def _mass_properties(body: schema.Body, solid: Solid | None) -> MassProperties:
    mass, r_g = body.mass or 0.0, np.array(body.center_of_gravity)
    if body.inertia is not None:
        return MassProperties(mass, r_g, inertia_matrix(body.inertia))
    if solid is not None and mass > 0:
        return MassProperties(mass, r_g, solid.homogeneous(mass).inertia)
    return MassProperties(mass, r_g, np.zeros((3, 3)))


def _sum(pieces: list[Assembly], density: float) -> Assembly:
    volume = sum(p.volume for p in pieces)
    moment = sum((p.volume * p.center_of_buoyancy for p in pieces), np.zeros(3))
    return Assembly(
        combine([p.solid for p in pieces]),
        volume,
        moment / volume if volume > 0 else np.zeros(3),
        sum((p.added_mass for p in pieces), np.zeros((6, 6))),
        sum((p.measured for p in pieces), Damping.none()),
        tuple(e for p in pieces for e in p.elements),
        density,
        tuple(box for p in pieces for box in p.boxes),
        tuple(t for p in pieces for t in p.thrusters),
        tuple(c for p in pieces for c in p.cameras),
        tuple(s for p in pieces for s in p.sensors),
        tuple(t for p in pieces for t in p.tethers),
    )


def _with_names_kept(total: Assembly, parts: set[str]) -> Assembly:
    """The same, names in some of the parts without those parts' own: `rov.port.surge` is `port.surge`.

    Where two of a kind would then have one name, those in the parts keep the long one.
    """
    if not parts:
        return total

    def named(items: tuple[Mounted, ...]) -> tuple[Mounted, ...]:
        short = [i.name.removeprefix(f"{i.path[0]}.") if i.path and i.path[0] in parts else i.name for i in items]
        return tuple(
            replace(i, name=s) if short.count(s) == 1 else i  # those outside the parts have it already
            for i, s in zip(items, short, strict=True)
        )

    return replace(
        total,
        thrusters=named(total.thrusters),
        cameras=named(total.cameras),
        sensors=named(total.sensors),
        tethers=named(total.tethers),
    )


def _with_spares(total: Assembly, names: list[str], where: str) -> Assembly:
    """The same with sensors that are on board but not read marked as such."""
    known = [s.name for s in total.sensors]
    for name in names:
        if name not in known:
            expected = f"one of {', '.join(known)}" if known else "a sensor, but there are none"
            raise ConfigError(f"{where}: spare_sensors: found '{name}', expected {expected}.{near(name, known)}")
    return replace(total, sensors=tuple(replace(s, spare=s.spare or s.name in names) for s in total.sensors))


def with_rigid_body(total: Assembly, given: schema.RigidBody | None) -> Assembly:
    """The same with given mass, centre of gravity and inertia in place of the parts'."""
    if given is None:
        return total
    mass = total.solid.mass if given.mass is None else given.mass
    r_g = total.solid.center_of_gravity if given.center_of_gravity is None else np.array(given.center_of_gravity)
    inertia = total.solid.inertia if given.inertia is None else inertia_matrix(given.inertia)
    return replace(total, solid=MassProperties(mass, r_g, inertia))


def with_restoring(total: Assembly, given: schema.Restoring | None, where: str) -> Assembly:
    """The same with given buoyancy and its centre in place of the parts'."""
    if given is None:
        return total
    weight = total.solid.mass * GRAVITY
    buoyancy = total.density * GRAVITY * total.volume
    if given.buoyancy is not None:
        buoyancy = weight if given.buoyancy == "neutral" else float(given.buoyancy)
    if given.net_buoyancy is not None:
        buoyancy = weight + given.net_buoyancy
    if buoyancy < 0:
        raise ConfigError(
            f"{where}: restoring.net_buoyancy: {given.net_buoyancy:g} N less than the weight {weight:.4g} N is negative"
        )
    center = total.center_of_buoyancy
    if given.center_of_buoyancy is not None:
        center = np.array(given.center_of_buoyancy)
    if given.metacentric_height is not None:
        center = total.solid.center_of_gravity - np.array([0.0, 0.0, given.metacentric_height])
    return replace(total, volume=buoyancy / (total.density * GRAVITY), center_of_buoyancy=center)


def with_hydrodynamics(total: Assembly, given: schema.Hydrodynamics | None, where: str) -> Assembly:
    """The same with given added mass and damping in place of the parts'."""
    if given is None:
        return total
    total = replace(total, added_mass=_overridden(total.added_mass, given.added_mass))
    parts = total.damping()
    ahead_l = _overridden(parts.linear_ahead, given.linear_damping)
    ahead_q = _overridden(parts.quadratic_ahead, given.quadratic_damping)
    # What is measured one way holds both ways unless the file says otherwise.
    astern_l = _overridden(_overridden(parts.linear_astern, given.linear_damping), given.linear_damping_astern)
    astern_q = _overridden(_overridden(parts.quadratic_astern, given.quadratic_damping), given.quadratic_damping_astern)
    full = any(isinstance(rows[0], list) for rows in (getattr(given, key) for key in _DAMPING) if rows is not None)
    return replace(total, measured=Damping(ahead_l, astern_l, ahead_q, astern_q), elements=(), as_given=full)


_DAMPING = ("linear_damping", "quadratic_damping", "linear_damping_astern", "quadratic_damping_astern")


def _overridden(matrix: Float[np.ndarray, "6 6"], given: list | None) -> Float[np.ndarray, "6 6"]:
    """The matrix with given directions in its place; a given direction loses the couplings of the parts."""
    if given is None:
        return matrix
    if isinstance(given[0], list):
        return np.array(given, dtype=float)
    result = matrix.copy()
    for i, value in enumerate(given):
        if value is not None:
            result[i, :] = 0.0
            result[:, i] = 0.0
            result[i, i] = value
    return result


def bodies(body: schema.Body, name: str) -> Iterator[tuple[str, schema.Body]]:
    """The body and all its parts, outermost first, with their names joined by dots."""
    yield name, body
    for part in body.parts:
        yield from bodies(part, f"{name}.{part.name}")
