"""A Blueye drone's state: who controls it, and when it stops. Times are made up."""

import pytest

from rovtwin.links.blueye import wire
from rovtwin.links.blueye.drone.clients import MOST
from rovtwin.links.blueye.drone.drone import FORGET, About, Drone
from rovtwin.links.blueye.wire import Client, Lights, Mode, Motion, Watchdog

HERE = "10.0.0.1"
AHEAD = Motion((1.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.fixture
def drone() -> Drone:
    return Drone("port", About(), watchdog_s=2.0)


@pytest.fixture
def flown(drone) -> Drone:
    """With a pilot (client 1) that drives ahead, holds its depth and has the lights on, at time 0."""
    assert drone.connect(Client(), HERE, 0.0) == 1
    for control in (Watchdog(1), AHEAD, Mode("auto_depth", True), Lights(0.5)):
        drone.obey(control, HERE, 0.0)
    command = drone.command()
    assert (
        command.armed
        and command.motion == AHEAD.share
        and command.hold_depth
        and command.lights == 0.5
        and command.drone == "port"
    )
    return drone


def still(drone: Drone) -> bool:
    command = drone.command()
    return not (
        command.armed or any(command.motion) or command.hold_depth or command.hold_heading or command.hold_position
    )


def test_nothing_moves_without_a_client(drone):
    for control in (Watchdog(0), Watchdog(1), AHEAD, Mode("auto_depth", True)):
        drone.obey(control, HERE, 0.0)
    assert still(drone) and drone.dropped == 2


def test_nothing_moves_before_the_watchdog(drone):
    drone.connect(Client(), HERE, 0.0)
    drone.obey(AHEAD, HERE, 0.0)
    assert still(drone)
    drone.obey(Watchdog(1), HERE, 0.5)
    assert drone.command().motion == AHEAD.share


def test_motion_holds_while_the_watchdog_is_fed(flown):
    for t in range(1, 100):
        flown.obey(Watchdog(1), HERE, float(t))
        assert not flown.look(t + 0.9)
    assert flown.command().motion == AHEAD.share


def test_watchdog_stops_everything_and_all_has_to_be_asked_for_again(flown):
    assert not flown.look(2.0)
    assert "silent" in flown.look(2.01)
    assert still(flown) and flown.command().lights == 0.0
    flown.obey(Watchdog(1), HERE, 3.0)
    flown.obey(Watchdog(1), HERE, 4.0)
    assert flown.command().armed and not any(flown.command().motion) and not flown.command().hold_depth


@pytest.mark.parametrize("looked", [True, False], ids=["looked at meanwhile", "backlog first"])
def test_backlog_of_a_dead_client_turns_nothing(flown, looked):
    """The line was down for three seconds; what was sent meanwhile comes within a moment, then nothing more."""
    if looked:
        flown.look(2.5)
    for k in range(60):
        flown.obey(AHEAD, HERE, 3.0 + 1e-3 * k)
        if k % 20 == 0:
            flown.obey(Watchdog(1), HERE, 3.0 + 1e-3 * k)
        assert still(flown)
    flown.look(20.0)
    flown.connect(Client(), HERE, 20.0)
    flown.obey(Watchdog(2), HERE, 20.1)
    assert flown.command().armed and not any(flown.command().motion), "what the dead one wished is forgotten"


def test_living_client_goes_on_by_itself_after_an_outage(flown):
    flown.look(2.5)
    for k in range(3):
        flown.obey(AHEAD, HERE, 3.0 + 1e-3 * k)
        flown.obey(Watchdog(1), HERE, 3.0 + 1e-3 * k)
    flown.obey(Watchdog(1), HERE, 3.4)
    assert still(flown)
    flown.obey(Watchdog(1), HERE, 4.4)
    assert flown.command().armed and flown.command().motion == AHEAD.share
    flown.obey(Watchdog(1), HERE, 5.4)
    assert flown.command().armed


def test_two_backlogs_apart_are_no_life(flown):
    """Pieces that come further apart than the watchdog each begin anew."""
    for t in (3.0, 5.5, 8.0):
        flown.obey(Watchdog(1), HERE, t)
        assert still(flown)


def test_observers_watchdog_feeds_nobody_else(flown):
    flown.connect(Client(), HERE, 0.0)
    flown.obey(Watchdog(2), HERE, 1.9)
    flown.look(2.1)
    assert still(flown)


def test_second_client_waits_and_gets_control_when_the_first_leaves(flown):
    assert flown.connect(Client(), HERE, 0.1) == 2
    assert flown.clients.in_control == 1 and flown.command().armed
    flown.disconnect(1)
    assert flown.clients.in_control == 2 and still(flown)
    flown.obey(Watchdog(1), HERE, 0.2)
    assert still(flown), "who left arms nobody"
    flown.obey(Watchdog(2), HERE, 0.2)
    assert flown.command().armed and not any(flown.command().motion)


def test_observer_never_gets_control(flown):
    flown.connect(Client(observer=True), HERE, 0.1)
    flown.disconnect(1)
    assert flown.clients.in_control == 0 and still(flown)
    flown.obey(Watchdog(2), HERE, 0.2)
    flown.obey(AHEAD, HERE, 0.2)
    assert still(flown)


def test_silent_pilot_is_forgotten_and_the_next_one_gets_control(flown):
    flown.connect(Client(), HERE, 0.0)
    for t in range(1, 15):
        flown.obey(Watchdog(2), HERE, float(t))
        flown.look(float(t))
        assert flown.clients.in_control == (1 if t <= FORGET else 2)


def test_client_that_comes_after_a_silent_pilot_gets_control_at_once(flown):
    """A script that was killed and started again is in control by then."""
    flown.look(2.5)
    assert flown.connect(Client(), HERE, 2.5) == 2
    assert flown.clients.in_control == 2 and list(flown.clients.all) == [2]


def test_commands_from_another_computer_than_the_pilots(flown):
    flown.connect(Client(), "10.0.0.2", 0.0)
    flown.obey(Motion(), "10.0.0.2", 0.1)
    flown.obey(Mode("auto_depth", False), "10.0.0.2", 0.1)
    assert flown.command().motion == AHEAD.share and flown.command().hold_depth and flown.dropped == 2


def test_clients_without_end(drone):
    """A flood of clients costs no memory, and does not cost the pilot its control."""
    drone.connect(Client(), HERE, 0.0)
    for i in range(1000):
        drone.connect(Client(), HERE, 1e-6 * i)
        drone.obey(Watchdog(1), HERE, 1e-6 * i)
    assert len(drone.clients.all) == MOST and drone.clients.in_control == 1


@pytest.mark.parametrize("name", sorted(set(wire.MODES.values()) - {"auto_depth", "auto_heading", "station_keeping"}))
def test_modes_that_the_twin_lacks_stay_off(flown, name):
    flown.obey(Mode(name, True), HERE, 0.1)
    assert flown.modes == {"auto_depth"}


def test_station_keeping_needs_positions(flown):
    flown.obey(Mode("station_keeping", True), HERE, 0.1)
    assert not flown.command().hold_position
    flown.can_keep_position = True
    flown.obey(Mode("station_keeping", True), HERE, 0.1)
    assert flown.command().hold_position
    flown.obey(Mode("station_keeping", False), HERE, 0.1)
    assert not flown.command().hold_position
