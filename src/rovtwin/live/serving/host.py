"""A served vehicle stepped from Python: commands in, readings out, one vector each way."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from rovtwin.core.arrays.flat import Layout
from rovtwin.core.arrays.rotations import pose
from rovtwin.core.flow import Measurement
from rovtwin.core.numerics import jax
from rovtwin.links.servers.pilot_command import PilotCommand
from rovtwin.live.serving.served import ServedOutput, advance_of, orders, output_of
from rovtwin.live.serving.vehicle import served_of
from rovtwin.runs.recording.provenance import own_code
from rovtwin.scenario.schema import Scenario

MOCAP_STD = (1e-3, 1e-3, 1e-3, 2e-3, 2e-3, 2e-3)  # of motion capture [m, rad]: about 1 mm and 0.1 deg in a tank


class ServedVehicle:
    """A twin that obeys commands, one control period after the other.

    Attributes:
        drones: Names of what has electronics of its own; `("",)` for a vehicle that is one.
        thrusters: Names, in the order of `thrusters` readings.
        dt: Control period [s].
        tick: Control periods so far.
        largest: Wrench along each axis that a drone can give [N, N m], by drone, shape (6,).
        own_code: Which code of one's own the twin runs, see `provenance.own_code`.
    """

    def __init__(self, scenario: Scenario):
        """Composes and compiles, so that the first period takes as long as the others.

        Raises:
            ConfigError: The scenario cannot be composed.
        """
        served, simulation = served_of(scenario)
        self.dt, self.tick = scenario.control_dt, 0
        self.own_code = own_code(scenario)
        self.drones, self.thrusters = served.drones, simulation.thruster_names
        self.largest = {name: np.asarray(onboard.largest) for name, onboard in served.onboards.items()}
        self._rng = np.random.default_rng(scenario.seed)
        memory, none = served.init(simulation.key, simulation.start), orders(served)
        output = output_of(served, memory, none, self.dt)
        nothing = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), output)
        blocks, takes, gives = Layout(served), Layout(none), Layout((output, memory))
        self._orders, self._gives = takes.places(), gives
        self._shown: ServedOutput = gives.places()[0]
        self._advance = advance_of(blocks, takes, gives, self.dt)
        self._parameters, self._after = blocks.flatten(served), gives.flatten((nothing, memory))
        self._idle = np.zeros(takes.size)
        self._size = gives.size
        self._advance(self._parameters, self._after, self._idle, np.asarray(0)).block_until_ready()

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self.tick * self.dt

    def advance(self, commands: Mapping[str, PilotCommand]) -> list[Measurement]:
        """One control period; drones without a command have their thrusters off. What was measured within it."""
        taken = self._idle.copy()
        for drone, command in commands.items():
            if drone in self._orders:
                self._write(taken, drone, command)
        given = self._advance(self._parameters, self._after, taken, np.asarray(self.tick))
        self._after = given[: self._size]
        self.given = np.asarray(given)
        self.tick += 1
        return self._readings(self.given)

    def _write(self, taken: Float[np.ndarray, " _"], drone: str, command: PilotCommand) -> None:
        order = self._orders[drone]
        taken[order.armed] = command.armed
        taken[order.motion] = command.motion
        taken[order.holds] = command.hold_depth, command.hold_heading, command.hold_level, command.hold_position
        if command.target is not None:
            taken[order.target], taken[order.aimed] = command.target, 1.0

    def _readings(self, given: Float[np.ndarray, " _"]) -> list[Measurement]:
        shown = self._shown
        readings = []
        for name, slot in shown.measurements.items():
            valid, times = given[slot.valid], given[slot.t_valid]
            values = given[slot.value].reshape(len(valid), -1)
            readings += [Measurement(name, values[i], float(times[i])) for i in np.flatnonzero(valid)]
        for drone, place in shown.tau.items():
            readings.append(Measurement(f"{drone}/force" if drone else "force", given[place], self.now))
        readings.append(Measurement("thrusters", given[shown.command.u], self.now))
        eta = pose(given[shown.estimate.position], given[shown.estimate.attitude])
        estimate = np.concatenate([eta, given[shown.estimate.nu]])
        readings.append(Measurement("estimate", estimate, self.now - self.dt))
        seen = given[self._size :] + self._rng.normal(0.0, MOCAP_STD)
        readings.append(Measurement("mocap", seen, self.now))
        return readings

    @property
    def truth(self) -> dict[str, Float[np.ndarray, " _"]]:
        """True eta, nu, shapes (6,), force [N] and command of each thruster, shapes (n,), after the last period."""
        state = self._shown.state
        return {
            "eta": self.given[self._size :],
            "nu": self.given[state.nu],
            "thrust": self.given[state.thrust],
            "command": self.given[self._shown.command.u],
        }
