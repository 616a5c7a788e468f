"""Two Blueye drones side by side as one vehicle of six thrusters."""

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command, Measurement
from rovtwin.core.link import Link
from rovtwin.links.blueye.driver.merge import Merge
from rovtwin.links.blueye.driver.thrust import Curve, linear
from rovtwin.links.blueye.link import AXES, BlueyeLink

NAMES = ("port", "starboard")
LEVERS = ((0.0, -0.28, 0.0), (0.0, 0.28, 0.0))  # thesis (5.2), vehicle/library/double_blueye.yaml
QUIET = 0.1  # silence after which the other drone's readings no longer wait [s]
LOST = 0.35  # silence of one drone after which neither is commanded [s]; with a period of repetition below 0.5 s


class DoubleBlueyeLink(Link):
    """Commands split, readings merged (`merge`), and neither drone thrusts when the other is silent.

    Thrusters are those of double_blueye: port surge, sway, heave, starboard surge, sway, heave. When one drone has been
    silent for 0.35 s, both get zero motion within another 0.05 s, for as long as that lasts: a vehicle with one half of
    its thrusters turns. `age` tells how long the one that has been silent longer is; after 3 s `read` raises as
    BlueyeLink does. The lost drone's own watchdog stops it within 2 s.

    Args:
        ips: Addresses of the port and the starboard drone.
        curves: Of each drone, see `thrust.force_shares`.
        levers: Places of their sensors seen from CO, b [m], shape (2, 3).
        clock, timer, others: As for BlueyeLink, but for `position`: each drone reckons from a zero of its own and
            drifts by itself, so that there is nothing to merge.

    Raises:
        ConfigError: There are not two different addresses.
        LinkError: As for BlueyeLink, of the first that cannot be reached; the other is let go.
    """

    def __init__(
        self,
        ips: Sequence[str],
        *,
        curves: Sequence[Curve] = (linear, linear),
        levers: Sequence[Sequence[float]] = LEVERS,
        clock: Callable[[], float] = time.monotonic,
        timer: Callable[[], float] = time.monotonic,
        **others: Any,
    ):
        if len(ips) != 2 or ips[0] == ips[1]:
            raise ConfigError(
                f"blueye://{','.join(ips)}: expected two different addresses, port and starboard. Two drones as "
                "delivered share one: docs/links_blueye.md tells how to reach both"
            )
        self._clock = clock
        self._merge = Merge(np.array(levers))
        self._links = _connect_both(
            lambda i: BlueyeLink(
                ips[i], drone=NAMES[i], curve=curves[i], clock=clock, timer=timer, position=False, **others
            )
        )
        for link in self._links:
            link.permit = lambda: self.age <= LOST
        self._stopped = self._closed = False

    def arm(self) -> None:
        """Arm both at once; if one refuses, both links stop.

        Raises:
            LinkError: As for BlueyeLink, of the first that refuses.
        """
        with ThreadPoolExecutor(2) as pool:
            errors = [task.exception() for task in [pool.submit(link.arm) for link in self._links]]
        for error in errors:
            if error is not None:
                self.stop()
                raise error

    @property
    def age(self) -> float:
        """Time since the drone that has been silent longer sent anything [s]; infinite when it is lost or closed."""
        return max(self.ages)

    @property
    def ages(self) -> tuple[float, float]:
        """The same of port and starboard."""
        return self._links[0].age, self._links[1].age

    def read(self) -> list[Measurement]:
        """Merged readings since the last call.

        Raises:
            LinkTimeout: One of the drones has been silent for 3 s.
            LinkError: Another client has taken control of one since they were armed.
        """
        if self._closed:
            return []
        streams = [link.read() for link in self._links]
        return self._merge.join(streams, self._clock(), [age > QUIET for age in self.ages])

    def send(self, command: Command) -> None:
        u = np.array(command.u, dtype=float)
        if u.shape != (2 * AXES,):
            self.stop()
            raise ValueError(f"command of shape {u.shape}, expected (6,): surge, sway, heave of port, then starboard")
        if not np.isfinite(u).all():
            self.stop()  # both: half a command is none
        if not self._stopped:
            for link, part in zip(self._links, (u[:AXES], u[AXES:]), strict=True):
                link.send(Command(part))  # type: ignore[arg-type]  (NumPy: on its way out)

    def stop(self) -> None:
        self._stopped = True
        for link in self._links:
            link.stop()

    def close(self) -> None:
        self.stop()
        self._closed = True
        for link in self._links:
            link.close()


def _connect_both(one: Callable[[int], BlueyeLink]) -> tuple[BlueyeLink, BlueyeLink]:
    """Both at once; if one cannot be reached the other is let go."""
    with ThreadPoolExecutor(2) as pool:
        tasks = [pool.submit(one, i) for i in range(2)]
    errors = [task.exception() for task in tasks]
    for task, error in zip(tasks, errors, strict=True):
        if error is None and any(errors):
            task.result().close()
    for error in errors:
        if error is not None:
            raise error
    return tasks[0].result(), tasks[1].result()
