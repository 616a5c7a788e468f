"""Faults on the wire while thrusters turn: what happens, how long until they rest. The table of docs/link_faults.md.

A case either leaves control possible: then the vehicle still obeys, and rests when asked to, all within the fault.
Or it makes control impossible: then the thrusters rest by themselves, and stay so. In both cases nothing crashes, and
after the fault a new connection turns the thrusters again.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from tests.links.faults.bench import MAVLINK, MESSAGES, STREAMS, Bench, Process, Slow, reset, running, wait
from tests.links.faults.vehicle import TCP, UDP
from tests.links.faults.wire import SOUND, Fault

ONE, TWO, LATER = f"blueye://{STREAMS[0]}", f"blueye://{','.join(STREAMS)}", f"blueye://{MESSAGES}"
SDK, SDK_LATER = STREAMS[0], MESSAGES
DATAGRAMS, STREAM = f"mavlink://udpout:{MAVLINK}:{UDP}", f"mavlink://tcp:{MAVLINK}:{TCP}"
STATION = f"udpout:{MAVLINK}:{UDP}"

BUSY = 0.3  # what processes on a busy machine, and periods of 20 to 50 ms, may add [s]
BLUEYE_WATCHDOG, MAVLINK_WATCHDOG = 2.0, 3.0  # BlueyeServer.watchdog_s, FS_PILOT_TIMEOUT [s]
LIFE = 0.3  # of a command in a link's process, of a wish at the vehicle [s]
LONG = 30.0  # for what is not measured [s]


@dataclass(frozen=True)
class Outcome:
    """What a case gave.

    Attributes:
        seconds: From the onset, or from being asked to stop, until all thrusters are commanded zero [s].
        happened: In words.
    """

    seconds: float
    happened: str


@dataclass(frozen=True)
class Case:
    """A fault, who flies, and what is expected.

    Attributes:
        bench: "blueye" or "mavlink".
        client: Kind of pilot, and `where` it flies.
        bound: Longest time to rest [s].
        run: Does it with a pilot that has thrusters turning.
    """

    bench: str
    fault: str
    client: str
    where: str
    bound: float
    run: Callable[[Bench, Process], Outcome]

    @property
    def drones(self) -> int:
        return self.where.count(",") + 1

    @property
    def who(self) -> str:
        """The client, in words."""
        if self.client != "link":
            return {"sdk": "blueye.sdk", "pymavlink": "pymavlink"}[self.client]
        names = {ONE: "BlueyeLink", LATER: "BlueyeLink", TWO: "DoubleBlueyeLink"}
        return names.get(self.where, "MavlinkLink, " + ("TCP" if self.where == STREAM else "UDP"))

    @property
    def id(self) -> str:
        return f"{self.who}: {self.fault}".replace(" ", "-")


def perform(made: Bench, case: Case, patient: bool = False, again: bool = True) -> Outcome:
    """Do a case; whatever is not as it must be is an AssertionError.

    Args:
        made: The bench of the case's protocol.
        case: The case.
        patient: Try up to three times where something took too long, or the thrusters rested before the fault: on a
            machine that others use, too, processes of a test may have to wait for their turn.
        again: Whether a new connection is tried afterwards.
    """
    for left in (2, 1, 0) if patient else (0,):
        try:
            outcome = _perform(made, case)
            break
        except Slow:
            if left == 0:
                raise
    if again:
        with made.flying(case.client, case.where, case.drones):
            pass
    complaints = made.check()
    assert not complaints, complaints[-3000:]
    return outcome


def _perform(made: Bench, case: Case) -> Outcome:
    made.mend()
    try:
        with made.flying(case.client, case.where, case.drones) as pilot:
            outcome = case.run(made, pilot)
    finally:
        made.mend()
    if outcome.seconds > case.bound:
        raise Slow(f"{outcome.seconds:.2f} s until the thrusters rest, expected {case.bound:.2f}")
    return outcome


# --- control goes on


def goes_on(wire: str, both: Fault | None = None, lag: float = BUSY, hold: float = 1.5, **ways: Fault):
    """A fault under which the vehicle still obeys: a reversed command arrives, then it rests when told to."""

    def run(made: Bench, pilot: Process) -> Outcome:
        made.wires[wire].set(both, **ways)
        return _steered(made, pilot, lag, hold)

    return run


def one_after_the_other(wire: str, faults: Sequence[Fault], lag: float) -> Callable[[Bench, Process], Outcome]:
    """Several faults in one flight: under each a reversed command arrives; under the last the vehicle is stopped."""

    def run(made: Bench, pilot: Process) -> Outcome:
        for k, fault in enumerate(faults):
            made.wires[wire].set(fault)
            time.sleep(0.3)
            _obeyed(made, pilot, -0.4 if k % 2 == 0 else 0.4, lag)
        return _steered(made, pilot, lag, 0.3, -0.3 if len(faults) % 2 == 0 else 0.3)

    return run


def until_given_up(wire: str, fault: Fault, hold: float = 3.0) -> Callable[[Bench, Process], Outcome]:
    """A fault under which a link may give up; if it does, the thrusters rest from then on."""

    def run(made: Bench, pilot: Process) -> Outcome:
        made.wires[wire].set(fault)
        end = time.monotonic() + hold
        while time.monotonic() < end and pilot.reported("lost") is None:
            time.sleep(0.01)
        lost = pilot.reported("lost")
        if lost is None:
            return _steered(made, pilot, LONG, 1.0)
        wait(made.resting, LONG, "the thrusters rest")
        time.sleep(0.6)
        assert made.resting(), "they turned again"
        why = " ".join(pilot.lines("lost")[-1][3:12])
        return Outcome(made.rest_after(lost) or 0.0, f"the link may take it for bad news and gives up ({why} ..)")

    return run


def _obeyed(made: Bench, pilot: Process, share: float, lag: float) -> float:
    """How long a reversed command is under way [s]."""
    reported = pilot.say(f"steer {share}")
    wait(lambda: made.commands()[-1][1][0] * share > 0 or not pilot.alive(), LONG, "the reversed command arrives")
    assert pilot.alive(), f"the pilot gave up: {pilot.lines()[-2:]}"
    late = next(t for t, values in made.commands() if t > reported and values[0] * share > 0) - reported
    if late > lag:
        raise Slow(f"a command arrived after {late:.2f} s, expected {lag:.2f} s")
    return late


def _steered(made: Bench, pilot: Process, lag: float, hold: float = 1.5, share: float = -0.4) -> Outcome:
    began = time.monotonic()
    time.sleep(hold)
    late = _obeyed(made, pilot, share, lag)
    turning = made.thrust_share(began, time.monotonic())
    _readings_in_order(pilot, began)
    stopped = pilot.say("stop")
    wait(made.resting, LONG, "the vehicle rests")
    time.sleep(0.5)
    rest = wait(lambda: made.rest_after(stopped), LONG, "the vehicle stays at rest")
    pauses = "" if turning > 0.995 else f", thrust on {100 * turning:.0f} % of the time"
    return Outcome(rest, f"control goes on, a command takes {late:.2f} s{pauses}")


def _readings_in_order(pilot: Process, since: float) -> None:
    """Links hand readings on all the while, those of a sensor in order of time."""

    def received_of() -> list[list[str]]:
        return [line for line in pilot.lines("heard") if float(line[0]) > since]

    if pilot.lines("host"):
        wait(lambda: sum(int(line[2]) for line in received_of()) > 5, LONG, "readings go on coming")
        assert int(received_of()[-1][4]) == 0, "readings went backwards"


# --- control is impossible


def cut(act: Callable[[Bench, Process], float | None], says: str = "", hold: float = 0.6, then=None):
    """A fault that ends control: the thrusters rest by themselves and stay so for `hold` seconds."""

    def run(made: Bench, pilot: Process) -> Outcome:
        onset = time.monotonic()
        onset = act(made, pilot) or onset
        wait(made.resting, LONG, "the thrusters rest")
        rest = made.first_rest(onset)
        assert rest is not None
        time.sleep(hold)
        assert made.rest_after(onset) == rest, "they turned again"
        lost = pilot.reported("lost")
        noticed = f"; the link says so after {max(0.0, lost - onset):.1f} s" if lost else ""
        if then is not None:
            noticed += f"; {then(made, pilot)}"
        return Outcome(rest, f"{says or 'thrusters rest by the watchdog'}{noticed}")

    return run


def holed(*names: str, up: bool = True, down: bool = True) -> Callable[[Bench, Process], None]:
    """Wires that pass nothing on while connections stay open."""

    def act(made: Bench, pilot: Process) -> None:
        hole = Fault(hole=True)
        for name in names:
            made.wires[name].set(up=hole if up else SOUND, down=hole if down else SOUND)

    return act


def one_of_two(made: Bench, pilot: Process) -> Outcome:
    """One drone of a vehicle of two is gone: the other must not go on for long, and the lost one not at all."""
    onset = time.monotonic()
    holed("starboard")(made, pilot)
    wait(made.resting, LONG, "the thrusters rest")
    other, both = made.first_rest(onset, drone=0), made.first_rest(onset)
    assert other is not None and both is not None
    if other > 0.5 + BUSY:
        raise Slow(f"the other drone rests after {other:.2f} s")
    time.sleep(1.5)
    assert made.resting(), "they turned again"
    return Outcome(both, f"the other drone rests after {other:.2f} s, the lost one by its watchdog")


def given_up(*names: str) -> Callable[[Bench, Process], str]:
    """The wire is whole again, but the old connections are not: nothing of them arrives."""

    def then(made: Bench, pilot: Process) -> str:
        reset(made, *names)
        return "its connections were then broken"

    return then


def killed(which: str) -> Callable[[Bench, Process], float]:
    """Kill -9: `pilot` the process that decides, `host` the link's, `both`, or the vehicle's `server`."""

    def act(made: Bench, pilot: Process) -> float:
        host = pilot.children()
        if which == "server":
            made.vehicle.expected_dead = True
            return made.kill(made.protocols)
        pilot.expected_dead = True
        onset = time.monotonic()
        if which in ("pilot", "both"):
            pilot.kill()
        if which in ("host", "both"):
            made.kill(host[0])
        return onset

    return act


def physics_killed(made: Bench, pilot: Process) -> Outcome:
    """The vehicle itself is gone: its server must not go on speaking for it."""
    protocols = made.protocols
    onset = made.vehicle.kill()
    wait(lambda: not running(protocols), LONG, "the server ends")
    gone = time.monotonic() - onset
    with made.reported.open("a") as file:  # nobody is there to say it
        file.write(f"{onset} 0.0\n")
    lost = wait(
        lambda: pilot.reported("lost") or pilot.reported("closed") or _deaf(pilot, onset), LONG, "the client notices"
    )
    return Outcome(gone, f"the server ends with it; the client notices after {max(0.0, lost - onset):.1f} s")


def _deaf(pilot: Process, onset: float) -> float | None:
    """When a pilot that says nothing of it has not received anything for a second [s, monotonic]."""
    received = [float(line[0]) for line in pilot.lines("heard") if int(line[2])]
    last = max(received, default=onset)
    return last + 1.0 if time.monotonic() > last + 1.0 else None


def cut_until_rest(made: Bench, pilot: Process, names: tuple[str, ...]) -> float:
    """Nothing passes until the thrusters rest; how long that took [s]."""
    onset = time.monotonic()
    holed(*names)(made, pilot)
    wait(made.resting, LONG, "the thrusters rest")
    return made.first_rest(onset) or 0.0


def cable_out(*names: str, watchdog: float) -> Callable[[Bench, Process], Outcome]:
    """Nothing passes for longer than the watchdog, the client is killed, then all that was held back comes."""

    def run(made: Bench, pilot: Process) -> Outcome:
        rest = cut_until_rest(made, pilot, names)
        made.kill(pilot.children()[0])
        pilot.kill()
        time.sleep(0.5)
        mended = time.monotonic()
        made.mend()
        time.sleep(watchdog + 1.5)
        again = made.thrust_share(mended, time.monotonic())
        assert again == 0.0, "what came late of a dead client turned the thrusters"
        return Outcome(rest, "thrusters rest by the watchdog; what comes late turns nothing")

    return run


def cable_back(*names: str, within: float) -> Callable[[Bench, Process], Outcome]:
    """Nothing passes for longer than the watchdog, then all that was held back comes: a client that lives goes on."""

    def run(made: Bench, pilot: Process) -> Outcome:
        rest = cut_until_rest(made, pilot, names)
        mended = time.monotonic()
        made.mend()
        wait(made.turning, LONG, "the thrusters turn again")
        late = made.commands()[-1][0] - mended
        if late > within:
            raise Slow(f"the client controls again after {late:.2f} s, expected {within:.2f} s")
        return Outcome(rest, f"thrusters rest by the watchdog; the client controls again {late:.1f} s after the end")

    return run


# --- clocks and other clients


def jumped(file: str, seconds: float) -> Callable[[Bench, Process], Outcome]:
    """A clock jumps: `clock_jump` that of the link, `vehicle_jump` that of the vehicle. Readings and control go on."""

    def run(made: Bench, pilot: Process) -> Outcome:
        getattr(made, file).write_text(str(seconds))
        return _steered(made, pilot, BUSY, 2.0)

    return run


def synchronised(made: Bench, pilot: Process) -> Outcome:
    """The client sets the vehicle's clock an hour forward, then back."""
    for jump in ("3600", "-3600"):
        pilot.say(f"synchronise {jump}")
        time.sleep(0.5)
    return _steered(made, pilot, BUSY, 0.5)


