"""Thrusters that share one curve: the same kind of thruster, mounted alike."""

from collections import defaultdict

import numpy as np

from rovtwin.vehicle import Vehicle


def thruster_groups(vehicle: Vehicle) -> dict[str, tuple[int, ...]]:
    """Indices of thrusters by group.

    Those of equal name in several parts (`port.surge`, `starboard.surge`) are one group under that name; the others go
    by direction, `horizontal` or `vertical`. Thrusters that are described differently never share a group.
    """
    local = [name.rsplit(".", 1)[-1] for name in vehicle.thruster_names]
    configuration = np.asarray(vehicle.model().thrusters.configuration)
    members: dict[tuple[str, str], list[int]] = defaultdict(list)
    for i, mounted in enumerate(vehicle.assembly.thrusters):
        if local.count(local[i]) > 1:
            label = local[i]
        else:
            label = "vertical" if abs(configuration[2, i]) > 0.7 else "horizontal"
        item = mounted.item.model_dump(exclude={"name", "position", "direction", "source", "health", "power"})
        members[label, repr(item)].append(i)
    labels = [label for label, _ in members]
    groups, count = {}, defaultdict(int)
    for (label, _), indices in members.items():
        count[label] += 1
        groups[label if labels.count(label) == 1 else f"{label}_{count[label]}"] = tuple(indices)
    return groups
