"""The ticks of one vehicle: hear, decide, command, in step with its time; and what there is to tell of them."""

from typing import Any

import numpy as np

from rovtwin.console.engine.reporting.state import Consistency, SensorStatus, flown
from rovtwin.console.engine.vehicle_session import VehicleSession
from rovtwin.runs.pace import SLIP, Clock, Pace


class Ticker:
    """Ticks from the moment a vehicle is connected until it is let go of.

    Attributes:
        session: Whose.
        began: When the first tick is due, by the vehicle's clock [s].
        ticks: That have been.
    """

    def __init__(self, session: VehicleSession, clock: Clock, dt: float):
        """`dt` is the control period [s]. What came before is forgotten; thrusters are off."""
        self.session, self._clock, self._dt = session, clock, dt
        session.mux.drain()
        session.helm.restart(session.readiness.start)
        self.ticks, self.began = 0, clock.next(dt)
        session.mux.zero = self.began
        names = session.simulation.sensor_names
        self._sensor_status, self._consistency, self._pace = SensorStatus(names), Consistency(names), Pace()
        self._late = self._latest = 0.0

    @property
    def t(self) -> float:
        """Of the next tick [s]."""
        return self.ticks * self._dt

    @property
    def late(self) -> float:
        """Lateness of the last tick [real s]."""
        return self._late

    def rests(self) -> float:
        """Until the next tick is due [s]."""
        return (self.began + self.t - self._clock()) / self._clock.speed

    def listen(self) -> None:
        """Hear the vehicle, also while its time stands still.

        Raises:
            LinkError: It is lost.
        """
        self._sensor_status.receive(self.session.mux.read())

    def tick(self, operator_age: float, pilot_command: tuple[float, ...], armed: bool) -> bool:
        """One tick of what was received; False where the world has not come so far.

        Args:
            operator_age: Since the operator gave a sign of life [s].
            pilot_command: The pilot's, see `HostAutopilot.step`.
            armed: Whether the command goes to the vehicle.

        Raises:
            LinkError: The vehicle is lost.
        """
        session, clock, t = self.session, self._clock, self.t
        fast = clock.speed > 1.0
        if fast and self._sensor_status.reported_until < t - 0.5 * self._dt:
            # In step with the world: neither outruns the other.
            session.link.tell(("reached", self.began + t - self._dt))
            return False
        readings = self._sensor_status.news(t, t + 0.5 * self._dt if fast else np.inf)
        late = self._pace.wait(self.began + t, clock, clock.speed)
        if fast and late > SLIP:  # as fast as the computer can, then
            session.link.tell(("pace", *clock.slip(late * clock.speed)))
        # Ages by our own time; faster than real time nothing is too late.
        ages = session.link.age, operator_age, 0.0 if fast else late / self._dt
        command = session.helm.tick(readings, ages, pilot_command)
        if armed:
            session.link.send(command)
        if fast:
            session.link.tell(("reached", self.began + t))
        self._consistency.take(t, session.helm.output)
        self._late, self._latest = late, max(self._latest, late)
        self.ticks += 1
        return True

    def report(self, waypoints: int) -> dict[str, Any]:
        """Of the last tick, for a mission of so many way-points; `late_ms` is the largest since this was last asked."""
        session, t = self.session, self.t - self._dt
        state = flown(session.helm.output, waypoints) | self._sensor_status.report(t)
        state |= {
            "t": t,
            "nis": self._consistency.report(t),
            "link_age": session.link.age,
            "late_ms": 1e3 * self._latest,
        }
        self._latest = 0.0
        return state
