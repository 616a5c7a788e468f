"""Remarks on an identification: what a user should know before relying on it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.user_files.quantity import plain
from rovtwin.identification.diagnostics.validation import Prediction, judged
from rovtwin.identification.diagnostics.verdict import COARSE, scale_width
from rovtwin.identification.diagnostics.whiteness import Residuals
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.couplings import place_of
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.nodes import FADES
from rovtwin.identification.joint.model.parameters import DELAYS, INFLOW, MOUNTING, Parameters
from rovtwin.identification.joint.result.payload import without_shape
from rovtwin.identification.logs.record import Record
from rovtwin.vehicle import Vehicle
from rovtwin.vehicle.analysis.stability import reach
from rovtwin.vehicle.constants import AXES

_SAME_WATER = 0.005  # relative difference of densities: 1.5 N on a vehicle of 30 kg
# Relative width below which the form of the model is in doubt before the readings are: couplings that were off by a few
# parts in a thousand moved estimates of clean tests by several widths (tests.identification.swap).
_FORM = 0.003
PUSHED = 0.05  # of the thrust, beyond which a push is a finding
ASKEW = np.deg2rad(1.0)  # of a gyro, beyond which it is reported
LATE = 0.02  # of a sensor, beyond which it is reported [s]
_CLEAR = 3.0  # standard deviations from zero, beyond which an effect is named
_MOVED = 0.5  # of a width, by which an effect moves a parameter that is named
_BY_SCALE = 0.5  # share of a variance that the scale of positions makes, beyond which it is reported


def about_parts(vehicle: Vehicle, old: Vehicle | None) -> list[str]:
    """What the parts leave out, where they changed."""
    if old is None:
        return []
    new = set(without_shape(vehicle)) - {n.replace(old.name, vehicle.name, 1) for n in without_shape(old)}
    return [f"part '{name}' has no shape: its drag and added mass are predicted as nothing" for name in sorted(new)]


def about_water(vehicle: Vehicle, records: Sequence[Record]) -> list[str]:
    """Tests in water of another density than the vehicle's: its buoyancy and drag were not those of the file."""
    own = vehicle.assembly.density
    others = sorted(
        {r.water_density for r in records if r.water_density and abs(r.water_density / own - 1) > _SAME_WATER}
    )
    if not others:
        return []
    found = " and ".join(f"{density:g}" for density in others)
    return [
        f"tests were flown in water of {found} kg/m3, the vehicle's numbers are for {own:g}: buoyancy, added mass and "
        "drag that come out are those of the tests' water, and a mix of them where it changed; "
        "identify each water apart, or state water_density in the vehicle file"
    ]


def about_tether(parameters: Parameters, records: Sequence[Record]) -> list[str]:
    """Whether its drag was distinguished from the hull's, where it was looked for."""
    lengths = sorted({r.tether_length for r in records if r.tether_length})
    if "tether.drag" not in parameters.names or len(lengths) > 1:
        return []
    return [
        f"the tether's drag cannot be separated from the hull's: all tests were flown with {lengths[0]:g} m paid out; "
        "repeat one of them with another, two lengths are enough"
        if lengths
        else "drag of the tether: no test says how much was paid out, the value is the prior's"
    ]


def about_mounting(
    parameters: Parameters, theta: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
) -> list[str]:
    """Whether the gyro is turned against what the file says, by more than a bracket's usual degree and its width."""
    rows = [i for i, name in enumerate(parameters.names) if name in MOUNTING]
    std = np.sqrt(np.diag(covariance))
    found = [
        f"{np.rad2deg(theta[i]):.1f} +- {np.rad2deg(1.96 * std[i]):.1f} deg in {parameters.names[i].rpartition('.')[2]}"
        for i in rows
        if abs(theta[i]) > max(1.96 * std[i], ASKEW)
    ]
    if not found:
        return []
    fix = "straighten it, or turn mounting_deg of the signal by as much in the evidence file"
    return [f"the gyro is mounted askew by {', '.join(found)}: {fix}"]


def about_delays(
    parameters: Parameters, theta: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
) -> list[str]:
    """Sensors whose readings are older or newer than the log says, by more than LATE and their width."""
    std = np.sqrt(np.diag(covariance))
    found = [
        f"{DELAYS[name]} by {1e3 * theta[i]:.0f} +- {1e3 * 1.96 * std[i]:.0f} ms"
        for i, name in enumerate(parameters.names)
        if name in DELAYS and abs(theta[i]) > max(1.96 * std[i], LATE)
    ]
    if not found:
        return []
    fix = "it is estimated and taken out here, but no autopilot knows of it: mend the clock, or the signal's delay"
    return [
        "readings are older than the log says, against those of the gyro or what serves as clock: "
        f"{', '.join(found)}: {fix}"
    ]


