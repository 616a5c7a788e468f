"""Stages that take no time, for the process of a stage and for the page: what each does is in its name."""

import os
import signal
import time

from rovtwin.commission.stage import Check, Outcome, Stage
from rovtwin.runs.interrupt import Interrupt

FOUND = Check("ok", "thing", "as expected")


def looks(work):
    work.person.progress("looking at it", 0.5)
    work.person.say("it is looked at")
    (work.folder / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    return Outcome((FOUND, Check("note", "size", "it is small")), {"found": 1}, ("picture.png",), 2.0)


def asks(work):
    """A yes, then a figure; nothing is moved without the yes, which the file `moved` would show."""
    if not work.may_move("May it move? Are all hands away?"):
        return Outcome((Check("stop", "asked", "it was not confirmed.", "Repeat this stage."),))
    (work.folder / "moved").write_text("yes")
    work.at_rest()
    reading = work.person.number("What does the scale read", "N")
    return Outcome((FOUND,), {"reading": reading}, ("moved",))


def flies(work):
    """Moves for a minute, by a loop that ends in order when it is interrupted."""
    if not work.may_move("May it fly?"):
        return Outcome((Check("stop", "asked", "it was not confirmed.", "Repeat this stage."),))
    (work.folder / "log.mcap").write_bytes(b"what was measured")
    with Interrupt() as interrupt:
        work.person.progress("flying", 0.1)
        until = time.monotonic() + 60.0
        while time.monotonic() < until and not interrupt.asked:
            time.sleep(0.01)
    ended = Check("stop", "flight", "ended early: interrupted.", "Take a larger tank.")
    return Outcome((ended if interrupt.asked else FOUND,), files=("log.mcap",))


def computes(work):
    """Until somebody ends it; it does not look whether anybody does."""
    (work.folder / "begun").write_text("")
    work.person.progress("computing")
    time.sleep(60.0)
    return Outcome((FOUND,))


def dies(work):
    os.kill(os.getpid(), signal.SIGKILL)


def fails(work):
    raise TypeError("a mistake of ours")


def cheap(run, moves=False, connects=False):
    name = run.__name__
    return Stage(name, name.title(), f"what it is that {name}", f"Put it where it {name}.", moves, run, connects)


STAGES = (cheap(looks), cheap(asks, True), cheap(flies, True, True), cheap(computes))
DIES = (cheap(dies),)
FAILS = (cheap(fails),)
