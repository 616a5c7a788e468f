"""The bridge: what each order does, and why it is refused."""

import logging
import time
from dataclasses import asdict
from typing import Any

import numpy as np
import zmq

from rovtwin.console import orders
from rovtwin.console.clock import lasting
from rovtwin.console.engine.engine import Engine
from rovtwin.console.engine.experiment_helm import ExperimentHelm
from rovtwin.console.engine.helm import Helm
from rovtwin.console.engine.reporting.checks import Check, faults, kept, require_none
from rovtwin.console.engine.reporting.state import counted
from rovtwin.console.engine.vehicle_session import VehicleSession
from rovtwin.console.wire import FRESH, decode, encode
from rovtwin.core.errors import ConfigError, RovtwinError
from rovtwin.core.flow import Mission
from rovtwin.runs.compose.fitting import own_values
from rovtwin.runs.feasibility import point_numbers
from rovtwin.runs.limits import Limits
from rovtwin.scenario.schema import Scenario, Waypoint

logger = logging.getLogger(__name__)

TURN = 4e-3  # for orders, before it is looked whether a tick is due; one is taken at least [s]
ANY_AGE = ("stop", "disarm", "abort", "quit")  # orders that are right however long they waited


class Bridge:
    """Takes orders for an engine and answers them."""

    def __init__(self, engine: Engine, address: str):
        self._engine = engine
        self._socket = zmq.Context.instance().socket(zmq.ROUTER)
        self._socket.bind(address)
        self._sent = 0.0

    def wait(self, seconds: float) -> None:
        """Until an order comes, that long at most."""
        if seconds > 1e-3:
            self._socket.poll(int(1e3 * seconds))
        elif seconds > 0:
            time.sleep(seconds)

    def obey(self) -> None:
        """Orders that have come; those that there is no time for now wait for the next turn, as ticks may not."""
        until = time.monotonic() + TURN
        while self._socket.poll(0) and not self._engine.over:
            who, *_, text = self._socket.recv_multipart()
            answer = self.answer(text)
            if answer is not None:
                self._socket.send_multipart([who, encode(answer)])
            if time.monotonic() > until:
                break

    def close(self) -> None:
        self._socket.close()

    def answer(self, text: bytes) -> dict[str, Any] | None:
        """Do what one says; what to reply, nothing where nobody asked for it."""
        number = None
        try:
            message = decode(text)
            number = message.get("id")
            order = orders.parse(message)
        except ValueError as error:
            return {"id": number, "ok": False, "error": f"not understood: {error}"}
        now = time.monotonic()
        try:
            sent = float(message.get("sent", "nan"))
        except (TypeError, ValueError, OverflowError):
            sent = float("nan")
        self._sent = min(sent, now)
        if not abs(now - sent) <= FRESH and order.do not in ANY_AGE:
            return {"id": number, "ok": False, "error": "too old: the autopilot was busy. Ask again"}
        try:
            found = getattr(self, f"_{order.do}")(order) or {}
        except RovtwinError as error:
            return {"id": number, "ok": False, "error": str(error)}
        except Exception as error:  # a mistake of ours: the vehicle is flown on, and whoever asked is informed
            logger.exception("order %s", order.do)
            return {"id": number, "ok": False, "error": f"{order.do}: failed ({type(error).__name__}: {error})"}
        return None if number is None else {"id": number, "ok": True} | found

    def _for_missions(self, session: VehicleSession) -> Helm:
        """The helm; ConfigError where a test is flown."""
        if isinstance(session.helm, Helm):
            return session.helm
        raise ConfigError(
            "a test is flown here, which knows Start and Abort. For way-points and piloting start the console with a "
            "scenario that has a mission"
        )

    def _underway(self) -> VehicleSession:
        session = self._engine.session
        if not self._engine.switch.armed:
            raise ConfigError("not armed: press Arm first")
        return session

    def _alive(self, order: Any) -> None:
        self._engine.note_operator()

    def _stop(self, order: Any) -> None:
        self._engine.stop()

    def _quit(self, order: Any) -> None:
        self._engine.over = True

    def _lend(self, order: Any) -> None:
        self._engine.lend()

    def _reconnect(self, order: Any) -> None:
        if self._engine.switch.armed:
            raise ConfigError("armed: disarm before you connect anew")
        self._engine.reconnect()

    def _arm(self, order: Any) -> None:
        if self._engine.switch.armed or self._engine.switch.arming:
            raise ConfigError("armed already")
        if not self._engine.may_arm:
            # A real vehicle's link that was stopped stays so: a new one is opened, and the operator asks once more.
            self._engine.reconnect()
            raise ConfigError(
                "the link was stopped: connecting anew. Press Arm again once the sensors deliver readings"
            )
        self._engine.arm(self._sent)

    def _disarm(self, order: Any) -> None:
        self._engine.disarm()

    def _start(self, order: Any) -> None:
        session = self._underway()
        if isinstance(session.helm, ExperimentHelm):
            self._start_test(session.helm)
            return
        if not self._engine.submitted:
            raise ConfigError("no plan was submitted: submit one first")
        if session.helm.is_running:
            raise ConfigError("a mission is under way already: hold or abort it first")
        self._engine.fly(session.helm, self._checked(self._engine.plan), self._engine.plan)
        self._engine.event("info", f"mission started: {counted(len(self._engine.plan))}")

    def _start_test(self, helm: ExperimentHelm) -> None:
        test = self._engine.test
        assert test is not None
        if test.running:
            raise ConfigError("the test is under way already: abort it first")
        self._engine.fly_test(helm, test)
        self._engine.event("info", f"test started: {test.count} manoeuvres, {lasting(test.duration)}")

    def _goto(self, order: orders.Goto) -> None:
        helm = self._for_missions(self._underway())
        depth = max(float(helm.output.estimate.position[2]), 0.0) if order.depth is None else order.depth
        own = own_values(Limits.of(self._engine.session.simulation.model))
        speed = own["speed"] if order.speed is None else order.speed
        there = Waypoint(position=[order.x, order.y, depth], speed=speed, acceptance=own["acceptance"])
        self._engine.fly(helm, self._checked([there], "the place"), [there])
        self._engine.event("info", f"going to north {order.x:.1f} m, east {order.y:.1f} m, depth {depth:.1f} m")

    def _pause(self, order: Any) -> None:
        self._for_missions(self._underway()).pause()
        self._engine.event("info", "paused")

    def _resume(self, order: Any) -> None:
        helm = self._for_missions(self._underway())
        if not helm.can_resume:
            raise ConfigError("nothing to resume: no mission is paused; Start flies the submitted one")
        helm.resume()
        self._engine.event("info", "resumed")

    def _abort(self, order: Any) -> None:
        self._underway().helm.abort()
        self._engine.event("warning", "aborted: thrusters off")

    def _hold(self, order: Any) -> None:
        helm = self._underway().helm
        if isinstance(helm, ExperimentHelm):
            helm.abort()
            self._engine.event("warning", "test ended: thrusters off")
            return
        helm.hold()
        self._engine.event("info", "holding station")

    def _pilot(self, order: orders.Pilot) -> None:
        helm = self._for_missions(self._underway())
        if not helm.is_piloted:
            if not order.begin:  # a stick that goes on after Abort, Hold or Start
                return
            helm.pilot()
            self._engine.event("info", "piloted by hand")
        sticks = np.array([order.surge, order.sway, order.heave, order.yaw])
        self._engine.steer(sticks * helm.fastest)

    def _fence(self, order: orders.Fence) -> None:
        self._engine.set_fence(self._for_missions(self._engine.session), order.corners)

    def _submit(self, order: orders.Submit) -> None:
        if self._for_missions(self._engine.session).is_running:
            raise ConfigError("a mission is under way: hold or abort it before you submit another")
        self._checked(order.waypoints)
        self._engine.submit(order.waypoints)

    def _check(self, order: orders.Submit) -> dict[str, Any]:
        """What there is to say of way-points before they are submitted."""
        found = self._faults(order.waypoints)
        if not found:
            found.append(kept(self._engine.scenario_with(order.waypoints)))
            limits = self._engine.session.limits
            if fast := [i for i, w in enumerate(order.waypoints) if w.speed > limits.speed]:
                what = f"{point_numbers.counted(fast)}: faster than thrusters keep up, {limits.text}"
                found.append(Check("warning", what, fast))
        return {"checks": [asdict(one) for one in found]}

    def _faults(self, waypoints: list[Waypoint]) -> list[Check]:
        """What keeps way-points from being flown here; of a real vehicle the current is not known."""
        session = self._engine.session
        helm, scenario = self._for_missions(session), self._engine.scenario_with(waypoints)
        twin, simulation = self._engine.is_twin, session.simulation
        model = simulation.loop.twin.model if twin else simulation.model
        here = self._from_here(scenario, helm)
        return faults(scenario, here, model, has_terrain=helm.has_terrain, known_world=twin)  # half a millisecond

    def _checked(self, waypoints: list[Waypoint], name: str = "way-point") -> Mission:
        """The mission, if it can be flown here; `name` is what a refusal calls a way-point.

        Raises:
            ConfigError: It leads out of the tank or the fence, too deep, needs an altimeter that there is not, or
                cannot be flown by this vehicle; every fault is named.
        """
        require_none(self._faults(waypoints), name)
        return self._for_missions(self._engine.session).mission_of(self._engine.scenario_with(waypoints))

    def _from_here(self, scenario: Scenario, helm: Helm) -> Scenario:
        """The scenario, begun where the vehicle is; before it is armed, where the scenario says."""
        if not self._engine.switch.armed:
            return scenario
        place = np.asarray(helm.output.estimate.position, dtype=float)
        start = scenario.start.model_copy(update={"position": place.tolist()})
        return scenario.model_copy(update={"start": start})

    def _pace(self, order: orders.Pace) -> None:
        if not self._engine.is_twin:
            raise ConfigError("a real vehicle's time cannot be paused or run faster")
        self._engine.run_at(order.speed, order.running)

    def _inject(self, order: orders.Inject) -> None:
        if not self._engine.is_twin:
            raise ConfigError("nothing can be broken in a real vehicle from here")
        session = self._engine.session
        fault, text = _fault(order, session.simulation.thruster_names, session.simulation.sensor_names)
        session.link.tell(fault)
        if order.fault == "current":
            self._engine.added_current = fault[1], fault[2]
        self._engine.event("warning", f"injected: {text}")


def _fault(order: orders.Inject, thrusters: list[str], sensors: list[str]) -> tuple[tuple[Any, ...], str]:
    """A fault as the twin gets it, and for people."""
    if order.fault == "thruster":
        if order.thruster is None or order.thruster >= len(thrusters):
            raise ConfigError(f"inject.thruster: found {order.thruster}, expected 0 to {len(thrusters) - 1}")
        text = f"{thrusters[order.thruster]} gives {100 * order.share:.0f} % of its force"
        return ("thruster", order.thruster, order.share), text
    if order.fault == "sensor":
        if order.sensor not in sensors:
            raise ConfigError(f"inject.sensor: found {order.sensor!r}, expected one of {', '.join(sensors)}")
        return ("sensor", order.sensor, order.works), f"{order.sensor} {'works' if order.works else 'is silent'}"
    north, east = order.current or (0.0, 0.0)
    return ("current", north, east), f"a current of {np.hypot(north, east):.2f} m/s more"
