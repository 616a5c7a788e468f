"""Columns of what thrusters do: which readings count."""

import numpy as np
import pytest

from rovtwin.commission.dip.response import columns
from rovtwin.core.errors import IdentificationError
from rovtwin.identification.logs.record import Record, Signal
from rovtwin.vehicle import load_vehicle


def at_depth(depth: float) -> Record:
    """A vehicle that keeps its place while thrusters turn, one after the other."""
    thrusters = load_vehicle("bluerov2").model().thrusters.count
    t = np.arange(0.0, 20.0, 0.01)
    command = np.zeros((len(t), thrusters))
    for i in range(thrusters):
        command[200 + 150 * i : 260 + 150 * i, i] = 0.5
    rng = np.random.default_rng(0)
    signals = {name: Signal(t, 1e-3 * rng.normal(size=(len(t), 3))) for name in ("gyro", "attitude")}
    return Record("pushes", t, command, signals | {"depth": Signal(t, np.full((len(t), 1), depth))}, 20.0)


@pytest.mark.parametrize(("depth", "clear"), [(0.75, True), (0.1, False), (1.42, False)])
def test_at_the_surface_and_near_the_floor_pushes_are_no_free_motion(depth, clear):
    """A light vehicle that had floated up was found to have its accelerometer upside down."""
    model = load_vehicle("bluerov2").model()
    if clear:
        assert np.isfinite(columns(model, at_depth(depth), 1.5).measured[3:]).all()
        return
    with pytest.raises(IdentificationError, match=r"found 0.0 s .* clear of floor and surface.* let go of it only"):
        columns(model, at_depth(depth), 1.5)
