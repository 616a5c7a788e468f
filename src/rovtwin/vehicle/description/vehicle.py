"""Vehicle: a description that people edit, and the Model built from it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.constants import GRAVITY
from rovtwin.vehicle.description import files
from rovtwin.vehicle.description.face import VehicleFace
from rovtwin.vehicle.description.identified import with_identified
from rovtwin.vehicle.description.power import PowerSource, power_sources, specific_power
from rovtwin.vehicle.description.schema import VehicleFile
from rovtwin.vehicle.description.thruster_arrays import pairs_apart, thruster_arrays
from rovtwin.vehicle.description.totals.assembly import Assembly, Mounted, assemble
from rovtwin.vehicle.description.totals.validation import require_distinct_in_logs, require_sound
from rovtwin.vehicle.description.water import check_density

if TYPE_CHECKING:
    from rovtwin.vehicle.physics.model import Model


@dataclass(frozen=True, repr=False)
class Vehicle(VehicleFace):
    """A vehicle as its file describes it.

    Attributes:
        file: The description, all parts in place.
        where: File name, for messages.
        water_density: Of the water it is in [kg/m3]; None: the water the file is written for.
        pairs_apart: Whether a pseudo-thruster that stands for a pair is two thrusters.

    Example:
        >>> rovtwin.load_vehicle("double_blueye")
        <Vehicle double_blueye: 30.0 kg, 6 thrusters>
    """

    file: VehicleFile
    where: str
    water_density: float | None = None
    pairs_apart: bool = False

    @property
    def name(self) -> str:
        return self.file.name

    @property
    def description(self) -> str:
        return self.file.description

    @cached_property
    def assembly(self) -> Assembly:
        """Totals at CO."""
        total = with_identified(assemble(self.file, self.where), self.file, self.where)
        if self.pairs_apart:
            total = replace(total, thrusters=pairs_apart(total.thrusters))
        require_distinct_in_logs([t.name for t in total.thrusters], self.where)
        require_distinct_in_logs([t.name for t in total.tethers], self.where, "tethers")
        return total if self.water_density is None else total.in_water(self.water_density)

    @property
    def thruster_names(self) -> list[str]:
        """In the order of the commands, `port.surge`."""
        return [t.name for t in self.assembly.thrusters]

    @property
    def cameras(self) -> list[Mounted]:
        """Cameras with their place in the body frame; R of a camera looking along x is the identity."""
        return list(self.assembly.cameras)

    @property
    def sensors(self) -> list[Mounted]:
        """Sensors with their place in the body frame."""
        return list(self.assembly.sensors)

    @property
    def power_sources(self) -> list[PowerSource]:
        """Batteries, and which thrusters hang on each."""
        return power_sources(self.file, self.assembly.thrusters)

    def specific_power(self) -> Float[np.ndarray, "n 2"]:
        """What each thruster draws, `P = c |F|^1.5`, ahead and astern [W/N^1.5]."""
        return specific_power(self.assembly.thrusters)

    @property
    def tethers(self) -> list[Mounted]:
        """Tethers; each pulls at `placement.point(item.position)`."""
        return list(self.assembly.tethers)

    def in_water(self, density: float) -> Vehicle:
        """The same vehicle in water of another density [kg/m3]: buoyancy, drag and added mass scale with it.

        Raises:
            ConfigError: No water has that density.
        """
        return replace(self, water_density=check_density(density))

    def with_pairs_apart(self) -> Vehicle:
        """The vehicle as its own electronics drive it: each pair that the file counts as one thruster is two."""
        return replace(self, pairs_apart=True)

    @property
    def doubts(self) -> list[str]:
        """Why its identification is not to be relied on, one reason each; empty where nothing was said against it."""
        return [] if self.file.identified is None else self.file.identified.estimate.doubts

    def without_identification(self) -> Vehicle:
        """The same parts with their own values, without what tests found of them."""
        return replace(self, file=self.file.model_copy(update={"identified": None}))

    def model(
        self,
        *,
        supply_voltage: float | None = None,
        water_density: float | None = None,
        net_buoyancy: float | None = None,
    ) -> Model:
        """The arrays that equations use.

        Args:
            supply_voltage: At which all thrust tables are read [V]; else each at that of the nearest part.
            water_density: As `in_water` [kg/m3]; else the vehicle's.
            net_buoyancy: Buoyancy less weight, positive floats [N]; else as the file says.

        Raises:
            ConfigError: The parts make no vehicle that can move: M not positive definite, damping that drives.
        """
        from rovtwin.core.numerics import as_array
        from rovtwin.vehicle.description.learned import discrepancy_from
        from rovtwin.vehicle.physics.model import Model
        from rovtwin.vehicle.physics.thrusters import Thrusters

        total = self._total(water_density, net_buoyancy)
        body = body_arrays(total)
        require_sound(total, np.asarray(body["rigid_body_mass"]), self.where)
        arrays = thruster_arrays(total.thrusters, supply_voltage, self.where)
        tabulated = arrays.pop("tabulated")
        found, learned = self.file.identified and self.file.identified.discrepancy, None
        if found is not None:
            ratio = total.density / replace(self, water_density=None).assembly.density
            learned = discrepancy_from(found, np.asarray(arrays["configuration"]), self.where, ratio)
        return Model(
            **body,
            thrusters=Thrusters(
                **{key: as_array(value) for key, value in arrays.items()},
                tabulated=as_array(np.asarray(tabulated) > 0, bool),
            ),
            discrepancy=learned,
        )

    def _total(self, water_density: float | None, net_buoyancy: float | None) -> Assembly:
        total = self.assembly
        if water_density is not None:
            total = total.in_water(check_density(water_density))
        if net_buoyancy is not None:
            buoyancy = total.solid.mass * GRAVITY + net_buoyancy
            if not (np.isfinite(buoyancy) and buoyancy >= 0):
                raise ConfigError(f"net buoyancy {net_buoyancy:g} N, expected more than minus the weight")
            total = _ballasted(total, buoyancy)
        return total

    @classmethod
    def load(cls, path: str | Path) -> Vehicle:
        """The vehicle of a file, as `load_vehicle`.

        Raises:
            ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.

        Example:
            >>> path = rovtwin.load_vehicle("double_blueye").save("mine.yaml", overwrite=True)
            >>> rovtwin.Vehicle.load(path) == rovtwin.load_vehicle(path)
            True
        """
        return load_vehicle(path)

    def to_dict(self) -> dict[str, Any]:
        """The complete description as plain data: no references to files, loadable by `vehicle_from_dict`."""
        return self.file.model_dump(mode="json", exclude_defaults=True, exclude_none=True)


def body_arrays(total: Assembly) -> dict[str, Any]:
    """Arrays of a Model from totals at CO, all but the thrusters, by field."""
    from rovtwin.vehicle.physics.hull import hull_of
    from rovtwin.vehicle.physics.model import rigid_body_matrix

    damping, solid = total.damping(), total.solid
    buoyancy = total.density * GRAVITY * total.volume
    return {
        "rigid_body_mass": rigid_body_matrix(solid.mass, solid.inertia, solid.center_of_gravity),
        "added_mass": total.added_mass,
        "linear_damping_ahead": damping.linear_ahead,
        "linear_damping_astern": damping.linear_astern,
        "quadratic_damping_ahead": damping.quadratic_ahead,
        "quadratic_damping_astern": damping.quadratic_astern,
        "weight": solid.mass * GRAVITY,
        "buoyancy": buoyancy,
        "displaced_mass": buoyancy / GRAVITY,
        "center_of_gravity": solid.center_of_gravity,
        "center_of_buoyancy": total.center_of_buoyancy,
        "hull": hull_of(total.boxes, total.center_of_buoyancy),
    }


def _ballasted(total: Assembly, buoyancy: float) -> Assembly:
    return replace(total, volume=buoyancy / (total.density * GRAVITY))


def load_vehicle(name_or_path: str | Path, *, identified: bool = True) -> Vehicle:
    """A vehicle of the library by name, or any vehicle file by path.

    Args:
        name_or_path: `double_blueye`, `my_vehicle.yaml`.
        identified: Whether what tests found counts; False: the parts alone, also where they were changed since.

    Raises:
        ConfigError: With a line per mistake: file, place, what was found, what was expected, the fix.
    """
    path = files.find(name_or_path)
    vehicle = Vehicle(files.load(path), path.name)
    vehicle = vehicle if identified else vehicle.without_identification()
    _ = vehicle.assembly  # so that mistakes show here
    return vehicle


def vehicle_from_dict(data: dict[str, Any], where: str = "vehicle", folder: Path | None = None) -> Vehicle:
    """A vehicle from data as a file would hold it; part files are relative to `folder`."""
    vehicle = Vehicle(files.from_data(data, where, folder), where)
    _ = vehicle.assembly
    return vehicle


def vehicle_schema() -> dict[str, Any]:
    """JSON Schema of vehicle files, for editors."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | VehicleFile.model_json_schema()
