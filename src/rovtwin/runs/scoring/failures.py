"""Which code of one's own gave what is no number, and when: what a run that ended for it is told."""

from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.flow import NOT_A_NUMBER
from rovtwin.gnc.guard import PLACES
from rovtwin.runs.scoring.scores import Failure, Flown
from rovtwin.scenario.schema import ModelBasedSection, Scenario


def first_failure(codes: Any, t: Float[np.ndarray, " ticks"]) -> Failure | None:
    """The first code that is not 0, shape (ticks,), with its time [s]; None where there is none."""
    if codes is None or not np.any(codes):
        return None
    at = int(np.argmax(np.asarray(codes) > 0))
    return Failure(int(codes[at]), float(t[at]))


def failed_block(flown: Flown, scenario: Scenario) -> str:
    """That a block of one's own in the autopilot gave what is no number; empty where none did."""
    section = scenario.autopilot
    blocks = section.own_blocks if isinstance(section, ModelBasedSection) else {}
    rows = flown.mode[:, 1] == NOT_A_NUMBER
    if not blocks or not (flown.failed or rows.any()):
        return ""
    # What is watched is all but the estimate, on which the supervisor aborts by itself.
    place = PLACES[flown.failed.code - 1] if flown.failed else "observer"
    t = flown.failed.t if flown.failed else float(flown.t[np.argmax(rows)])
    where = "autopilot" if place == "autopilot" else f"autopilot.{place}"
    return f"{where}: {blocks[place].label if place in blocks else 'the estimate'} gave {_no_number(t)}"


def broken_force(flown: Flown, scenario: Scenario) -> str:
    """That a force of one's own gave what is no number; empty where none did.

    After it the vehicle is nowhere. The autopilot sees no more than sensors that fall silent, and ends for that.
    """
    if flown.broken_force is None:
        return ""
    i, t = flown.broken_force.code - 1, flown.broken_force.t
    return f"world.forces[{i}]: {scenario.world.forces[i].block} gave {_no_number(t)}"


def _no_number(t: float) -> str:
    return f"a value that is no number at t = {t:.2f} s"
