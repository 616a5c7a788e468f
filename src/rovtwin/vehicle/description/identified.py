"""The `identified:` block of a vehicle file: totals found by tests, in place of what the parts give."""

import hashlib
import json
from dataclasses import replace
from typing import Any

from rovtwin.core.errors import ConfigError
from rovtwin.vehicle.description import schema
from rovtwin.vehicle.description.files import with_meshes
from rovtwin.vehicle.description.learned import discrepancy_arrays
from rovtwin.vehicle.description.thruster_arrays import configuration
from rovtwin.vehicle.description.totals.assembly import Assembly, Mounted, with_hydrodynamics, with_restoring
from rovtwin.vehicle.solids.mesh_solid import digest

# For what tests find. A pair that is driven as one gives the same force however far apart its two are.
_NO_MATTER = (
    *("source", "sources", "description", "visuals", "pair_spacing", "keeps_names", "spare_sensors"),
    *schema.SENSOR_FIGURES,
)


def fingerprint(file: schema.VehicleFile) -> str:
    """Of all that parameters depend on: the whole file but names, remarks, looks and the identification itself.

    A mesh counts by its content, wherever it lies.
    """
    data = without_remarks(file.model_dump(mode="json", exclude={"identified", "name"}, exclude_none=True))
    text = json.dumps(with_meshes(data, digest), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def without_remarks(data: Any) -> Any:
    """Data of a file without what parameters do not depend on."""
    if isinstance(data, dict):
        return {k: without_remarks(v) for k, v in data.items() if k not in _NO_MATTER}
    if isinstance(data, list):
        return [without_remarks(v) for v in data]
    return data


def with_identified(total: Assembly, file: schema.VehicleFile, where: str) -> Assembly:
    """Totals with what tests have found in place of the parts' values.

    Raises:
        ConfigError: The parts are not those it was identified with, it names a thruster that is not there, or what it
            learned does not fit the vehicle.
    """
    found = file.identified
    if found is None:
        return total
    now = fingerprint(file)
    if found.made_with != now:
        raise ConfigError(
            f"{where}: identified.made_with: found {found.made_with}, but these parts are {now}: they were changed "
            "after the identification. Keep the old file and run: rovtwin identify NEW --prior OLD_FILE -o NEW_FILE"
        )
    names = [t.name for t in total.thrusters]
    unknown = [name for name in found.thrusters if name not in names]
    if unknown:
        raise ConfigError(f"{where}: identified.thrusters: found '{unknown[0]}', expected one of {', '.join(names)}")
    if found.discrepancy is not None:
        discrepancy_arrays(found.discrepancy, configuration(total.thrusters), where)  # so that mistakes show here
    total = with_hydrodynamics(total, found.hydrodynamics, where)
    total = with_restoring(total, found.restoring, where)
    return replace(total, thrusters=tuple(_identified(t, found.thrusters.get(t.name)) for t in total.thrusters))


def _identified(mounted: Mounted, found: schema.IdentifiedThruster | None) -> Mounted:
    if found is None:
        return mounted
    changes = {key: getattr(found, key) for key in found.model_fields_set if getattr(found, key) is not None}
    return replace(mounted, item=mounted.item.model_copy(update=changes))
