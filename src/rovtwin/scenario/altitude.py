"""How well the distance to the floor was kept, from the truth."""

import numpy as np

from rovtwin.core.flow import GO, HOLD
from rovtwin.core.numerics import as_array, jax
from rovtwin.scenario.compose_world import relief_of
from rovtwin.scenario.schema import Scenario
from rovtwin.scenario.score import Flown


def altitude_error(flown: Flown, scenario: Scenario) -> float | None:
    """Rms of altitude less the wanted one [m], on legs and holds whose way-point has one; None where none has."""
    wanted = np.array([w.altitude or 0.0 for w in scenario.waypoints])
    floor = scenario.world.floor
    if floor is None or not wanted.any():
        return None
    asked = wanted[np.clip(flown.mode[:, 2].astype(int), 0, len(wanted) - 1)]
    follows = np.isin(flown.mode[:, 0], (GO, HOLD)) & (asked > 0.0)
    if not follows.any():
        return None
    relief, eta = relief_of(scenario.world), flown.eta[follows]
    below = floor if relief is None else np.asarray(jax.vmap(lambda at: relief.under(at)[0])(as_array(eta[:, :2])))
    return float(np.sqrt(np.mean((below - eta[:, 2] - asked[follows]) ** 2)))
