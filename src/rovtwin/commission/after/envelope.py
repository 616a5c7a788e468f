"""Whether the proven envelope still holds for the vehicle as a later dive found it: the missions flown once more.

What the dive has learnt of drag, added mass, forces and balance is put on each drawn vehicle, and the same missions
are flown with the same numbers drawn, beside those of the vehicle without it: what differs between the two is the
change alone, whatever versions and machine computed the proof. The autopilot knows nothing of it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from rovtwin.commission.after.issued import Issued
from rovtwin.commission.proving.cells import OPEN, Cell, Place, flown_beside, largest_current
from rovtwin.commission.proving.missions import open_water
from rovtwin.commission.stage import Check
from rovtwin.commission.work import scenario_of
from rovtwin.core.numerics import as_array, jnp
from rovtwin.monitoring.factors import changed
from rovtwin.monitoring.lost import Lost
from rovtwin.monitoring.quantities import LEARNT
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.ensemble.plants import Plants, plants_of
from rovtwin.runs.watch import WatchedRun
from rovtwin.vehicle.physics.model import Model


@dataclass(frozen=True)
class Envelope:
    """Missions of the proof, flown by the changed vehicle and, beside it, by the unchanged one.

    Attributes:
        cells: A row for each current and sea, of the changed vehicle.
        before: Largest current of each sea when it was certified [m/s], of bundles without it that of `control`; None:
            there was none.
        control: The same now, of the unchanged vehicle.
        after: The same now, of the changed one.
        versions: A line for each package that is another one than at the proof.
    """

    cells: list[Cell]
    before: dict[float, float | None]
    control: dict[float, float | None]
    after: dict[float, float | None]
    versions: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether no sea has a smaller current than before."""
        return not any(_less(self.after.get(sea), then) for sea, then in self.before.items())

    def lines(self) -> list[Check]:
        """What there is to say."""
        found = [line for sea in self.before if (line := self._line(sea))]
        if any(self.control.get(sea) != then for sea, then in self.before.items()):
            why = "; ".join(self.versions) or "the same versions: the processor, or a bundle that was changed"
            found.append(Check("note", "proof", f"the unchanged vehicle is not as certified on this machine: {why}"))
        if not self.holds:
            return found
        return [Check("ok", "envelope", "still holds: the missions of the proof succeed with what has changed"), *found]

    def _line(self, sea: float) -> Check | None:
        """What was lost in a sea, and whether by the change."""
        then, control, now = self.before[sea], self.control.get(sea), self.after.get(sea)
        if not _less(now, then):
            return None
        text = f"{f'sea of {sea:g} m' if sea else 'calm'}: {_upto(now)}, certified {_upto(then)}"
        if _less(now, control):
            fix = "Mend what has changed, or commission again."
            return Check("stop", "envelope", f"{text}; without the change {_upto(control)}.", fix)
        fix = "Go through stage prove once more, with this version."
        return Check("warning", "envelope", f"{text}; without the change {_upto(control)} as well.", fix)


def _less(one: float | None, other: float | None) -> bool:
    """Whether an envelope is smaller than another; None: there is none, which is less than in still water."""
    return (-1.0 if one is None else one) < (-1.0 if other is None else other)


def _upto(current: float | None) -> str:
    return "in no current at all" if current is None else f"up to {current:g} m/s"


def flown_again(issued: Issued, run: WatchedRun, progress: Callable[[float], None]) -> Envelope | None:
    """The missions of the proof with what a dive has found; None where nothing was proven.

    Args:
        issued: The certificate.
        run: The dive.
        progress: Called with the share that is done, 0 to 1.

    Raises:
        ConfigError: The vehicle or the autopilot of the bundle cannot be used.
    """
    proven, request, vehicle = issued.proven, issued.request, issued.vehicle
    places: list[Place] = [(row.sea_m, row.current_m_s) for row in proven.envelope]
    if not places:
        return None
    sections: dict[str, Any] = {"world": OPEN} | open_water(vehicle.model())
    sections |= {} if issued.autopilot is None else {"autopilot": issued.autopilot}
    scenario = scenario_of(request, str(issued.vehicle_file), issued.positions, sections)
    drawn = plants_of(scenario)
    theta = learnt(run)
    plants = Plants(drawn.description, lambda rng: as_found(drawn.drawn(rng), theta, run.lost, vehicle.thruster_names))
    base = compose(scenario, vehicle=vehicle)
    control, found = flown_beside(places, proven.samples, proven.seed, base, [drawn, plants], progress)
    seas = sorted({place[0] for place in places})
    before = {row.sea_m: row.current_m_s for row in proven.largest_currents}
    unchanged, after = ({sea: largest_current(one.cells, sea) for sea in seas} for one in (control, found))
    certified = {sea: before.get(sea, unchanged[sea]) for sea in seas}
    return Envelope(found.cells, certified, unchanged, after, issued.versions)


def learnt(run: WatchedRun) -> Float[np.ndarray, " p"]:
    """theta of what the dive has learnt, 0 for the rest."""
    std, before = np.sqrt(np.diag(run.found.covariance)), np.sqrt(np.diag(run.factors.covariance))
    return np.where(std < LEARNT * before, run.found.theta, 0.0)


def as_found(model: Model, theta: Float[np.ndarray, " p"], lost: Sequence[Lost], thrusters: Sequence[str]) -> Model:
    """A vehicle with these factors, and without the force of the thrusters that were lost."""
    left = np.array([next((one.left for one in lost if one.name == name), 1.0) for name in thrusters])
    new = changed(model, as_array(theta))
    return eqx.tree_at(
        lambda m: (m.thrusters.configuration, m.inertia_inverse),
        new,
        (new.thrusters.configuration * as_array(left), jnp.linalg.inv(new.inertia)),
    )
