"""ArduSub's own simulation: the firmware runs beside us, keeps the time and asks for physics."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rovtwin.links.endpoint import Endpoint, Firmware, Where

if TYPE_CHECKING:
    from rovtwin.links.ardusub_json.lockstep import Lockstep


def _lockstep(
    advance: Callable[..., Any], reset: Callable[[], None], where: Where, say: Callable[[str], None]
) -> "Lockstep":
    from rovtwin.links.ardusub_json.lockstep import PORT, Lockstep

    return Lockstep(advance, reset, where.hosts[0] if where.hosts else "127.0.0.1", where.port or PORT, say)


def _firmware() -> Firmware:
    from rovtwin.links.ardusub_json.motors import BLUEROV2_HEAVY
    from rovtwin.links.ardusub_json.wire import State

    return Firmware(
        commands=BLUEROV2_HEAVY.commands,
        thrusters=BLUEROV2_HEAVY.names,
        vehicle="bluerov2_heavy",
        pace="give its --speedup",
        state=State,
        lockstep=_lockstep,
    )


ARDUSUB_JSON = Endpoint(
    scheme="ardusub-json",
    address="(none: ArduSub connects by itself)",
    about="external physics for ArduSub's simulation, which keeps the time",
    firmware=_firmware,
)
