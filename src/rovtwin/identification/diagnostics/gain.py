"""Whether a gain of the command path is wrong: forces of all thrusters that come out by one factor.

Thrust, mass, drag and restoring times a factor give the same motion, so that the factor itself rests on the prior. But
a gain on the commands, unlike one on the forces, changes the shape of force against command: the dead band lies
elsewhere, and the curve bends elsewhere. So the accelerations say which gain they follow.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.parameters import Parameters
from rovtwin.identification.logs.motion import Motion
from rovtwin.identification.logs.record import Record
from rovtwin.identification.logs.response import Regression, thruster_forces
from rovtwin.vehicle.physics.model import Model

FAR = 1.5  # factor of all forces beyond which the commands are doubted
_EACH = 1.2  # factor that every group of thrusters must have left its prior by, to the same side
_GAINS = np.round(np.geomspace(0.25, 4.0, 17), 3)
_EXPLAINED = 0.2  # share of an axis' acceleration that thrusters must explain before its shape counts
_BETTER = 0.01  # share of the accelerations that another gain must explain more


def about_gain(
    parameters: Parameters, prior: Gaussian, theta: Float[np.ndarray, " n"], records: Sequence[Record]
) -> list[str]:
    """That commands, not thrusters, may be wrong, where all forces came out at a factor of what was known before.

    Args:
        parameters: Free ones; nothing is said unless forces of all groups of thrusters are among them.
        prior: What was known before.
        theta: The estimate.
        records: The fitted tests.
    """
    factors = _factors(parameters, prior, theta)
    if not factors or set(factors) != set(parameters.groups):
        return []
    logs = np.log(list(factors.values()))
    common = float(np.exp(np.mean(logs)))
    if abs(np.log(common)) < np.log(FAR) or np.min(logs * np.sign(np.log(common))) < np.log(_EACH):
        return []
    each = ", ".join(f"{group} {factor:.2g}" for group, factor in factors.items())
    gain = gain_by_shape(parameters.model, records)
    if gain is None:
        shape = "The shape of force against command does not tell"
    elif gain == 1.0:
        shape = "The shape of force against command, its dead band, is best as it is: rather the forces, or the masses"
    else:
        shape = f"The shape of force against command, its dead band, is best with commands {gain:.2g} times as large"
    return [
        f"forces of all thrusters came out at {common:.2g} times what was known before ({each}): a gain of the command "
        f"path may be wrong by that factor. {shape}. Check the gains of 'mix' in the evidence file (how much of the "
        "pilot's axes reached the thrusters?), the range of PWM (1500 +- 400 us), the battery's voltage against that "
        "of the thrust table; only then think of a tether or a current that pushes"
    ]


def _factors(parameters: Parameters, prior: Gaussian, theta: Float[np.ndarray, " n"]) -> dict[str, float]:
    """Of each group of thrusters, by what its estimated forces differ from the prior's, ahead and astern together."""
    found: dict[str, list[float]] = {}
    for p, now, before in zip(parameters.free, theta, prior.mean, strict=True):
        family, _, rest = p.name.partition(".")
        group, _, what = rest.rpartition(".")
        if family == "thrusters" and what.startswith("force_"):
            found.setdefault(group, []).append(float(now - before))
    return {group: float(np.exp(np.mean(values))) for group, values in found.items()}


def gain_by_shape(model: Model, records: Sequence[Record]) -> float | None:
    """The gain on the commands with which forces explain most of the accelerations; None where they do not tell.

    Forces are free in size: only the shape of the thrust curve tells. 1 where no other explains clearly more.
    """
    shares, durations = [], []
    for record in records:
        motion = Motion.of(record)
        regression = Regression.of(model, motion)
        if regression is None:
            continue
        found = []
        for gain in _GAINS:
            driven = replace(record, command=np.clip(gain * record.command, -1.0, 1.0))
            force = thruster_forces(model, replace(motion, record=driven, _known={}))
            found.append(regression.against(force).explainable)
        table = np.array(found)
        explained = table.max(axis=0) > _EXPLAINED
        if explained.any():
            shares.append(record.duration * table[:, explained].mean(axis=1))
            durations.append(record.duration)
    if not shares:
        return None
    share = np.sum(shares, axis=0) / sum(durations)
    now = share[int(np.argmin(np.abs(_GAINS - 1.0)))]
    best = int(np.argmax(share))
    if np.ptp(share) < _BETTER:
        return None
    return float(_GAINS[best]) if share[best] > now + _BETTER else 1.0
