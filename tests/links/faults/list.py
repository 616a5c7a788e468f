"""The cases of the table, protocol by protocol."""

from tests.links.faults.bench import STREAMS
from tests.links.faults.cases import (
    BLUEYE_WATCHDOG,
    BUSY,
    DATAGRAMS,
    LATER,
    LIFE,
    MAVLINK_WATCHDOG,
    ONE,
    SDK,
    SDK_LATER,
    STATION,
    STREAM,
    TWO,
    Case,
    another,
    cable_back,
    cable_out,
    cut,
    given_up,
    goes_on,
    holed,
    ignored,
    jumped,
    killed,
    one_after_the_other,
    one_of_two,
    physics_killed,
    synchronised,
    until_given_up,
)
from tests.links.faults.wire import Fault

HALF = Fault(delay=0.5)
JITTER = Fault(jitter=0.5)
LOSS, REORDER = Fault(loss=0.2), Fault(held=0.3, hold=0.2)
CUT, GARBAGE, TWICE, TENFOLD = Fault(cut=0.2), Fault(garbage=0.2), Fault(twice=0.5, held=0.2), Fault(copies=10)
TORN, NOISE = Fault(cut=0.02), Fault(garbage=0.02)  # of a stream: each breaks its connection
LOST = 3.0  # silence after which links give up, BlueyeLink.LOST_AFTER and MavlinkLink.STALE_MODE [s]
PAUSE = 3.0  # a command may have to wait for a new connection, or for two watchdogs after some got lost [s]


def _blueye() -> list[Case]:
    def case(fault, client, where, bound, run, **more) -> Case:
        return Case("blueye", fault, client, where, bound, run, **more)

    watchdog, late = BLUEYE_WATCHDOG + BUSY, 0.5 + BUSY
    return [
        case("delay of 500 ms", "link", ONE, late, goes_on("port", HALF, lag=late)),
        case("delay of 500 ms", "link", TWO, late, goes_on("port", HALF, lag=late)),
        case("delay of 500 ms", "sdk", SDK, late, goes_on("port", HALF, lag=late)),
        case("delay of 0 to 500 ms, out of order", "link", LATER, late, goes_on("messages", JITTER, lag=late)),
        case("20 % loss", "link", LATER, LIFE + BUSY, goes_on("messages", LOSS, lag=PAUSE, hold=3.0)),
        case("20 % loss", "sdk", SDK_LATER, watchdog, goes_on("messages", LOSS, lag=PAUSE, hold=3.0)),
        case(
            "reordering (30 % 200 ms late)", "link", LATER, LIFE + BUSY, goes_on("messages", REORDER, lag=LIFE + BUSY)
        ),
        case("truncated messages, 20 %", "link", LATER, LIFE + BUSY, goes_on("messages", CUT, lag=PAUSE)),
        case("garbage for 20 % of messages", "link", LATER, LIFE + BUSY, until_given_up("messages", GARBAGE)),
        case("truncated commands, 20 %", "sdk", SDK_LATER, watchdog, goes_on("messages", up=CUT, lag=PAUSE)),
        case("garbage for 20 % of commands", "sdk", SDK_LATER, watchdog, goes_on("messages", up=GARBAGE, lag=PAUSE)),
        case("connections torn in mid-message", "link", ONE, watchdog, goes_on("port", TORN, lag=PAUSE)),
        case("garbage in the streams", "link", ONE, watchdog, goes_on("port", NOISE, lag=PAUSE)),
        case("10 times the messages", "link", LATER, LIFE + BUSY, goes_on("messages", TENFOLD)),
        case("10 times the messages", "sdk", SDK_LATER, LIFE + BUSY, goes_on("messages", TENFOLD)),
        case("half-open connection", "link", ONE, watchdog, cut(holed("port"), then=given_up("port"))),
        case("half-open connection", "sdk", SDK, watchdog, cut(holed("port"), then=given_up("port"))),
        case("half-open, one of two drones", "link", TWO, watchdog, one_of_two),
        case("only commands are lost", "link", ONE, watchdog, cut(holed("port", down=False), then=given_up("port"))),
        case(
            *("only telemetry is lost", "link", ONE, LOST + BUSY),
            cut(holed("port", up=False), "the link gives up", then=given_up("port")),
        ),
        case(
            *("only telemetry of one of two drones is lost", "link", TWO, 0.5 + BUSY),
            cut(holed("starboard", up=False), "the link commands neither"),
        ),
        case("cable out, client killed, late data", "link", ONE, watchdog, cable_out("port", watchdog=BLUEYE_WATCHDOG)),
        case("cable out and back", "sdk", SDK, watchdog, cable_back("port", within=PAUSE)),
        case("client killed -9 (link's process)", "link", ONE, watchdog, cut(killed("host"))),
        case(
            *("client killed -9 (autopilot)", "link", TWO, LIFE + BUSY),
            cut(killed("pilot"), "the link's process lets go"),
        ),
        case("client killed -9 (both processes)", "link", TWO, watchdog, cut(killed("both"))),
        case("client killed -9 (script)", "sdk", SDK, watchdog, cut(killed("pilot"))),
        case("server killed -9", "link", TWO, LIFE + BUSY, cut(killed("server"), "the vehicle lets go")),
        case("vehicle (physics) killed -9", "link", ONE, 1.0, physics_killed),
        case("clock of the link an hour forward", "link", ONE, LIFE + BUSY, jumped("clock_jump", 3600.0)),
        case("clock of the link an hour back", "link", TWO, LIFE + BUSY, jumped("clock_jump", -3600.0)),
        case("clock of the vehicle an hour forward", "link", ONE, LIFE + BUSY, jumped("vehicle_jump", 3600.0)),
        case("clock of the vehicle an hour back", "link", ONE, LIFE + BUSY, jumped("vehicle_jump", -3600.0)),
        case("vehicle's clock set, SyncTime +-1 h", "sdk", SDK, LIFE + BUSY, synchronised),
        case(
            *("second client takes control", "link", ONE, 1.0 + BUSY),
            another("take", STREAMS[0], "thrusters rest until the new client steers"),
        ),
        case("second client connects", "link", ONE, LIFE + BUSY, ignored("sdk", STREAMS[0], "it has to wait")),
    ]


