"""Whether the proven envelope still holds for the vehicle as a later dive found it: the missions flown once more.

What the dive has learnt of drag, added mass, forces and balance is put on each drawn vehicle, and the same missions
are flown with the same numbers drawn: what differs is the change alone. The autopilot knows nothing of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np

from rovtwin.campaign.tuning.plants import Plants, plants_of
from rovtwin.commission.after.issued import Issued
from rovtwin.commission.proving.cells import OPEN, Cell, Place, flown_in, largest_current
from rovtwin.commission.proving.missions import open_water
from rovtwin.commission.stage import Check
from rovtwin.commission.work import positions_of, scenario_of
from rovtwin.core.numerics import as_array, jnp
from rovtwin.monitoring.factors import changed
from rovtwin.monitoring.lost import Lost
from rovtwin.monitoring.quantities import LEARNT
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.watch import WatchedRun
from rovtwin.vehicle.physics.model import Model


@dataclass(frozen=True)
class Envelope:
    """Missions of the proof, flown by the changed vehicle.

    Attributes:
        cells: A row for each current and sea.
        before: Largest current of each sea when it was certified [m/s]; None: there was none.
        after: The same now.
    """

    cells: list[Cell]
    before: dict[float, float | None]
    after: dict[float, float | None]

    @property
    def holds(self) -> bool:
        """Whether no sea has a smaller current than before."""
        return all(self._lost(sea) is None for sea in self.before)

    def _lost(self, sea: float) -> str | None:
        then, now = self.before[sea], self.after.get(sea)
        if then is None or (now is not None and now >= then):
            return None
        left = "in no current at all" if now is None else f"up to {now:g} m/s"
        return f"{f'sea of {sea:g} m' if sea else 'calm'}: {left}, certified up to {then:g} m/s"

    def lines(self) -> list[Check]:
        """What there is to say."""
        lost = [text for sea in self.before if (text := self._lost(sea))]
        if not lost:
            return [Check("ok", "envelope", "still holds: the missions of the proof succeed with what has changed")]
        return [Check("stop", "envelope", f"{text}.", "Mend what has changed, or commission again.") for text in lost]


def flown_again(issued: Issued, run: WatchedRun, progress: Callable[[float], None]) -> Envelope | None:
    """The missions of the proof with what a dive has found; None where nothing was proven.

    Args:
        issued: The certificate.
        run: The dive.
        progress: Called with the share that is done, 0 to 1.

    Raises:
        ConfigError: The vehicle or the autopilot of the bundle cannot be used.
    """
    proven = issued.measured.get("prove", {})
    places: list[Place] = [(row["sea_m"], row["current_m_s"]) for row in proven.get("envelope", [])]
    if not places:
        return None
    vehicle, request = issued.vehicle, issued.request
    sections: dict[str, Any] = {"world": OPEN} | open_water(vehicle.model())
    sections |= {} if issued.autopilot is None else {"autopilot": issued.autopilot}
    positions = positions_of(vehicle, issued.measured.get("bench", {}))
    scenario = scenario_of(request, str(issued.vehicle_file), positions, sections)
    drawn = plants_of(scenario)
    theta = learnt(run)
    plants = Plants(drawn.description, lambda rng: as_found(drawn.drawn(rng), theta, run.lost, vehicle.thruster_names))
    found = flown_in(places, request.samples, request.seed, compose(scenario, vehicle=vehicle), plants, progress)
    seas = sorted({place[0] for place in places})
    before = {row["sea_m"]: row["current_m_s"] for row in proven.get("largest_currents", [])}
    return Envelope(
        found.cells, {sea: before.get(sea) for sea in seas}, {sea: largest_current(found.cells, sea) for sea in seas}
    )


def learnt(run: WatchedRun) -> np.ndarray:
    """theta of what the dive has learnt, 0 for the rest, shape (p,)."""
    std, before = np.sqrt(np.diag(run.found.covariance)), np.sqrt(np.diag(run.factors.covariance))
    return np.where(std < LEARNT * before, run.found.theta, 0.0)


def as_found(model: Model, theta: np.ndarray, lost: Sequence[Lost], thrusters: Sequence[str]) -> Model:
    """A vehicle with these factors, and without the force of the thrusters that were lost."""
    left = np.array([next((one.left for one in lost if one.name == name), 1.0) for name in thrusters])
    new = changed(model, as_array(theta))
    return eqx.tree_at(
        lambda m: (m.thrusters.configuration, m.inertia_inverse),
        new,
        (new.thrusters.configuration * as_array(left), jnp.linalg.inv(new.inertia)),
    )
