"""Connecting to a Blueye through its SDK, within a time limit: a lost reply would hold the SDK for ever."""

import threading
from collections.abc import Callable, Mapping
from typing import Any

from rovtwin.core.errors import LinkError, LinkTimeout
from rovtwin.core.extras import imported

TRIES = 5  # of a request that the SDK gives 50 ms, unless set otherwise


def connect(
    ip: str, timeout: float, take_control: bool, observer: bool, dropped: Callable[[], None] = lambda: None
) -> Any:
    """A connected `blueye.sdk.Drone`.

    Args:
        ip: The drone's address.
        timeout: Time that all of it may take [s].
        take_control: Send other clients away if one of them is in control.
        observer: Only look.
        dropped: Called for every message of telemetry that the SDK cannot take, in its thread.

    Raises:
        LinkTimeout: There was no answer in time.
        LinkError: The SDK is missing, there is no Blueye of protocol v3 at this address, or another client controls it.
    """
    drone = imported("blueye.sdk", "blueye", f"blueye://{ip}", LinkError).Drone(ip, auto_connect=False)
    failed: list[Exception] = []
    given_up = threading.Event()

    def work() -> None:
        try:
            drone.connect(timeout=timeout / 2, disconnect_other_clients=take_control, connect_as_observer=observer)
        except Exception as error:  # whatever an SDK and what answers it may raise
            failed.append(error)
        if given_up.is_set():
            release(drone)  # too late: nobody must be in control whom nobody knows

    thread = threading.Thread(target=work, daemon=True, name=f"connect to {ip}")
    thread.start()
    thread.join(timeout)
    if thread.is_alive():
        given_up.set()
        raise LinkTimeout(
            f"blueye://{ip}: no answer within {timeout:g} s, expected a Blueye drone of software 3.2 or later. "
            "Is it on, and its surface unit connected?"
        )
    _guard(drone, dropped)
    if failed:
        release(drone)
        raise LinkError(f"blueye://{ip}: {_words_of(failed[0])}")
    if not observer and not drone.in_control:
        release(drone)
        raise LinkError(
            f"blueye://{ip}: another client is in control. Close the app or script that is, or take control "
            f"(blueye://{ip}?take_control)"
        )
    return drone


def _guard(drone: Any, dropped: Callable[[], None]) -> None:
    """Let the SDK's thread of telemetry live through messages that it cannot take: else the first would end it."""
    watcher = drone._telemetry_watcher
    if not isinstance(watcher, threading.Thread):
        return  # not connected
    take: Callable[[Any], None] = watcher._handle_message  # type: ignore[attr-defined]  (the SDK has no hook)

    def guarded(message: Any) -> None:
        try:
            take(message)
        except Exception:  # a name that is no text, a frame too few: whatever the SDK stumbles over
            dropped()

    watcher._handle_message = guarded  # type: ignore[attr-defined]  (as above)


def _words_of(error: Exception) -> str:
    cause = error.__cause__ or error
    silent = type(cause).__module__.startswith("requests")  # whose texts are long and say little
    found = "nobody answers over HTTP" if silent else f"{type(cause).__name__}: {str(cause)[:200]}"
    return (
        f"cannot be connected ({found}), expected a Blueye drone of software 3.2 or later. Is it on, and the address "
        "right? A served twin whose HTTP port is not 80 says what http_proxy has to be set to"
    )


def release(drone: Any) -> None:
    """Disconnect; what a dead connection says about it does not matter."""
    try:
        drone.disconnect()
    except Exception:  # not connected, no reply, half a connection: all the same now
        pass


def set_rates(drone: Any, rates: Mapping[str, float], tries: int = TRIES) -> list[str]:
    """Ask for telemetry at these rates [Hz] by the message's name; the names that the drone would not set."""
    refused = []
    for name, rate in rates.items():
        for left in reversed(range(tries)):
            try:
                drone.telemetry.set_msg_publish_frequency(name, rate)
                break
            except Exception as error:  # RuntimeError: refused; ResponseTimeout: 50 ms were too short
                if left == 0 or isinstance(error, RuntimeError):
                    refused.append(name)
                    break
    return refused