def _mavlink() -> list[Case]:
    def case(fault, client, where, bound, run, **more) -> Case:
        return Case("mavlink", fault, client, where, bound, run, **more)

    watchdog, late, prompt = MAVLINK_WATCHDOG + BUSY, 0.5 + BUSY, LIFE + BUSY
    resent = 3 * 0.25 + BUSY  # of three words to disarm, 0.25 s apart, one arrives
    wire, udp = DATAGRAMS, "udp"
    return [
        case("delay of 500 ms", "link", wire, late, goes_on(udp, HALF, lag=late)),
        case("delay of 500 ms", "link", STREAM, late, goes_on("tcp", HALF, lag=late)),
        case("delay of 500 ms", "pymavlink", STATION, late, goes_on(udp, HALF, lag=late)),
        case("delay of 0 to 500 ms, out of order", "link", wire, late + resent, goes_on(udp, JITTER, lag=late)),
        case("20 % loss", "link", wire, resent, goes_on(udp, LOSS, lag=prompt, hold=3.0)),
        case("20 % loss", "pymavlink", STATION, watchdog, goes_on(udp, LOSS, lag=1.0, hold=3.0)),
        case("reordering (30 % 200 ms late)", "link", wire, prompt, goes_on(udp, REORDER, lag=prompt)),
        case("half of the packets twice, some late", "link", wire, prompt, goes_on(udp, TWICE, lag=prompt)),
        case("truncated packets, 20 %", "link", wire, resent, goes_on(udp, CUT, lag=prompt)),
        case("garbage for 20 % of packets", "link", wire, resent, goes_on(udp, GARBAGE, lag=prompt)),
        case("garbage for 20 % of packets", "pymavlink", STATION, watchdog, goes_on(udp, GARBAGE, lag=1.0)),
        case("garbage in the stream", "link", STREAM, resent, goes_on("tcp", Fault(garbage=0.1), lag=prompt)),
        case(
            *("connection torn in mid-message", "link", STREAM, watchdog),
            cut(lambda made, pilot: made.wires["tcp"].set(Fault(cut=1.0))),
        ),
        case("10 times the packets", "link", wire, prompt, goes_on(udp, TENFOLD)),
        case("10 times the packets", "pymavlink", STATION, prompt, goes_on(udp, TENFOLD)),
        case("nothing arrives any more", "link", wire, watchdog, cut(holed(udp))),
        case("nothing arrives any more", "pymavlink", STATION, watchdog, cut(holed(udp))),
        case("half-open connection", "link", STREAM, watchdog, cut(holed("tcp"), then=given_up("tcp"))),
        case("only commands are lost", "link", wire, watchdog, cut(holed(udp, down=False))),
        case("only telemetry is lost", "link", wire, LOST + BUSY, cut(holed(udp, up=False), "the link goes neutral")),
        case(
            "cable out, client killed, late data", "link", STREAM, watchdog, cable_out("tcp", watchdog=MAVLINK_WATCHDOG)
        ),
        case("client killed -9 (link's process)", "link", wire, watchdog, cut(killed("host"))),
        case(
            "client killed -9 (autopilot)",
            "link",
            wire,
            LIFE + BUSY,
            cut(killed("pilot"), "the link's process lets go"),
        ),
        case("client killed -9 (both processes)", "link", STREAM, watchdog, cut(killed("both"))),
        case("client killed -9 (script)", "pymavlink", STATION, watchdog, cut(killed("pilot"))),
        case("server killed -9", "link", wire, LIFE + BUSY, cut(killed("server"), "the vehicle lets go")),
        case("vehicle (physics) killed -9", "link", wire, 1.0, physics_killed),
        case("clock of the link an hour forward", "link", wire, prompt, jumped("clock_jump", 3600.0)),
        case("clock of the link an hour back", "link", wire, prompt, jumped("clock_jump", -3600.0)),
        case("clock of the vehicle an hour forward", "link", wire, prompt, jumped("vehicle_jump", 3600.0)),
        case("clock of the vehicle an hour back", "link", wire, prompt, jumped("vehicle_jump", -3600.0)),
        case("SYSTEM_TIME and TIMESYNC +-1 h", "pymavlink", STATION, prompt, synchronised),
        case(
            *("second client changes the mode", "link", wire, 1.0 + BUSY),
            another("station", STATION, "the link sends neutral", "mode 2"),
        ),
        case("second client disarms", "link", wire, BUSY, another("station", STATION, "disarmed", "disarm")),
        case("second client listens", "link", wire, prompt, ignored("station", STATION, "it gets telemetry")),
    ]


CASES = [*_blueye(), *_mavlink()]
"""All of the table."""


def _quick() -> list[Case]:
    """What `make test` runs: the faults that leave control possible in one flight each, and the harshest others."""
    messages, datagrams = (LOSS, REORDER, CUT, TENFOLD), (HALF, LOSS, CUT, GARBAGE, TENFOLD, REORDER)
    many = "one after the other"
    chosen = (
        "half-open connection BlueyeLink",
        *("client killed -9 (autopilot) DoubleBlueyeLink", "server killed -9 DoubleBlueyeLink"),
        "client killed -9 (link's process) MavlinkLink, UDP",
    )
    return [
        Case("blueye", many, "link", LATER, LIFE + BUSY, one_after_the_other("messages", messages, PAUSE)),
        Case("mavlink", many, "link", DATAGRAMS, 3 * 0.25 + BUSY, one_after_the_other("udp", datagrams, 0.5 + BUSY)),
        *(case for case in CASES if f"{case.fault} {case.who}" in chosen),
    ]


QUICK = _quick()
