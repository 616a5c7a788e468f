"""What may be tuned of the model-based autopilot: names, bounds, and the way to a section of a scenario and back."""

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import near, parse
from rovtwin.gnc.navigation.tuning import Tuning
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.vehicle_defaults import with_vehicle_defaults
from rovtwin.scenario.schema import AutopilotSection, ModelBasedSection, Scenario

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Tunable:
    """A positive number, searched by its logarithm.

    Attributes:
        name: Its place in the autopilot's section; an axis by its name.
        unit: Of the number.
        low, high: Bounds of the search; of a number with a unit, as shares of where the search begins.
        usual: Whether it is searched when nobody says what to search.
    """

    name: str
    unit: str
    low: float
    high: float
    usual: bool = True

    def around(self, value: float) -> "Tunable":
        """The same with bounds in its unit, around the value with which the search begins; it is always within."""
        scale = 1.0 if self.unit == "1" else value or 1.0
        return replace(self, low=min(self.low * scale, value or np.inf), high=max(self.high * scale, value))


TUNABLES = (
    Tunable("control.bandwidth.surge", "rad/s", 0.3, 4.0),
    Tunable("control.bandwidth.sway", "rad/s", 0.3, 4.0),
    Tunable("control.bandwidth.heave", "rad/s", 0.3, 4.0),
    Tunable("control.bandwidth.roll", "rad/s", 0.3, 4.0, usual=False),
    Tunable("control.bandwidth.yaw", "rad/s", 0.3, 4.0),
    Tunable("control.damping_ratio", "1", 0.5, 2.5),
    Tunable("control.integral", "1", 0.01, 0.5),
    Tunable("navigation.force_walk", "N/sqrt(s)", 0.1, 16.0),
    Tunable("navigation.drag_std", "1", 0.02, 0.6),
    Tunable("navigation.acceleration_share", "1", 0.01, 0.6),
    # What is known before the start: a flight of a minute would overdo what a mission of an hour forgets.
    Tunable("navigation.force_std", "N", 0.1, 10.0, usual=False),
    Tunable("navigation.current_std", "m/s", 0.1, 5.0, usual=False),
)
"""All that can be tuned. Roll is left out unless asked for: no term of the cost sees it."""


def chosen(names: Sequence[str] = ()) -> tuple[Tunable, ...]:
    """The parameters of these names; the usual ones if there is none.

    Raises:
        ConfigError: A name is unknown, or given twice.
    """
    known = {one.name: one for one in TUNABLES}
    for name in names:
        if name not in known:
            raise ConfigError(f"--only: found {name!r}, expected names of {', '.join(known)}.{near(name, list(known))}")
        if list(names).count(name) > 1:
            raise ConfigError(f"--only: found {name} twice, expected each name once")
    return tuple(known[name] for name in names) or tuple(one for one in TUNABLES if one.usual)


def model_based(section: AutopilotSection, where: str) -> ModelBasedSection:
    """The section itself, if it is one that can be tuned.

    Raises:
        ConfigError: It is another autopilot's.
    """
    if not isinstance(section, ModelBasedSection):
        raise ConfigError(
            f"{where}: autopilot: found {section.type}, expected model_based, whose gains are what tune searches; "
            "add --set autopilot=model_based"
        )
    if section.own_blocks:
        key, block = next(iter(section.own_blocks.items()))
        raise ConfigError(
            f"{where}: autopilot.{key}: found {block.label}, expected none of your own: tune searches rovtwin's gains"
        )
    return section


def start_of(scenario: Scenario) -> ModelBasedSection:
    """The scenario's autopilot with numbers in place of what it leaves to the vehicle: where the search begins.

    Raises:
        ConfigError: It is another autopilot's.
    """
    section = model_based(scenario.autopilot, scenario.name)
    filled = with_vehicle_defaults(section, vehicle_of(scenario).model())
    return model_based(filled, scenario.name).model_copy(update={"tuned": None})


def value_of(section: ModelBasedSection, name: str) -> float:
    """A parameter's value in a section that has the vehicle's own filled in (`with_vehicle_defaults`)."""
    part, key, *axis = name.split(".")
    if part == "control":
        found = getattr(section.control, key)
        return float(found[AXES.index(axis[0])] if axis else found)
    found = getattr(section.navigation, key)
    return float(inspect.signature(Tuning.of).parameters[key].default if found is None else found)


def with_values(section: ModelBasedSection, values: Mapping[str, float]) -> ModelBasedSection:
    """The section with other values by name, rounded to four digits as its file has them."""
    data = section.model_dump()
    for name, value in values.items():
        part, key, *axis = name.split(".")
        rounded = float(f"{value:.4g}")
        if axis:
            data[part][key][AXES.index(axis[0])] = rounded
        else:
            data[part][key] = rounded
    return parse(ModelBasedSection, data, "autopilot")


@dataclass(frozen=True)
class Space:
    """The space that is searched: logarithms of the parameters.

    Attributes:
        tunables: In the order of its coordinates, with bounds around the section's values.
        section: Where the search begins, and everything that is not searched.
    """

    tunables: tuple[Tunable, ...]
    section: ModelBasedSection

    @classmethod
    def around(cls, tunables: Sequence[Tunable], section: ModelBasedSection) -> "Space":
        """The space around a section that has the vehicle's own numbers filled in (`start_of`)."""
        return cls(tuple(one.around(value_of(section, one.name)) for one in tunables), section)

    @property
    def names(self) -> list[str]:
        """Of the coordinates."""
        return [one.name for one in self.tunables]

    @property
    def start(self) -> Float[np.ndarray, " n"]:
        """Coordinates of the section; a value of 0 begins at its lower bound."""
        return np.log([max(value_of(self.section, one.name), one.low) for one in self.tunables])

    @property
    def bounds(self) -> Float[np.ndarray, "n 2"]:
        """Least and largest coordinates."""
        return np.log([[one.low, one.high] for one in self.tunables])

    def at(self, x: Float[np.ndarray, " n"]) -> ModelBasedSection:
        """The section at coordinates x."""
        return with_values(self.section, dict(zip(self.names, np.exp(x).tolist(), strict=True)))