def about_segments(span: float, pushed: bool) -> list[str]:
    """That segments of `span` seconds are too long for what the model lacks to change within; pushed: with a push."""
    if not pushed or span <= 0.5 * FADES:
        return []
    return [
        f"segments last {span:.1f} s: a force that the model lacks and that changes faster is taken for noise of the "
        "sensors, and intervals get too narrow; identify from a part of the tests, or set options.segment to 1 where "
        "memory allows it (6 MB a segment)"
    ]


def about_push(parameters: Parameters, theta: Float[np.ndarray, " n"], push: Float[np.ndarray, "6"]) -> list[str]:
    """What the model lacks and lasts for seconds, where it is not small beside the thrust; push as of `Noise`, (6,)."""
    model = parameters.model_at(theta)[0]
    force, most = np.diag(np.asarray(model.inertia)) * push, np.abs(reach(model)).max(axis=1)
    large = [i for i in range(6) if most[i] > 0.0 and force[i] > PUSHED * most[i]]
    if not large:
        return []
    each = [
        f"{plain(force[i], 2)} {'N' if i < 3 else 'N m'} in {AXES[i]} ({100 * force[i] / most[i]:.0f} % of what the "
        "thrusters give)"
        for i in large
    ]
    return [
        f"something that the model lacks pushes for seconds at a time: {', '.join(each)}, standard deviations; water "
        "that moves, a cable, a force of another form: what of the parameters it hides is not learnt"
    ]


def about_inflow(parameters: Parameters, theta: Float[np.ndarray, " n"]) -> list[str]:
    """That a loss to the inflow which came out below 0 is none in the file."""
    values = parameters.values(theta)
    below = [
        p.name for p, value in zip(parameters.free, values, strict=True) if p.name.endswith(INFLOW) and value < 0.0
    ]
    return [f"{', '.join(below)} came out below 0, which no propeller has: the file states 0"] if below else []


def about_thrust(parameters: Parameters) -> list[str]:
    """Whether forces of the water were estimated against forces of the thrusters that were not."""
    names = parameters.names
    thrust = any(name.startswith("thrusters.") and ".force_" in name for name in names)
    water = any(name.startswith(("added_mass.", "linear_damping", "quadratic_damping")) for name in names)
    if thrust or not water:
        return []
    return [
        "forces of the thrusters were not estimated but taken as exact from the vehicle file: where they are 1 % off, "
        "damping and total inertia are too, and no interval shows it. To estimate them, --free 'thrusters.*' with one "
        "pull on a scale (anchors in an evidence file)"
    ]


def about_scale(
    parameters: Parameters, records: Sequence[Record], solution: Solution, response: Float[np.ndarray, " n"]
) -> list[str]:
    """How far the intervals rest on the scale of positions; response: see `scale_response`, shape (n,)."""
    share = response**2 / np.maximum(np.diag(solution.covariance), 1e-300)
    moved = [p.name for p, part in zip(parameters.free, share, strict=True) if part > _BY_SCALE]
    if not moved:
        return []
    most = max(record.scale_std for record in records)
    return [
        f"lengths of the track are known to {100 * most:.2g} % (one standard deviation): that is most of the intervals "
        f"of {', '.join(moved)}. More tests do not help; measure the printed markers and say how well (scale_std in "
        "layout.yaml, or rovtwin track --marker-scale-std)"
    ]


def about_solution(
    parameters: Parameters,
    prior: Gaussian,
    solution: Solution,
    residuals: Mapping[str, Residuals],
    fitted: Sequence[Prediction],
    held_out: Sequence[Prediction],
    anchors: Sequence[Any],
    ballasted: bool,
) -> list[str]:
    """Remarks: what did not converge, what is not white, what validates badly."""
    remarks = []
    if not solution.converged:
        remarks.append(f"the estimate has not settled after {solution.steps} steps: widths are not to be trusted")
    scale, before = (scale_width(parameters, C) for C in (solution.covariance, prior.covariance))
    if scale > COARSE:
        source = "from the anchors and the prior" if anchors else "from the prior"
        remarks.append(
            f"the common scale of all forces is known to {100 * scale:.0f} % only (one standard deviation), {source}: "
            "add a bollard pull (anchors), a towing table or a test with known ballast"
        )
    elif not anchors and not ballasted and scale < 0.5 * before:
        remarks.append(
            f"the common scale of all forces seems known to {100 * scale:.1f} % from motion alone, by the "
            "inertia of a rigid body whose centre of gravity is off CO: that trusts couplings of added mass and drag "
            "that are not estimated; do not rely on it, add a bollard pull (anchors) or a test with known ballast"
        )
    coloured = _coloured(residuals)
    if coloured:
        worst = max(residuals[name].inflation for name in coloured)
        remarks.append(
            f"residuals are not white ({', '.join(coloured)}; up to {worst:.0f} readings count as one): the model "
            "lacks something that the vehicle does"
        )
    remarks += _about_widths(solution)
    remarks += about_effects(parameters, solution)
    remarks += about_narrow(parameters, solution.covariance)
    remarks += _about_validation(fitted, held_out)
    return remarks


