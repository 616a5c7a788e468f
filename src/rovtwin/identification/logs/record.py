"""Record: what one test leaves, whatever it was logged with. Plain NumPy, SI, NED and FRD."""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError

# What identification understands: components, unit, frame.
SIGNALS: dict[str, tuple[tuple[str, ...], str, str]] = {
    "position": (("north", "east", "down"), "m", "n"),
    "horizontal": (("north", "east"), "m", "n"),
    "depth": (("depth",), "m", "n"),
    "attitude": (("phi", "theta", "psi"), "rad", "n"),
    "gyro": (("p", "q", "r"), "rad/s", "b"),
    "velocity": (("u", "v", "w"), "m/s", "b"),
    "accelerometer": (("x", "y", "z"), "m/s2", "b"),
}


@dataclass(frozen=True, eq=False)
class Signal:
    """Readings of one sensor.

    Attributes:
        t: Times [s], increasing.
        value: Components, unit and frame as in SIGNALS; no NaN: what is missing is left out.
        sigma: Declared standard deviation of the noise per component, or None where nobody said.
        lever: Where the sensor sits, from CO, b [m].
    """

    t: Float[np.ndarray, " n"]
    value: Float[np.ndarray, "n k"]
    sigma: Float[np.ndarray, " k"] | None = None
    lever: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    def cut(self, start: float, end: float) -> "Signal":
        """Readings with start <= t <= end."""
        keep = (self.t >= start) & (self.t <= end)
        return replace(self, t=self.t[keep], value=self.value[keep])


@dataclass(frozen=True)
class Ballast:
    """A known piece added to the vehicle for one test: mass [kg], its volume [m3], its place from CO, b [m]."""

    mass: float
    volume: float
    position: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Record:
    """One test: commands held until the next one, and what was measured.

    Attributes:
        name: For people.
        t_command: When each command was given [s], increasing.
        command: Normalised thruster commands u, in the order of the vehicle's thrusters.
        signals: By a name of SIGNALS.
        end: When the last command stops holding [s]; nothing later is used.
        water_density: [kg/m3], or None where nobody said.
        tether_length: Paid out during the test [m], or None where nobody said.
        ballast: Known pieces added for this test.
        scale_std: How well the scale of its positions is known, one standard deviation as a share; common to all.
        command_interval: Where commands were read now and then, not whenever they changed: how often [s]; else None.
        current: Water velocity over ground, n [m/s], if the water moved steadily.
        source: File it came from, for messages.
        notes: What was left out or put right while reading, one line each.
    """

    name: str
    t_command: Float[np.ndarray, " m"]
    command: Float[np.ndarray, "m thrusters"]
    signals: dict[str, Signal]
    end: float
    water_density: float | None = None
    tether_length: float | None = None
    ballast: tuple[Ballast, ...] = ()
    scale_std: float = 0.0
    command_interval: float | None = None
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    source: str = "record"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if len(self.t_command) == 0 or self.command.shape[0] != len(self.t_command):
            raise IdentificationError(
                f"{self.source}: found no commands; an experiment needs what the thrusters were sent"
            )
        if not self.signals:
            raise IdentificationError(f"{self.source}: found no measurements, expected one of {', '.join(SIGNALS)}")
        for name, signal in self.signals.items():
            expected = (len(signal.t), len(SIGNALS[name][0]))
            if signal.value.shape != expected:
                raise IdentificationError(f"{self.source}: {name} has shape {signal.value.shape}, expected {expected}")

    @property
    def start(self) -> float:
        """Of the commands [s]."""
        return float(self.t_command[0])

    @property
    def duration(self) -> float:
        """[s]"""
        return self.end - self.start

    def command_at(self, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m thrusters"]:
        """The command that holds at times t, shape (len(t), n_thrusters)."""
        row = np.searchsorted(self.t_command, t + 1e-9, side="right") - 1
        return self.command[np.clip(row, 0, len(self.t_command) - 1)]

    def without(self, name: str) -> "Record":
        """The same test without a signal; one that has no other keeps it."""
        kept = {key: signal for key, signal in self.signals.items() if key != name}
        return replace(self, signals=kept or self.signals)

    def cut(self, start: float, end: float) -> "Record":
        """The part of the test between two times; the command that holds at its start is kept."""
        if not self.start <= start < end <= self.end + 1e-9:
            raise IdentificationError(
                f"{self.source}: asked for {start:g} to {end:g} s of a test from {self.start:g} to {self.end:g} s"
            )
        inside = (self.t_command > start) & (self.t_command < end)
        t = np.concatenate([[start], self.t_command[inside]])
        signals = {name: signal.cut(start, end) for name, signal in self.signals.items()}
        kept = {name: signal for name, signal in signals.items() if len(signal.t)}
        return replace(self, t_command=t, command=self.command_at(t), signals=kept, end=end)
