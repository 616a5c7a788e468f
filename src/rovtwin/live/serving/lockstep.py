"""External physics for a firmware that runs beside us, such as ArduSub's: one step of the plant for each of its frames.

The firmware makes its sensors' errors itself, so it gets the truth; it also keeps the time, as fast as both can.
"""

import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.flow import Command
from rovtwin.core.frames import euler_from_quaternion, rotation_from_quaternion
from rovtwin.core.numerics import Array, as_array, jax, jnp
from rovtwin.core.types import PerThruster
from rovtwin.links.endpoint import Endpoint, Firmware, Where
from rovtwin.live.serving.truth_log import truth_log
from rovtwin.live.serving.vehicle import require_no_own_autopilot
from rovtwin.runs.compose.composition import compose
from rovtwin.runs.interrupt import Interrupt
from rovtwin.runs.recording.provenance import own_code
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.physics import measurement
from rovtwin.vehicle.physics.dynamics import State, acceleration, inflow_of, plant_step

USUAL = 1.0 / 1200.0  # the firmware's step [s]
LOGGED = 0.02  # [s]
RATES = 4  # steps of different length that are compiled


class FirmwarePhysics:
    """The plant, stepped by a firmware's outputs.

    Attributes:
        dt: Between two rows of a log of the truth [s].
        time: Of the physics, since the firmware began [s].
        now: Of the log [s]: it goes on where a firmware is started anew.
        thrusters: Their names.
        own_code: Which code of one's own the twin runs.
        state: Of the plant.
    """

    dt = LOGGED

    def __init__(self, scenario: Scenario, firmware: Firmware, name: str):
        """Composes and compiles; `name` is the protocol's.

        Raises:
            ConfigError: The firmware's motors are not this vehicle's, or the autopilot has blocks of one's own.
        """
        require_no_own_autopilot(scenario)
        simulation = compose(scenario)
        self.own_code = own_code(scenario)
        self._firmware = firmware
        self.thrusters = list(simulation.vehicle.thruster_names)
        if missing := [thruster for thruster in self.thrusters if thruster not in firmware.thrusters]:
            raise ConfigError(
                f"--protocol {name}: {simulation.vehicle.name} has a thruster {missing[0]!r}, expected those of "
                f"{firmware.vehicle} ({', '.join(firmware.thrusters)}), which its frame drives"
            )
        twin = simulation.loop.twin
        self._begin = (twin.world.init(simulation.key, simulation.start), State.at(twin.model, simulation.start))

        def step(model: Any, world: Any, memory: Any, u: PerThruster, dt: float) -> tuple[Any, Float[Array, " _"]]:
            after, state = memory
            after, water = world.step(after, state, dt)
            state = plant_step(model, state, Command(u), water, dt)
            tau = model.thrusters.configuration @ state.thrust
            inflow = inflow_of(model, state.thrust)
            nu_dot = acceleration(model, state.position, state.attitude, state.nu, tau, water, dt, inflow)
            force = measurement.specific_force(state, nu_dot, jnp.zeros(3), jnp.eye(3))
            velocity = rotation_from_quaternion(state.attitude) @ state.nu[:3]
            sent = jnp.concatenate([state.nu[3:], force, state.position, velocity, state.attitude])
            return (after, state), sent

        # The step is a constant: a firmware keeps to its rate.
        self._step: Callable[..., Any] = jax.jit(step, static_argnums=4)
        self._parameters = (twin.model, twin.world)
        self._rates = [USUAL]
        self.now, self._command = 0.0, np.zeros(len(self.thrusters))
        self.reset()
        self._step(*self._parameters, self._memory, as_array(np.zeros(len(self.thrusters))), USUAL)

    @property
    def state(self) -> State:
        return self._memory[1]

    @property
    def truth(self) -> dict[str, Float[np.ndarray, " _"]]:
        """True eta, nu, shapes (6,), force [N] and command of each thruster, shapes (n,), after the last step."""
        state = self.state
        eta = np.concatenate([state.position, euler_from_quaternion(state.attitude)])
        return {"eta": eta, "nu": np.array(state.nu), "thrust": np.array(state.thrust), "command": self._command}

    def reset(self) -> None:
        """Back to the beginning."""
        self.time, self._memory = 0.0, self._begin

    def advance(self, pwm: tuple[int, ...], dt: float) -> Any:
        """The truth after one step under these outputs [us] of `dt` seconds."""
        if dt not in self._rates and len(self._rates) >= RATES:
            dt = self._rates[-1]  # each rate is compiled: a firmware has one, and a stranger shall not have a thousand
        elif dt not in self._rates:
            self._rates.append(dt)
        self._command = self._firmware.commands(pwm, self.thrusters)
        self._memory, sent = self._step(*self._parameters, self._memory, as_array(self._command), dt)
        self.time += dt
        self.now += dt
        gyro, force, position, velocity, quaternion = np.split(np.asarray(sent), [3, 6, 9, 12])
        return self._firmware.state(self.time, gyro, force, position, velocity, quaternion)


def serve_firmware(
    scenario: Scenario,
    endpoint: Endpoint,
    where: Where,
    duration: float,
    say: Callable[[str], None],
    progress: Callable[[float], None] = lambda t: None,
    log: Path | None = None,
) -> float:
    """Answer a firmware until Ctrl-C or for so many simulated seconds; the simulated time [s].

    `log` is a new MCAP file for the truth, 50 rows a simulated second.

    Raises:
        ConfigError: The firmware's motors are not this vehicle's.
        LinkError: The address cannot be bound.
    """
    assert endpoint.firmware is not None  # see `protocols.firmware_of`
    firmware, name = endpoint.firmware(), endpoint.scheme
    physics = FirmwarePhysics(scenario, firmware, name)
    lockstep = firmware.lockstep(physics.advance, physics.reset, where, say)
    say(f"{name}: waits at udp {lockstep.addresses[0]}:{lockstep.port} for the firmware")
    shown, began = 0.0, time.monotonic()
    try:
        with Interrupt() as interrupt, truth_log(log, physics) if log else nullcontext() as write:
            while not interrupt.asked and physics.time < duration:
                before = physics.now
                if lockstep.serve_one() and write and int(physics.now / LOGGED) > int(before / LOGGED):
                    write.take(physics)
                if not lockstep.counts.steps and time.monotonic() - began > duration:
                    break  # nobody came
                if physics.time - shown > 1.0:
                    shown = physics.time
                    progress(shown)
    finally:
        lockstep.close()
    counts = lockstep.counts
    say(
        f"{name}: {counts.steps} steps, {counts.repeats} asked twice, {counts.resets} resets, "
        f"{counts.garbage} no packets"
    )
    return physics.time
