"""The monitor beside an autopilot says what it says of the whole log, a second at a time."""

import time

import numpy as np
import pytest
from tests.identification.synthetic import NOISE, record, steps_command

from rovtwin.core.flow import Slot
from rovtwin.core.frames import rotation_from_euler
from rovtwin.gnc.mounting import Mount
from rovtwin.monitoring.flight import USED, FlightMonitor
from rovtwin.monitoring.monitor import Monitor
from rovtwin.monitoring.quantities import Quantities
from rovtwin.monitoring.readings import levers_of, seen, usable
from rovtwin.vehicle import load_vehicle

DT = 0.02
OF_KIND = {signal: kind for kind, signal in USED.items()}


def ticks_of(given, first, last, late=0.0, rotation=None):
    """Ticks in [first, last) as a flight gives them: times, slots, commands; readings come `late` [s]."""
    k = np.arange(round(first / DT), round(last / DT))
    slots = {}
    for name, signal in given.signals.items():
        value = signal.value
        if name == "gyro" and rotation is not None:
            value = value @ rotation  # along the sensor's own axes
        at = np.ceil((signal.t + late) / DT - 1e-9).astype(int)
        room = int(np.bincount(at).max())
        valid, t_valid = np.zeros((len(k), room), bool), np.zeros((len(k), room))
        values = np.zeros((len(k), room, value.shape[1]))
        for i, tick in enumerate(k):
            rows = np.flatnonzero(at == tick)
            valid[i, : len(rows)], t_valid[i, : len(rows)] = True, signal.t[rows]
            values[i, : len(rows)] = value[rows]
        slots[OF_KIND[name]] = Slot(values, valid, t_valid)
    return DT * k, slots, given.command_at(DT * k)


@pytest.fixture(scope="module")
def flown():
    vehicle = load_vehicle("bluerov2_heavy")
    t, u = steps_command(vehicle, 3, 30.0)
    return vehicle, record(vehicle.model(), t, 0.7 * u, 30.0, 3, ("depth", "attitude", "gyro", "velocity"))


def mounts_of(given, **others):
    return {OF_KIND[name]: Mount(NOISE[name]) for name in given.signals} | others


def fed(vehicle, given, mounts, **how):
    """A monitor that has been given all of a flight, and what it said last."""
    monitor, text = FlightMonitor(vehicle.model(), vehicle.thruster_names, mounts, DT), None
    monitor.warm()
    for second in range(29):
        text = monitor.take(*ticks_of(given, second, second + 1, **how)) or text
        while monitor._busy is not None and not monitor._busy.done():
            time.sleep(0.01)
    monitor.close()
    return monitor, text


@pytest.mark.system
def test_it_says_what_the_whole_log_says(flown):
    vehicle, given = flown
    monitor, text = fed(vehicle, given, mounts_of(given))
    assert monitor.trouble == ""
    whole = Monitor(vehicle.model(), vehicle.thruster_names, levers_of(usable(given)), 300.0)
    whole.begin(np.array([0.0, 0.0, 1.0]), given.signals["attitude"].value[0])
    steps = seen(vehicle.model(), given.cut(1.0, 21.0), whole.filter.h)
    a_second = round(1.0 / whole.filter.h)
    import jax

    for k in range(20):
        whole.second(jax.tree.map(lambda leaf, i=k * a_second: leaf[i : i + a_second], steps))
    expected = Quantities(vehicle.model(), vehicle.thruster_names, whole.factors).read(whole.found())
    assert len(monitor._monitor.blocks) == 2
    for one, other in zip(text.readings, expected, strict=True):
        assert abs(one.value - other.value) < 0.1 * other.std, one.quantity.name
        assert one.std == pytest.approx(other.std, rel=0.02)


@pytest.mark.system
def test_readings_that_come_late_are_put_where_they_belong(flown):
    vehicle, given = flown
    _, prompt = fed(vehicle, given, mounts_of(given))
    _, late = fed(vehicle, given, mounts_of(given), late=0.4)
    for one, other in zip(prompt.readings, late.readings, strict=True):
        assert abs(one.value - other.value) < 0.2 * one.std


@pytest.mark.system
def test_sensors_are_turned_as_they_are_mounted(flown):
    vehicle, given = flown
    rotation = np.asarray(rotation_from_euler(np.radians([10.0, -20.0, 90.0])))
    _, straight = fed(vehicle, given, mounts_of(given))
    _, askew = fed(vehicle, given, mounts_of(given, gyro=Mount(NOISE["gyro"], rotation=rotation)), rotation=rotation)
    for one, other in zip(straight.readings, askew.readings, strict=True):
        assert other.value == pytest.approx(one.value, abs=1e-6)


def test_trouble_ends_the_monitor_and_not_the_flight(flown):
    vehicle, given = flown
    mounts = mounts_of(given)
    blind = FlightMonitor(vehicle.model(), vehicle.thruster_names, {"pressure": mounts["pressure"]}, DT)
    assert blind.trouble == "no attitude or no gyro on board" and blind.take(*ticks_of(given, 0, 1)) is None
    monitor = FlightMonitor(vehicle.model(), vehicle.thruster_names, mounts, DT)
    t, slots, command = ticks_of(given, 0, 1)
    assert monitor.take(t, slots, command[:, :3]) is None and "dimension" in monitor.trouble
    assert monitor.take(t, slots, command) is None


def test_a_position_that_comes_late_does_not_end_it_and_a_silent_gyro_does(flown):
    vehicle, given = flown
    mounts = mounts_of(given, position=Mount(0.5))
    for silent, expected in ((None, ""), ("gyro", "no gyro within 60 s")):
        monitor = FlightMonitor(vehicle.model(), vehicle.thruster_names, mounts, DT)
        t, slots, command = ticks_of(given, 0, 1)
        slots.pop(silent, None)
        monitor.take(t, slots, command)
        late = {"position": Slot(np.zeros((1, 1, 2)), np.ones((1, 1), bool), np.full((1, 1), 61.9))}
        monitor.take(np.array([62.0]), late, command[-1:])
        assert monitor.trouble == expected
        monitor.close()
