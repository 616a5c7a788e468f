"""A served vehicle and its clients as real processes, with wires between them that misbehave on demand."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.links.faults.vehicle import BLUEYE_HOSTS, HTTP, MAVLINK_HOST, TCP, UDP
from tests.links.faults.wire import Loop, TcpProxy, UdpProxy, Wire
from tests.links.faults.wire_zmq import ZmqProxy

REPOSITORY = Path(__file__).parents[3]
STREAMS, MESSAGES = ("127.0.0.32", "127.0.0.33"), "127.0.0.34"  # Blueye behind a proxy of TCP, and of messages
MAVLINK = "127.0.0.41"
PORTS = (5555, 5556, 5557)


class Slow(AssertionError):
    """Something took longer than it may."""


def wait(true: Callable[[], Any], seconds: float, what: str, step: float = 0.005) -> Any:
    """Whatever `true` gives once it gives something."""
    end = time.monotonic() + seconds
    while not (found := true()):
        assert time.monotonic() < end, f"it never happened within {seconds:g} s: {what}"
        time.sleep(step)
    return found


@dataclass
class Process:
    """A program of these tests, its lines, and what it complained of."""

    process: subprocess.Popen[str]
    output: Path
    errors: Path
    expected_dead: bool = False

    def lines(self, word: str = "") -> list[list[str]]:
        found = [line.split() for line in self.output.read_text().split("\n")[:-1]]
        return [words for words in found if len(words) > 1 and words[1] == word] if word else found

    def reported(self, word: str) -> float | None:
        """When a word was last reported [s, monotonic]."""
        found = self.lines(word)
        return float(found[-1][0]) if found else None

    def say(self, text: str) -> float:
        """A line of input; when it was given."""
        assert self.process.stdin is not None
        now = time.monotonic()
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        return now

    def alive(self) -> bool:
        return self.process.poll() is None

    def children(self, name: str = "spawn_main") -> list[int]:
        """Process ids of those that it started to run Python in."""
        pid = self.process.pid
        found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        return [int(p) for p in found if name in Path(f"/proc/{p}/cmdline").read_text().replace("\0", " ")]

    def complaints(self) -> str:
        """Tracebacks and whatever else Python says of errors that nobody caught."""
        text = self.errors.read_text()
        return text if "Traceback" in text or "never awaited" in text else ""

    def kill(self) -> float:
        self.expected_dead = True
        now = time.monotonic()
        self.process.kill()
        return now

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


def running(pid: int) -> bool:
    """Whether a process still is, dead ones that nobody has buried left out."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] not in ("Z", "X")
    except OSError:
        return False


