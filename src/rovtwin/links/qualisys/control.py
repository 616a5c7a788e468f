"""Control of QTM over the network: who has it, and what a measurement is doing.

Replies and events are those of QTM's real-time protocol. The twin streams what swims now, so that a measurement can be
opened, started, stopped and closed; whatever needs files, triggers or cameras is refused with the reason.
"""

from dataclasses import dataclass

CONNECTED, CLOSED, CAPTURE_STARTED, CAPTURE_STOPPED, PLAYING, PLAYED = 1, 2, 3, 4, 8, 9  # events, which are states too
STREAMING = (CONNECTED, CAPTURE_STARTED, PLAYING)  # states in which there are frames
MASTER_ONLY = "You must be master to issue this command"
PASSWORD = "password"  # which the vendor's examples give

# (order, state) -> what QTM says, and the state that follows, sent to all as an event
STEPS: dict[tuple[str, int], tuple[str, int]] = {
    **{("new", state): ("Creating new connection", CONNECTED) for state in (CLOSED, CAPTURE_STOPPED, PLAYING, PLAYED)},
    **{("close", state): ("Closing connection", CLOSED) for state in (CONNECTED, CAPTURE_STARTED, CAPTURE_STOPPED)},
    **{("close", state): ("Closing file", CLOSED) for state in (PLAYING, PLAYED)},
    ("start", CONNECTED): ("Starting measurement", CAPTURE_STARTED),
    ("start rtfromfile", PLAYED): ("Starting RT from file", PLAYING),
    ("stop", CAPTURE_STARTED): ("Stopping measurement", CAPTURE_STOPPED),
    ("stop", PLAYING): ("Stopping measurement", PLAYED),
}
# What QTM says to an order that changes nothing in the state it is in, and whether that is an error
IDLE: dict[str, tuple[str, bool]] = {
    "new": ("Already connected", False),
    "close": ("No connection to close", False),
    "start": ("Failed to start measurement: one is running, or none is open (ask for new)", True),
    "start rtfromfile": ("Failed to start RT from file: it is running, or there is no file", True),
    "stop": ("No measurement is running", True),
}
# What is not done for a master either
REFUSED: dict[str, str] = {
    "load": "Failed to load file: the twin has no QTM files, it streams what swims now (ask for new)",
    "loadproject": "Failed to load project: the twin has no QTM projects",
    "save": "Failed to save measurement: the twin writes no QTM files; rovtwin serve --log keeps the truth",
    "trig": "Trig failed: the twin starts without a trigger",
    "event": "Event not set: the twin saves no measurement that could keep it",
    "calibrate": "Can not start calibration: the twin's cameras are calibrated",
    "reprocess": "Reprocessing failed: the twin has no QTM files",
    "led": "Led not set: the twin has no cameras",
    **{name: "No capture: the twin saves no measurement" for name in ("getcapturec3d", "getcaptureqtm", "getcapture")},
}
REFUSED["setqtmevent"] = REFUSED["event"]
ORDERS = {"new", "close", "start", "stop", *REFUSED}


@dataclass
class Control:
    """Who is in control, and what the measurement is doing.

    Attributes:
        password: That gives control; None: nobody gets it.
        master: Name of the client in control, or empty.
        state: What the measurement is doing, as the event that began it.
    """

    password: str | None
    master: str = ""
    state: int = PLAYING

    def take(self, who: str, words: list[str]) -> tuple[str, bool]:
        """A client asks for control: what QTM says, and whether that is an error."""
        if self.password is None:
            return "Client control disabled in QTM", True
        if self.master == who:
            return "You are already master", False
        if self.master:
            return f"The current master is {self.master}", True
        if words != [self.password]:
            return "Wrong or missing password", True
        self.master = who
        return "You are now master", False

    def release(self, who: str) -> str:
        """A client gives control back, or leaves: what QTM says."""
        if self.master != who:
            return "You are already a regular client"
        self.master = ""
        return "You are now a regular client"

    def obey(self, who: str, order: str, words: list[str]) -> tuple[str, bool]:
        """An order of `ORDERS`: what QTM says, and whether that is an error. `state` is what follows."""
        if self.master != who:
            return MASTER_ONLY, True
        if order in REFUSED:
            return REFUSED[order], True
        order = " ".join([order, *(word.lower() for word in words)])
        if order not in IDLE:
            return "Parse error", True
        step = STEPS.get((order, self.state))
        if step is None:
            return IDLE[order]
        text, self.state = step
        return text, False