def _coloured(residuals: Mapping[str, Residuals]) -> list[str]:
    """Signals whose residuals are far from white: the model lacks something that the vehicle does."""
    return [name for name, r in residuals.items() if r.inflation > 3]


def about_alike(parameters: Parameters, names: Sequence[str], residuals: Mapping[str, Residuals]) -> list[str]:
    """That thrusters were taken as alike where the model lacks something: a weak one among them hides so."""
    groups = {group: rows for group, rows in parameters.groups.items() if len(rows) > 1}
    if not groups or not _coloured(residuals) or not any(name.startswith("thrusters.") for name in parameters.names):
        return []
    named = "; ".join(f"{group}: {', '.join(names[i] for i in rows)}" for group, rows in groups.items())
    return [
        f"thrusters of a group were taken as alike ({named}), so that a weak one among them passes for something else: "
        "rovtwin watch says whether there is one, and options.groups of an evidence file gives each its own curve"
    ]


def _about_widths(solution: Solution) -> list[str]:
    """What stretches of the tests say of the widths, see `agreement`."""
    if solution.stretches == 0:
        return [
            "the tests are too short to be divided into stretches, so that widths take the model for exact: test for "
            "longer, or repeat the test"
        ]
    wider = solution.widening[solution.widening > 1.0]
    if not len(wider):
        return []
    return [
        f"parts of the tests, by time or by motion, disagree by more than noise: {len(wider)} of "
        f"{len(solution.widening)} intervals are "
        f"{np.median(wider):.1f} times (median, at most {wider.max():.1f}) as wide as an exact model's would be"
    ]


def about_effects(parameters: Parameters, solution: Solution) -> list[str]:
    """What the tests say of effects that the model leaves out, see `joint.uncertainty.unmodelled`."""
    effects, found, width = solution.effects, [], np.sqrt(np.diag(solution.covariance))
    if effects is None:
        return []
    for c, name in enumerate(effects.names):
        size, std = effects.size[c], effects.std[c]
        share = np.abs(size * effects.shift[:, c]) / width
        moved = [parameters.names[i] for i in np.argsort(-share) if share[i] > _MOVED]
        if abs(size) < _CLEAR * std or not moved:
            continue
        named = ", ".join(moved[:3]) + (f" and {len(moved) - 3} more" if len(moved) > 3 else "")
        found.append(
            f"the tests show what the model leaves out: {name}, {size:.2g} +- {std:.1g} {effects.units[c]}; the "
            f"intervals cover that, above all those of {named}"
        )
    return found


def about_narrow(parameters: Parameters, covariance: Float[np.ndarray, "n n"]) -> list[str]:
    """What comes out narrower than any model is right; shares are relative to their diagonals already."""
    width = np.sqrt(np.diag(covariance))
    relative = [(w, p.name) for p, w in zip(parameters.free, width, strict=True) if p.positive or place_of(p.name)]
    narrow = [name for w, name in sorted(relative) if w < _FORM]
    if not narrow:
        return []
    named = ", ".join(narrow[:3]) + (f" and {len(narrow) - 3} more" if len(narrow) > 3 else "")
    return [
        f"{named}: known to better than {100 * _FORM:g} % if the model's form is exact; no vehicle follows it that "
        "closely, so take these intervals for the least there can be"
    ]


def _about_validation(fitted: Sequence[Prediction], held_out: Sequence[Prediction]) -> list[str]:
    remarks = []
    for p in (q for q in held_out if q.window is None):
        for component in judged(p):
            score = p.scores[component]
            own = [q.scores[component].fit for q in fitted if component in q.scores and q.excited[component]]
            if own and score.fit < np.mean(own) - 25:
                remarks.append(
                    f"{p.record}: {component} is predicted with a fit of {score.fit:.0f} %, against "
                    f"{np.mean(own):.0f} % on the fitted tests: much worse, so the model does not carry over"
                )
        still = sorted(
            {c.split(".")[0] for c, e in p.excited.items() if not e}
            - {c.split(".")[0] for c, e in p.excited.items() if e}
        )
        if still:
            remarks.append(f"{p.record}: nothing moved in {', '.join(still)}: no validation of it")
    return remarks