@dataclass
class Bench:
    """A served vehicle behind wires.

    Attributes:
        kind: "blueye" (two drones) or "mavlink".
        wires: By name: "port", "starboard" (TCP), "messages" (ZeroMQ); "udp", "tcp".
        proxies: Of TCP, by the wire's name.
    """

    kind: str
    folder: Path
    loop: Loop
    wires: dict[str, Wire] = field(default_factory=dict)
    proxies: dict[str, list[TcpProxy]] = field(default_factory=dict)
    processes: list[Process] = field(default_factory=list)
    datagrams: UdpProxy | None = None
    _vehicle: Process | None = None
    _count: int = 0

    # --- processes

    def _start(self, module: str, arguments: Sequence[str], environment: dict[str, str]) -> Process:
        self._count += 1
        output, errors = (self.folder / f"{self._count}.{end}" for end in ("out", "err"))
        clean = {k: v for k, v in os.environ.items() if k.lower() != "no_proxy"}
        path = {
            "PYTHONPATH": f"{REPOSITORY / 'src'}:{REPOSITORY}",
            "PYTHONUNBUFFERED": "1",
            "FAULT_BENCH": str(os.getpid()),
        }
        with output.open("w") as out, errors.open("w") as err:
            process = subprocess.Popen(
                [sys.executable, "-m", module, *arguments],
                **{"stdin": subprocess.PIPE, "stdout": out, "stderr": err, "text": True, "cwd": REPOSITORY},
                env=clean | path | environment,
            )
        self.processes.append(Process(process, output, errors))
        return self.processes[-1]

    @property
    def vehicle(self) -> Process:
        """The vehicle's process, started anew when it is gone."""
        if self._vehicle is None or not self._vehicle.alive():
            arguments = [self.kind, str(self.reported), str(self.vehicle_jump)]
            self._vehicle = self._start("tests.links.faults.vehicle", arguments, {})
            vehicle = self._vehicle
            wait(lambda: vehicle.lines() or not vehicle.alive(), 60.0, "the vehicle is served")
            assert vehicle.alive(), vehicle.output.read_text() + vehicle.errors.read_text()
        return self._vehicle

    @property
    def protocols(self) -> int:
        """Process id of the one that speaks protocols."""
        return self.vehicle.children()[0]

    def client(self, kind: str, where: str) -> Process:
        """A pilot; it may not have connected yet."""
        host = where.removeprefix("blueye://").split(",")[0]
        environment = {"http_proxy": f"http://{host}:{HTTP}"} if self.kind == "blueye" else {}
        return self._start("tests.links.faults.pilot", [kind, where, str(self.clock_jump)], environment)

    @contextmanager
    def flying(self, kind: str, where: str, drones: int = 1) -> Iterator[Process]:
        """A pilot that has the thrusters turning."""
        _ = self.vehicle
        wait(self.resting, 10.0, "the thrusters rest before anybody comes")
        pilot = self._connected(kind, where, drones)
        try:
            assert pilot.alive(), pilot.output.read_text() + pilot.errors.read_text()
            yield pilot
        finally:
            if pilot.alive():
                pilot.say("close")
                pilot.expected_dead = True
                try:
                    pilot.process.wait(10.0)
                except subprocess.TimeoutExpired:
                    pass
            pilot.end()
            if self.datagrams is not None:
                self.loop.loop.call_soon_threadsafe(self.datagrams.forget)

    def _connected(self, kind: str, where: str, drones: int) -> Process:
        """A pilot that has the thrusters turning, or the third that could not."""
        for _ in range(3):  # the SDK gives replies 50 ms, which a busy machine may not have
            pilot = self.client(kind, where)
            wait(lambda p=pilot: self.turning(drones) or not p.alive(), 60.0, f"{kind} {where} turns the thrusters")
            if pilot.alive():
                break
        return pilot

    # --- what the vehicle's thrusters are commanded

    @property
    def reported(self) -> Path:
        return self.folder / "told"

    @property
    def vehicle_jump(self) -> Path:
        return self.folder / "vehicle_jump"

    @property
    def clock_jump(self) -> Path:
        return self.folder / "clock_jump"

    def commands(self) -> list[tuple[float, list[float]]]:
        """Changes of the command: time [s, monotonic] and motions of the drones, six each."""
        text = self.reported.read_text() if self.reported.exists() else ""
        rows = [[float(word) for word in line.split()] for line in text.split("\n")[:-1]]
        return [(row[0], row[1:]) for row in rows]

    def turning(self, drones: int = 1) -> bool:
        commands = self.commands()
        return bool(commands) and all(any(commands[-1][1][6 * i : 6 * i + 6]) for i in range(drones))

    def resting(self) -> bool:
        commands = self.commands()
        return not commands or not any(commands[-1][1])

    def rest_after(self, onset: float) -> float | None:
        """From `onset` until all commands are zero and stay so up to now [s]; None while they are not."""
        commands = self.commands()
        if not commands or any(commands[-1][1]):
            return None
        moving = [i for i, (_, values) in enumerate(commands) if any(values)]
        first = moving[-1] + 1 if moving else 0
        return max(0.0, commands[first][0] - onset)

    def first_rest(self, onset: float, drone: int | None = None) -> float | None:
        """From `onset` until all commands, or those of one drone, are zero for the first time [s]."""
        part = slice(None) if drone is None else slice(6 * drone, 6 * drone + 6)
        commands = [(t, values[part]) for t, values in self.commands()]
        before = [values for t, values in commands if t <= onset]
        if not before or not any(before[-1]):
            raise Slow("the thrusters rested before the fault")
        return next((t - onset for t, values in commands if t > onset and not any(values)), None)

    def thrust_share(self, begin: float, end: float) -> float:
        """Share of a time in which any thruster was commanded."""
        commands = [*self.commands(), (end, [])]
        spans = ((max(a, begin), min(b, end), v) for (a, v), (b, _) in zip(commands, commands[1:], strict=False))
        return sum(b - a for a, b, v in spans if b > a and any(v)) / (end - begin)

    # --- the end

    def mend(self) -> None:
        """All wires sound, all clocks right."""
        for wire in self.wires.values():
            wire.mend()
        for file in (self.vehicle_jump, self.clock_jump):
            file.unlink(missing_ok=True)

    def check(self) -> str:
        """What crashed or complained, of all processes there were; nothing when none did."""
        found = [process.complaints() for process in self.processes]
        dead = self._vehicle is not None and not self._vehicle.alive() and not self._vehicle.expected_dead
        return "\n".join([text for text in found if text] + (["the vehicle's process ended"] if dead else []))

    def kill(self, pid: int) -> float:
        """Kill -9 a process; when."""
        now = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        return now


@contextmanager
def bench(kind: str, folder: Path) -> Iterator[Bench]:
    """A vehicle served and its wires, until the block is left."""
    with ExitStack() as stack:
        loop = stack.enter_context(Loop())
        made = Bench(kind, folder, loop)
        if kind == "blueye":
            _blueye_wires(made)
        else:
            made.wires = {"udp": Wire(), "tcp": Wire()}
            made.datagrams = loop.open(UdpProxy(made.wires["udp"], (MAVLINK, UDP), (MAVLINK_HOST, UDP)))
            made.proxies["tcp"] = [loop.open(TcpProxy(made.wires["tcp"], (MAVLINK, TCP), (MAVLINK_HOST, TCP)))]
        try:
            yield made
        finally:
            for process in reversed(made.processes):
                process.end()


def _blueye_wires(made: Bench) -> None:
    for name, here, drone in zip(("port", "starboard"), STREAMS, BLUEYE_HOSTS, strict=True):
        wire = made.wires[name] = Wire()
        proxies = [TcpProxy(wire, (here, port), (drone, port)) for port in (HTTP, *PORTS)]
        made.proxies[name] = [made.loop.open(proxy) for proxy in proxies]
    wire = made.wires["messages"] = Wire()
    made.loop.open(ZmqProxy(wire, MESSAGES, BLUEYE_HOSTS[0]))
    made.loop.open(TcpProxy(Wire(), (MESSAGES, HTTP), (BLUEYE_HOSTS[0], HTTP)))


def reset(made: Bench, *names: str) -> None:
    """Break all connections of some wires, as a host that has given up does."""
    for name in names:
        for proxy in made.proxies[name]:
            made.loop.run(proxy.reset())
