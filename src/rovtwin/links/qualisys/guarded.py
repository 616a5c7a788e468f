"""The vendor's client behind a guard: packets are checked before it sees them.

qtm-rt 3.1 keeps whatever a packet's header announces, up to 4 GiB, loops for ever on a packet of size 0, and lets
exceptions out of what it parses.
"""

from collections.abc import Callable
from typing import Any

from rovtwin.core.errors import LinkError
from rovtwin.links.qualisys.wire import split_packets


def guarded_protocol(on_disconnect: Callable[[Any], None]) -> Any:
    """A `qtm_rt.protocol.QTMProtocol` for `create_connection`, made within its loop.

    It hands on whole packets of sensible size; the first that is not ends the connection, and its attribute `failure`
    says why (a LinkError, else None). The class is made here because its base may not be installed.
    """
    from qtm_rt.protocol import QTMProtocol

    class Guarded(QTMProtocol):
        failure: LinkError | None = None
        waiting = b""

        def data_received(self, data: bytes) -> None:
            if self.failure is not None:
                return
            try:
                packets, self.waiting = split_packets(self.waiting + data)
                for packet in packets:
                    super().data_received(packet)
            except LinkError as error:
                self.fail(error)
            except Exception as error:  # of the vendor's parser: whatever it stumbles over is not QTM
                self.fail(LinkError(f"packet that cannot be read: {type(error).__name__}: {error}"))

        def fail(self, error: LinkError) -> None:
            self.failure = error
            self.drop()

        def drop(self) -> None:
            transport: Any = self.transport
            if transport is not None:
                transport.abort()

    return Guarded(on_disconnect=on_disconnect)
