"""Servo outputs of ArduSub as commands of the vehicle's thrusters.

SERVOn_FUNCTION says which motor an output drives, FRAME_CONFIG where that motor sits and where it pushes, and
MOT_n_DIRECTION makes up for the sense of its propeller: ArduSub sends 1500 us + 400 us times direction times the sum of
axis times factor, so that a pulse, times its direction, pushes along the motor's factors. Each motor is the thruster of
the vehicle whose wrench lies closest to the line of these factors; the sign follows from which way along it.

Reference: ArduPilot, libraries/AP_Motors/AP_Motors6DOF.cpp (factors of the frames) and libraries/SRV_Channel (functions
33 to 40 are motors 1 to 8, 82 to 85 motors 9 to 12).
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Real
from scipy.optimize import linear_sum_assignment

NEUTRAL, RANGE = 1500.0, 400.0  # [us]
LOWEST, HIGHEST = 800.0, 2200.0  # [us]; beyond, the output gives no pulse
FITS = 0.7  # cosine between a motor's factors and a thruster's wrench; below, they are not the same one
FUNCTIONS = {**{33 + n: n + 1 for n in range(8)}, **{82 + n: n + 9 for n in range(4)}}

# Of each motor: roll right, pitch up, yaw right, up, forward, right.
_HORIZONTAL = [(0, 0, 1, 0, -1, 1), (0, 0, -1, 0, -1, -1), (0, 0, -1, 0, 1, 1), (0, 0, 1, 0, 1, -1)]
_PAIR, _LATERAL = [(0, 0, -1, 0, 1, 0), (0, 0, 1, 0, 1, 0)], (0, 0, 0, 0, 0, 1)
FRAMES: dict[int, tuple[str, list[tuple[float, ...]]]] = {
    0: ("BLUEROV1", [*_PAIR, (-0.5, 0.5, 0, 0.45, 0, 0), (0.5, 0.5, 0, 0.45, 0, 0), (0, -1, 0, 1, 0, 0), _LATERAL]),
    1: ("VECTORED", [*_HORIZONTAL, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0)]),
    2: (
        "VECTORED_6DOF",
        [*_HORIZONTAL, (1, -1, 0, -1, 0, 0), (-1, -1, 0, -1, 0, 0), (1, 1, 0, -1, 0, 0), (-1, 1, 0, -1, 0, 0)],
    ),
    3: (
        "VECTORED_6DOF_90DEG",
        [
            *((1, 1, 0, 1, 0, 0), (0, 0, 1, 0, 1, 0), (1, -1, 0, 1, 0, 0), _LATERAL),
            *(_LATERAL, (-1, 1, 0, 1, 0, 0), (0, 0, -1, 0, 1, 0), (-1, -1, 0, 1, 0, 0)),
        ],
    ),
    4: ("SIMPLEROV_3", [*_PAIR, (0, 0, 0, -1, 0, 0)]),
    5: ("SIMPLEROV_4", [*_PAIR, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0)]),
    6: ("SIMPLEROV_5", [*_PAIR, (1, 0, 0, -1, 0, 0), (-1, 0, 0, -1, 0, 0), _LATERAL]),
}
_OF_COUNT = {8: 2, 6: 1}  # the frame of most vehicles with so many thrusters


class NoCommands(ValueError):
    """Why the outputs of a log cannot be taken for commands of the vehicle's thrusters."""


@dataclass(frozen=True)
class Drive:
    """What drives one thruster: number of the output, sign of its pulses, motor."""

    output: int
    sign: float
    motor: int


def drives(
    parameters: dict[str, float], configuration: Float[np.ndarray, "6 n"], names: list[str], outputs: list[int]
) -> tuple[dict[str, Drive], list[str]]:
    """Which output drives which thruster, by the thrusters' names, and notes on what was assumed.

    Args:
        parameters: Of the autopilot, by name.
        configuration: Wrench of unit forces, b at CO.
        names: Of the thrusters, n of them.
        outputs: Numbers of the outputs that the log has.

    Raises:
        NoCommands: The frame is unknown, or it is another vehicle's.
    """
    frame, factors, notes = _frame(parameters, names)
    if len(factors) != len(names):
        raise NoCommands(
            f"its frame {frame} has {len(factors)} motors, the vehicle has {len(names)} thrusters "
            f"({', '.join(names)}). Give the vehicle that was driven, or write 'commands' by hand"
        )
    output_of = _outputs(parameters, len(factors), notes)
    missing = [n for n in output_of.values() if n not in outputs]
    if missing:
        raise NoCommands(f"motors are on outputs {_listed(output_of.values())}, but output {missing[0]} is not logged")
    motor_of, cosine = matched(_wrenches(factors), configuration)
    worst = int(np.argmin(np.abs(cosine)))
    if abs(cosine[worst]) < FITS:
        raise NoCommands(
            f"no motor of its frame {frame} pushes like the vehicle's thruster {names[worst]}. Give the vehicle that "
            "was driven, or write 'commands' by hand"
        )
    notes += _unreported(parameters, output_of)
    found = {}
    for name, motor, along in zip(names, motor_of, cosine, strict=True):
        direction = np.sign(parameters.get(f"MOT_{motor + 1}_DIRECTION", 1.0)) or 1.0
        found[name] = Drive(output_of[motor + 1], float(np.sign(along) * direction), int(motor) + 1)
    text = ", ".join(f"{'-' if d.sign < 0 else ''}{name} by output {d.output}" for name, d in found.items())
    return found, [*notes, f"thrusters of frame {frame}: {text}"]


