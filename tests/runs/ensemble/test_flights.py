"""Flights of drawn vehicles: who is drawn, and that results come in order, whatever thread flew them."""

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.campaign.identified import identified_vehicle

from rovtwin.commission.proving.missions import open_water
from rovtwin.core.errors import RovtwinError
from rovtwin.core.user_files.config import parse
from rovtwin.runs.batch import same_program
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.ensemble import flights
from rovtwin.runs.ensemble.flights import LANES
from rovtwin.runs.ensemble.plants import plants_of
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle import load_vehicle


def numbered(numbers) -> list[Any]:
    """Stand for composed flights."""
    return [SimpleNamespace(number=number) for number in numbers]


@pytest.fixture
def in_threads(monkeypatch):
    """Flights that take some time and return their number; how many flew in each call."""
    sizes = []

    def flown_together(runs, progress):
        sizes.append(len(runs))
        for share in (0.5, 1.0):
            time.sleep(0.01 if runs[0].number else 0.05)
            progress(share, len(runs))
        if any(run.number < 0 for run in runs):
            raise RovtwinError("no vehicle")
        return [run.number for run in runs]

    monkeypatch.setattr(flights, "flown_together", flown_together)
    monkeypatch.setattr(flights, "same_program", lambda runs: [list(range(len(runs)))])
    monkeypatch.setattr(flights, "_compile", lambda firsts: None)
    return sizes


def test_results_come_in_order_from_portions_of_one_size(in_threads):
    shares = []
    found = flights.fly_all(numbered(range(2 * LANES + 3)), shares.append)
    assert found == list(range(2 * LANES + 3))
    assert set(in_threads) == {LANES} and len(in_threads) == 3
    assert shares[-1] == 1.0 and shares == sorted(shares)


def test_what_goes_wrong_in_a_thread_comes_out(in_threads):
    with pytest.raises(RovtwinError, match="no vehicle"):
        flights.fly_all(numbered([*range(LANES), -1, *range(5 * LANES)]))


def test_draws_are_vehicles_noise_and_water_of_their_own_for_one_program(tmp_path):
    path = str(identified_vehicle(tmp_path / "identified.yaml"))
    vehicle = load_vehicle(path)
    scenario = parse(Scenario, {"vehicle": path} | open_water(vehicle.model()), "made")
    base, plants = compose(scenario), plants_of(scenario)
    still, same, running = (
        flights.drawn(base, plants, (1, i), {"current": {"velocity": [speed, 0.0, 0.0]}})
        for i, speed in ((1, 0.0), (1, 0.0), (2, 0.2))
    )
    drags = [float(np.asarray(one.loop.twin.model.quadratic_damping_ahead)[0, 0]) for one in (base, still, running)]
    assert len(set(drags)) == 3  # the drawn ones differ from the model and from each other
    assert still.scenario.seed == same.scenario.seed != running.scenario.seed
    assert float(same.loop.twin.model.quadratic_damping_ahead[0, 0]) == drags[1]
    assert list(same_program([still, same, running])) == [[0, 1, 2]]
    assert still.loop.autopilot is base.loop.autopilot and still.model is base.model