def another(kind: str, where: str, says: str, *orders: str) -> Callable[[Bench, Process], Outcome]:
    """Another client comes, and does what it is given; thrusters rest from the moment that it acts."""

    def run(made: Bench, pilot: Process) -> Outcome:
        other = made.client(kind, where)
        wait(lambda: other.reported("open"), LONG, "the other client is connected")
        onset = other.reported("takes")  # when it begins to connect
        for order in orders:
            onset = other.say(order)
        assert onset is not None
        wait(made.resting, LONG, "the thrusters rest")
        rest = made.first_rest(onset)
        assert rest is not None
        time.sleep(1.5)
        assert made.resting(), "they turned again"
        lost = pilot.reported("lost")
        noticed = f"; the link says so after {max(0.0, lost - onset):.1f} s" if lost else ""
        other.say("close")
        other.process.wait(5.0)
        return Outcome(rest, says + noticed)

    return run


def ignored(kind: str, where: str, says: str, *orders: str) -> Callable[[Bench, Process], Outcome]:
    """Another client comes, and does not disturb."""

    def run(made: Bench, pilot: Process) -> Outcome:
        other = made.client(kind, where)
        wait(lambda: other.reported("open"), LONG, "the other client is connected")
        for order in orders:
            other.say(order)
        outcome = _steered(made, pilot, BUSY, 0.5)
        other.say("close")
        other.process.wait(LONG)
        return Outcome(outcome.seconds, f"{says}; {outcome.happened}")

    return run