def matched(
    wrenches: Float[np.ndarray, "n 6"], configuration: Float[np.ndarray, "6 n"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """The motor of each thruster, from 0, and the cosine between what they push.

    Args:
        wrenches: Of the autopilot's motors at positive output, b, of any size.
        configuration: Wrench of the thrusters' unit forces.
    """
    cosine = _unit(configuration.T) @ _unit(wrenches).T
    rows, motor = linear_sum_assignment(-np.abs(cosine))
    return motor, cosine[rows, motor]


def _unit(wrenches: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 6"]:
    """Wrenches made unit vectors, moments measured by the largest of them."""
    scaled = wrenches / np.array([1.0, 1.0, 1.0, *[max(np.abs(wrenches[:, 3:]).max(), 1e-9)] * 3])
    return scaled / np.maximum(np.linalg.norm(scaled, axis=1, keepdims=True), 1e-9)


def command(pulse: Real[np.ndarray, "*axes"], sign: float) -> Float[np.ndarray, "*axes"]:
    """u of pulse widths [us]; 1100 to 1900 is -1 to 1, and no pulse is off."""
    on = (pulse >= LOWEST) & (pulse <= HIGHEST)
    return np.where(on, np.clip(sign * (pulse - NEUTRAL) / RANGE, -1.0, 1.0), 0.0)


def _wrenches(factors: list[tuple[float, ...]]) -> Float[np.ndarray, "n 6"]:
    """Of motors at positive output, FRD."""
    return np.array(factors, dtype=float)[:, [4, 5, 3, 0, 1, 2]] * [1.0, 1.0, -1.0, 1.0, 1.0, 1.0]


def _frame(parameters: dict[str, float], names: list[str]) -> tuple[str, list[tuple[float, ...]], list[str]]:
    if "FRAME_CONFIG" not in parameters:
        guess = _OF_COUNT.get(len(names))
        if guess is None:
            raise NoCommands("it does not say FRAME_CONFIG, so that nobody knows where its motors sit")
        name, factors = FRAMES[guess]
        return name, factors, [f"FRAME_CONFIG is not in the log: {name} taken, of {len(names)} thrusters"]
    number = int(parameters["FRAME_CONFIG"])
    if number not in FRAMES:
        raise NoCommands(f"its FRAME_CONFIG is {number}, a frame of its own, whose motors nobody else knows")
    name, factors = FRAMES[number]
    return name, factors, []


def _outputs(parameters: dict[str, float], motors: int, notes: list[str]) -> dict[int, int]:
    """The output of each motor from 1."""
    found: dict[int, int] = {}
    for name, value in parameters.items():
        match = re.fullmatch(r"SERVO(\d+)_FUNCTION", name)
        if match and FUNCTIONS.get(int(value), 99) <= motors:
            found.setdefault(FUNCTIONS[int(value)], int(match[1]))
    if not found:
        notes.append("SERVOn_FUNCTION is not in the log: motor n taken for output n")
        return {n: n for n in range(1, motors + 1)}
    missing = [n for n in range(1, motors + 1) if n not in found]
    if missing:
        raise NoCommands(f"no output has motor {missing[0]} (function {_function(missing[0])})")
    return dict(sorted(found.items()))


def _unreported(parameters: dict[str, float], output_of: dict[int, int]) -> list[str]:
    """Notes on settings that are missing, or that a pulse of 1100 to 1900 us does not fit."""
    notes = []
    unknown = [n for n in output_of if f"MOT_{n}_DIRECTION" not in parameters]
    if unknown:
        notes.append(
            f"MOT_n_DIRECTION of motors {_listed(unknown)} is not in the log: 1 taken; a check finds wrong signs"
        )
    reversed_ = [n for n in output_of.values() if parameters.get(f"SERVO{n}_REVERSED")]
    if reversed_:
        notes.append(f"SERVOn_REVERSED of outputs {_listed(reversed_)} left out: ArduSub does not turn motors' pulses")
    low, high = parameters.get("MOT_PWM_MIN", 0.0) or 1100.0, parameters.get("MOT_PWM_MAX", 0.0) or 1900.0
    if (low, high) != (1100.0, 1900.0):
        notes.append(f"pulses go from {low:g} to {high:g} us, not 1100 to 1900: commands are (pulse - 1500) / 400")
    return notes


def _function(motor: int) -> int:
    return next(function for function, number in FUNCTIONS.items() if number == motor)


def _listed(numbers: Iterable[int]) -> str:
    return ", ".join(str(n) for n in numbers)
