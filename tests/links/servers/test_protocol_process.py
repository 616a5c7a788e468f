"""The process that speaks protocols: readings there, wishes back, and what is left when either side goes."""

import asyncio
import os
import signal
import time
from dataclasses import dataclass, field

import numpy as np
import pytest

from rovtwin.core.errors import ConfigError, LinkError
from rovtwin.core.flow import Measurement
from rovtwin.links.servers import protocol_process as apart
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.links.servers.protocol_process import Protocols
from rovtwin.links.servers.served_vehicle import BACKLOG, ServedVehicle
from rovtwin.links.servers.server import Server, require_loopback


@dataclass
class Echo(Server):
    """Wishes a surge as large as the newest depth, and says who it is; or fails."""

    hosts: list[str] = field(default_factory=lambda: ["127.0.0.1"])
    fails: str = ""

    @property
    def addresses(self) -> list[str]:
        return self.hosts

    async def run(self, station: ServedVehicle) -> None:
        if self.fails:
            raise LinkError(self.fails)
        station.say(f"echo of {', '.join(station.drones)} at {station.speed:g}, process {os.getpid()}")
        async for readings in station.readings():
            for reading in readings:
                station.command(PilotCommand(station.drones[0], True, (float(reading.value[0]), 0, 0, 0, 0, 0)))


@dataclass
class Blocked(Echo):
    """A server that blocks the loop: nothing else gets its turn any more."""

    async def run(self, station: ServedVehicle) -> None:
        await asyncio.sleep(0)
        time.sleep(60)


def depth(value: float) -> list[Measurement]:
    return [Measurement("pressure", np.array([value]), 0.0)]


def until(found, seconds=10.0):
    """Whatever `found` gives once it gives something."""
    end = time.monotonic() + seconds
    while not (result := found()):
        assert time.monotonic() < end, "it never came"
        time.sleep(0.005)
    return result


def test_readings_go_there_and_commands_come_back_and_expire():
    with Protocols([Echo()], ["port", "starboard"], 2.0) as protocols:
        assert until(protocols.messages) == [f"echo of port, starboard at 2, process {protocols.pid}"]

        def answer():
            protocols.feed(1.0, depth(0.25))
            return protocols.commands()

        assert until(answer)["port"] == PilotCommand("port", True, (0.25, 0, 0, 0, 0, 0))
        time.sleep(apart.PILOT_COMMAND_LIFE + 0.05)
        assert protocols.commands() == {}
    assert protocols.commands() == {}
    protocols.close()


@pytest.mark.system
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_server_that_is_killed_or_hangs_commands_nothing_and_does_not_hold_up_physics(number):
    with Protocols([Echo()], [""]) as protocols:

        def answer():
            protocols.feed(1.0, depth(0.25))
            return protocols.commands()

        until(answer)
        os.kill(protocols.pid, number)
        struck = time.monotonic()
        slowest = 0.0
        while protocols.commands():
            began = time.monotonic()
            protocols.feed(1.0, depth(0.25) * 50)
            slowest = max(slowest, time.monotonic() - began)
            assert time.monotonic() - struck < apart.PILOT_COMMAND_LIFE + 0.2
        for _ in range(2000):  # far more than a pipe holds
            began = time.monotonic()
            protocols.feed(1.0, depth(0.25) * 50)
            slowest = max(slowest, time.monotonic() - began)
        assert slowest < 0.2
        assert protocols.left_out > 0
        if number == signal.SIGKILL:
            with pytest.raises(LinkError, match="thrusters are off"):
                until(lambda: protocols.messages() and False)


def test_a_server_that_fails_says_why():
    with (
        Protocols([Echo(fails="127.0.0.9:80: taken")], [""]) as protocols,
        pytest.raises(LinkError, match="taken"),
    ):
        until(protocols.messages)


def test_nobody_but_this_machine_unless_it_is_asked_for():
    home, away = Echo(["127.0.0.2", "::1", "localhost"]), Echo(["192.168.1.101"])
    assert require_loopback([home], exposed=False) == []
    with pytest.raises(ConfigError, match=r"192\.168\.1\.101.*--expose"):
        require_loopback([home, away], exposed=False)
    assert require_loopback([home, away], exposed=True) == ["192.168.1.101"]
    with pytest.raises(ConfigError):
        require_loopback([Echo(["0.0.0.0"])], exposed=False)


def test_a_listener_that_is_slow_loses_the_oldest_readings():
    async def run():
        station = ServedVehicle()
        listener = station.readings()
        first = asyncio.ensure_future(anext(listener))
        await asyncio.sleep(0)
        for k in range(3 * BACKLOG):
            station.feed(float(k), depth(float(k)))
        await asyncio.sleep(0)
        got = [(await first)[0].value[0]]
        got += [(await anext(listener))[0].value[0] for _ in range(BACKLOG - 1)]
        await listener.aclose()
        return got, station

    got, station = asyncio.run(run())
    assert got[-1] == 3 * BACKLOG - 1 and got == sorted(got)
    assert station.now == 3 * BACKLOG - 1 and station.latest["pressure"].value[0] == 3 * BACKLOG - 1
    assert station._listeners == []


def test_disarming_counts_when_two_servers_command_one_drone():
    protocols = Protocols.__new__(Protocols)
    protocols._commands = {}
    protocols._receive(10.0, PilotCommand("", True))
    protocols._receive(10.1, PilotCommand("", False))
    protocols._receive(10.15, PilotCommand("", True))
    assert not protocols._commands[""][1].armed
    protocols._receive(10.1 + apart.PILOT_COMMAND_LIFE + 0.01, PilotCommand("", True))
    assert protocols._commands[""][1].armed


def test_what_a_client_is_called_does_not_steer_the_users_terminal():
    texts = []
    ServedVehicle(say=texts.append).say("client \x1b[2J\x1b]0;owned\x07 is in control\n")
    assert texts == ["client ?[2J?]0;owned? is in control?"]


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_command_that_is_no_number_is_none(bad):
    command = PilotCommand(motion=(bad, 0.5, 7.0, -7.0, 0.0, bad), target=(0.0, bad, 0.0, 0.0), lights=bad)
    assert command.motion == (0.0, 0.5, 1.0, -1.0, 0.0, 0.0)
    assert command.target is None and command.lights == 0.0
