"""Lockstep: physics that take one step for each packet of the firmware, and answer it."""

import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from rovtwin.core.errors import LinkError
from rovtwin.links.ardusub_json.wire import State, decode_servos, encode_state
from rovtwin.links.servers.server import address_taken

PORT = 9002  # where ArduPilot's simulation sends to
PATIENCE = 0.1  # longest wait for a packet before looking whether to end [s]
CHANGE = 2.0  # the firmware asks again after 1 s: who is silent for longer is gone [s]
LATE = 8  # a packet so few frames old was delayed on its way; one from further back is a new beginning
LARGEST = 2048  # bytes of a datagram that are looked at

# Pulse widths [us] and the time to go on by [s] -> where the physics are then.
Advance = Callable[[tuple[int, ...], float], State]


@dataclass
class Counts:
    """What came and went.

    Attributes:
        steps: Packets that moved the physics on.
        repeats: Packets that came twice and got the same answer again.
        resets: Times that the firmware began anew.
        strangers: Packets of others while the firmware was there.
        late: Packets with a number from before, of no use any more.
        lost: Numbers that never came.
        under_way: Packets of a firmware that had begun before these physics.
        garbage: Datagrams that were no packet.
    """

    steps: int = 0
    repeats: int = 0
    resets: int = 0
    strangers: int = 0
    late: int = 0
    lost: int = 0
    under_way: int = 0
    garbage: int = 0


class Lockstep:
    """A UDP server that takes the firmware's outputs and answers with the state after one of its frames.

    The firmware waits for each answer (it asks again after a second or so), so time goes as fast as both can. Who sends
    first is the firmware until it is silent for CHANGE seconds; others are not answered. A new firmware, or one that
    counts from the beginning again, is a reset. A firmware that is already under way flies a vehicle that these physics
    do not know, as after a crash of this process: it gets no answer, and so waits, until it is started anew.

    Args:
        advance: The physics.
        reset: Puts the physics back to their beginning; called before the first step after a reset, not at first.
        address: Host to bind.
        port: UDP port to bind; 0 for a free one, see `port`.
        say: Takes what a user should know.

    Raises:
        LinkError: The address cannot be bound.
    """

    def __init__(
        self,
        advance: Advance,
        reset: Callable[[], None] = lambda: None,
        address: str = "127.0.0.1",
        port: int = PORT,
        say: Callable[[str], None] = lambda text: None,
    ):
        self._advance, self._reset, self._say = advance, reset, say
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((address, port))
        except OSError as error:
            self._socket.close()
            raise LinkError(address_taken(f"ardusub-json: udp {address}:{port}", error)) from None
        self._socket.settimeout(PATIENCE)
        self.addresses = [address]
        self.port: int = self._socket.getsockname()[1]
        self.counts = Counts()
        self._ending = threading.Event()
        self._count = -1
        self._sender: tuple[str, int] | None = None
        self._received_at = 0.0
        self._answer = b""

    def run(self) -> None:
        """Answer until `stop`.

        Raises:
            LinkError: The physics gave something that is no state.
        """
        while not self._ending.is_set():
            self.serve_one()

    def serve_one(self) -> bool:
        """Wait a tenth of a second at most for a datagram and answer it; whether the physics moved on."""
        try:
            data, sender = self._socket.recvfrom(LARGEST)
        except TimeoutError:
            return False
        except OSError:  # closed while waiting, or the sender's port is gone
            return False
        return self._take(data, sender)

    def stop(self) -> None:
        """Let `run` end; returns at once and may be called from any thread, also twice."""
        self._ending.set()

    def close(self) -> None:
        """Stop and let go of the port; may be called twice."""
        self.stop()
        self._socket.close()

    def _take(self, data: bytes, sender: tuple[str, int]) -> bool:
        try:
            servos = decode_servos(data)
        except LinkError:
            self.counts.garbage += 1
            return False
        if not self._is_firmware(sender):
            self.counts.strangers += 1
            return False
        if self._count < 0 and servos.count > LATE:
            self._refuse(servos.count, sender)
            return False
        if 0 < self._count - servos.count <= LATE and servos.count > 0:
            self.counts.late += 1
            return False
        moved = self._step(servos.count, servos.pwm, 1.0 / servos.rate)
        self._reply(sender)
        return moved

    def _refuse(self, count: int, sender: tuple[str, int]) -> None:
        """A new firmware counts from 0 until it is answered (ArduPilot, SIM_JSON.cpp): this one flew before."""
        if not self.counts.under_way:
            self._say(
                f"ardusub-json: the firmware at {sender[0]}:{sender[1]} is at its frame {count}, expected 0: it flies "
                "a vehicle that this process does not know. It gets no answer: start it anew, too"
            )
        self.counts.under_way += 1

    def _is_firmware(self, sender: tuple[str, int]) -> bool:
        now = time.monotonic()
        if sender != self._sender:
            if self._sender is not None and now - self._received_at < CHANGE:
                return False
            self._begin_anew()
            self._sender = sender
        self._received_at = now
        return True

    def _begin_anew(self) -> None:
        if self._count >= 0:
            self.counts.resets += 1
            self._count = -1
            self._reset()

    def _step(self, count: int, pwm: tuple[int, ...], dt: float) -> bool:
        if count == self._count:  # our answer got lost: the physics have been there
            self.counts.repeats += 1
            return False
        if count < self._count:
            self._begin_anew()
        elif self._count >= 0:
            self.counts.lost += count - self._count - 1
        self._answer = encode_state(self._advance(pwm, dt))
        self._count = count
        self.counts.steps += 1
        return True

    def _reply(self, sender: tuple[str, int]) -> None:
        try:
            self._socket.sendto(self._answer, sender)
        except OSError:  # it left while we computed
            pass
