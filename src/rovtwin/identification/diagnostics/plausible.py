"""Values that a vehicle hardly has, and thrusters that are the same and came out different."""

from itertools import combinations

import numpy as np
from jaxtyping import Float

from rovtwin.identification.diagnostics.tested import Range
from rovtwin.identification.joint.model.parameters import DIRECTIONS, Parameters
from rovtwin.vehicle.physics.model import Model

_UNLIKE = 1.25  # ratio of equal thrusters' forces beyond which they are named
_HEAVIEST = 10.0  # added mass over displaced mass, added inertia over that of the rigid body
_LOST = 0.05  # share of linear and quadratic damping, below which a negative sum is rounding
_Z = 1.96
_RANGES = {"exponent": (0.7, 3.0), "dead_band": (0.0, 0.4), "time_constant": (0.0, 1.0)}
_LEFT = 1.5  # factor by which a thruster's figure must have left its file's value to be called odd


def about_equal_thrusters(
    parameters: Parameters, theta: Float[np.ndarray, " n"], covariance: Float[np.ndarray, "n n"]
) -> list[str]:
    """Groups of thrusters whose file gives one curve to all, and whose forces came out apart beyond their widths."""
    remarks, free = [], set(parameters.names)
    for side in ("force_ahead", "force_astern"):
        for groups in _equal_groups(parameters, side):
            value, apart = _forces(parameters, theta, covariance, groups, side)
            if not apart:
                continue
            order = sorted(groups, key=lambda g: -value[g])
            named = [g if f"thrusters.{g}.{side}" in free else f"{g} as in the file" for g in order]
            shares = " : ".join(f"{value[g] / value[order[0]]:.2g}" for g in order)
            remarks.append(
                f"thrusters of one kind came out at {shares} ({', '.join(named)}; {side.replace('_', ' ')}, "
                f"{', '.join(f'{value[g]:.3g}' for g in order)} N): equal thrusters push alike, but for the flow past "
                "the hull. Check their places and directions, the columns of their commands, and propellers"
            )
    return remarks


def _equal_groups(parameters: Parameters, side: str) -> list[list[str]]:
    """Groups of equal thrusters by the vehicle's file, of which one force at least was estimated."""
    t = parameters.model.thrusters
    kinds: dict[tuple[float, ...], list[str]] = {}
    for group, members in parameters.groups.items():
        i = members[0]
        table = np.asarray(t.table_force)[i] if bool(t.tabulated[i]) else np.zeros(1)
        figures = (t.force_ahead[i], t.force_astern[i], t.exponent[i], t.dead_band[i], *table)
        kinds.setdefault(tuple(np.round([float(x) for x in figures], 9)), []).append(group)
    free = set(parameters.names)
    return [g for g in kinds.values() if len(g) > 1 and any(f"thrusters.{x}.{side}" in free for x in g)]


def _forces(
    parameters: Parameters,
    theta: Float[np.ndarray, " n"],
    covariance: Float[np.ndarray, "n n"],
    groups: list[str],
    side: str,
) -> tuple[dict[str, float], bool]:
    """Force of each group [N], and whether two of them differ by much and by more than their widths."""
    names, n = parameters.names, len(theta)
    value, row = {}, {}
    for group in groups:
        name = f"thrusters.{group}.{side}"
        row[group] = np.zeros(n)
        value[group] = float(getattr(parameters.model.thrusters, side)[parameters.groups[group][0]])
        if name in names:
            i = names.index(name)
            row[group][i], value[group] = 1.0, float(parameters.free[i].value(float(theta[i])))
    for a, b in combinations(groups, 2):
        gap, along = abs(np.log(value[a] / value[b])), row[a] - row[b]
        if gap > np.log(_UNLIKE) and gap > _Z * np.sqrt(max(along @ covariance @ along, 0.0)):
            return value, True
    return value, False


def about_odd_values(parameters: Parameters, theta: Float[np.ndarray, " n"], tested: dict[str, Range]) -> list[str]:
    """What no vehicle has, or hardly any: named with the value and what is usual."""
    model = parameters.model_at(theta)[0]
    odd = [*_heavy_water(model, parameters), *_pushing_water(model, tested), *_odd_thrusters(parameters, theta)]
    if not odd:
        return []
    return [f"odd values: {'; '.join(odd)}. They may serve the fit, but no vehicle is like that: see what drives them"]


def _heavy_water(model: Model, parameters: Parameters) -> list[str]:
    added, rigid = (np.asarray(M).diagonal() for M in (model.added_mass, model.rigid_body_mass))
    body = np.where(np.arange(6) < 3, float(model.displaced_mass), rigid)
    free = set(parameters.names)
    return [
        f"added mass in {d} is {added[i] / body[i]:.0f} times {'the displaced mass' if i < 3 else 'the own inertia'}"
        for i, d in enumerate(DIRECTIONS)
        if f"added_mass.{d}" in free and added[i] > _HEAVIEST * max(body[i], 1e-9)
    ]


def _pushing_water(model: Model, tested: dict[str, Range]) -> list[str]:
    """Directions in which damping drives the vehicle on, at an end of the speeds that were tested."""
    found = []
    for i, d in enumerate(DIRECTIONS):
        for v in tested.get(d, ()):
            side = "ahead" if v > 0 else "astern"
            linear, quadratic = (
                float(getattr(model, f"{kind}_damping_{side}")[i, i]) for kind in ("linear", "quadratic")
            )
            if linear * abs(v) + quadratic * v * v < -_LOST * (abs(linear * v) + abs(quadratic) * v * v):
                found.append(f"damping in {d} is negative at {v:.3g} {'m/s' if i < 3 else 'rad/s'}")
    return found


def _odd_thrusters(parameters: Parameters, theta: Float[np.ndarray, " n"]) -> list[str]:
    found = []
    for p, t in zip(parameters.free, theta, strict=True):
        what = p.name.rpartition(".")[2]
        if not p.name.startswith("thrusters.") or what not in _RANGES:
            continue
        low, high = _RANGES[what]
        value = float(p.value(float(t)))
        if not low <= value <= high and abs(np.log(value / p.base)) > np.log(_LEFT):
            found.append(
                f"{p.name} is {value:.3g}{'' if p.unit == '1' else f' {p.unit}'}, usual is {low:g} to {high:g}"
            )
    return found
