"""Tables of an identification: parameters, forces, tests, validation, residuals, what was blind, provenance."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool

from rovtwin.core.user_files.quantity import plain
from rovtwin.report.identification.test_figures import component_name, how, scaled, unit_of
from rovtwin.report.identification.words import excitation, in_families, is_coupling, naive
from rovtwin.report.parts.curves import DIRECTIONS, FORCE_UNITS, SPEED_UNITS, Curve, Curves
from rovtwin.report.parts.tables import Table
from rovtwin.vehicle.description.identified import fingerprint

_Z = 1.96
_STRONG = 0.9


def pretty(unit: str) -> str:
    """`N s²/m²` of `N s2/m2`."""
    return "" if unit == "1" else unit.replace("2", "²").replace("3", "³")


def number(value: float, digits: int = 4) -> str:
    """For people: so many significant digits, without a power of ten where it can be helped."""
    value = float(value)
    if not np.isfinite(value):
        return "-"
    return plain(value, digits)


def estimated(value: float, low: float, high: float) -> str:
    """An estimate with four digits, or as many more as it takes to tell it from the ends of its interval."""
    return number(value, max(4, _digits(value, low, high)))


def between(low: float, high: float) -> str:
    """Ends of an interval with as many digits as its width needs, two at least."""
    if not np.isfinite(high - low):
        return "-"
    if max(abs(low), abs(high)) < 1e-3:
        return " to ".join(f"{x + 0.0:.{_digits(x, low, high)}g}" for x in (low, high))
    places = _places((high - low) / 2)
    return " to ".join(f"{x + 0.0:.{max(_places(x), places)}f}" for x in (float(low), float(high)))


def _digits(x: float, low: float, high: float) -> int:
    """Significant digits of x that show two of half an interval's width, two at least."""
    half = abs(high - low) / 2
    if not (x and 0 < half < np.inf):
        return 2
    return max(2, 2 + int(np.floor(np.log10(abs(x))) - np.floor(np.log10(half))))


def _places(x: float) -> int:
    """Decimals that show two significant digits."""
    return int(np.clip(1 - np.floor(np.log10(max(abs(x), 1e-12))), 0, 12)) if x else 0


def percent(share: float) -> str:
    """Two significant digits."""
    if not np.isfinite(share):
        return "-"
    return f"{100 * share:.2g} %" if share < 0.995 else f"{100 * share:.0f} %"


def parameter_table(result: Any, couplings: bool) -> Table:
    """Value, interval, prior, how much narrower, verdict and excitation of the free parameters, or of the couplings."""
    std, before = result.std, np.sqrt(np.diag(result.prior.covariance))
    rows = []
    for i, (p, verdict, moved) in enumerate(
        zip(result.parameters.free, result.verdicts, excitation(result), strict=True)
    ):
        if is_coupling(p.name) != couplings:
            continue
        mean = result.prior.mean[i]
        prior = (p.value(mean - _Z * before[i]), p.value(mean + _Z * before[i]))
        ends = result.interval(p.name)
        rows.append([
            p.name, estimated(p.value(result.theta[i]), *ends), between(*ends), number(p.value(mean)),
            between(*prior), pretty(p.unit), f"{std[i] / before[i]:.2g}", verdict, moved,
        ])  # fmt: skip
    head = ["Parameter", "Value", "95 %", "Prior", "95 % of it", "Unit", "Width left", "Verdict", "Excitation"]
    if couplings:
        note = (
            "Shares of what the diagonals allow: M_ij of sqrt(M_ii M_jj) for added mass; for damping what the first "
            "motion does in the second, of D_ii^(2/3) D_jj^(1/3). Drag that acts on one side of CO has them."
        )
        return Table("Couplings", head, rows, note)
    note = (
        "Width left: standard deviation now over that of the prior; below 0.5 is learnt, above 0.9 only the prior "
        "speaks. Contradicted: outside the prior's 95 % interval with a width below half of its, or two logs by "
        "themselves differ beyond their widths. "
        "Excitation: whether the tests would tell the parameter if all others were known, and whether they "
        "tell it apart from the others. Damping and added mass are positive: X_u = -linear damping."
    )
    return Table("", head, rows, note)


def force_table(result: Any, now: Curves, before: Curves) -> Table:
    """Damping force at the ends of the tested speeds."""
    rows = []
    for i in now.estimated:
        name = DIRECTIONS[i]
        curve, old = now.damping[name], before.damping[name]
        for k in (0, len(curve.x) - 1):
            if curve.x[k] == 0.0:
                continue
            rows.append([
                name, f"{curve.x[k]:+.3g} {SPEED_UNITS[i]}",
                f"{estimated(curve.y[k], curve.low[k], curve.high[k])} {FORCE_UNITS[i]}", _band(curve, k),
                percent(curve.half_width[k]), percent(old.half_width[k]),
            ])  # fmt: skip
    tested = bool(result.tested)
    note = "At the ends of the speeds that the tests covered." if tested else "No test: speeds chosen for the picture."
    head = ["Direction", "Speed", "Damping", "95 %", "±", "± before the tests"]
    return Table("Damping forces", head, rows, note + " Single coefficients are correlated; the force is what matters.")


def _band(curve: Curve, k: int) -> str:
    return between(*sorted((curve.low[k], curve.high[k])))


def record_table(result: Any) -> Table:
    """The tests: what was used of them."""
    rows = [
        [
            r["name"], r["use"], f"{r['duration']:.1f}",
            ", ".join(f"{name} {count}" for name, count in r["signals"].items()),
            _given(r["water_density"]), _given(r["tether_length"]), "; ".join(r["notes"]) or "-",
        ]
        for r in result.records
    ]  # fmt: skip
    head = ["Test", "Use", "Duration [s]", "Readings", "Water [kg/m³]", "Tether [m]", "Notes"]
    used = "" if result.problem is None else f" The fit takes at most {result.problem.segments.grid.rate:g} a second."
    return Table("", head, rows, f"Readings: as logged.{used} A dash: nobody said.")


def _given(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"


def validation_table(predictions: Any) -> Table:
    """Scores of predictions beside those of the predictors that need no model."""
    rows = []
    for p in predictions:
        for component, s in p.scores.items():
            better = "nothing moved" if not p.excited[component] else "yes" if s.rms < naive(s) else "no"
            rows.append([
                p.record, how(p), component_name(component), f"{round(s.fit)} %",
                *(number(scaled(component, x), 3) for x in (s.rms, s.hold, s.still)), unit_of(component), better,
            ])  # fmt: skip
    head = ["Test", "Predicted", "Component", "Fit", "rms", "rms, holding", "rms, at rest", "Unit", "Better"]
    note = (
        "Fit is 100 (1 - |y - y_hat| / |y - mean y|): 100 % is perfect, 0 % as good as the mean. Holding: the first "
        "reading of each window held. At rest: predicting zero."
    )
    return Table("Scores", head, rows, note)


def residual_table(result: Any) -> Table:
    """Noise found against declared, sensor offsets, whiteness."""
    solution, segments = result.solution, result.problem.segments
    rows = []
    for g, (signal, i) in enumerate(segments.groups):
        name = [n for n in result.residuals if n.startswith(f"{signal}.")][i]
        r = result.residuals[name]
        offset, width = solution.unknowns.offsets[g], solution.offset_std[g]
        free = width > 2e-6  # a held offset is the reference of its signal
        rows.append([
            component_name(name), str(len(r.t)), number(scaled(name, solution.noise.sigma[g]), 3),
            number(scaled(name, segments.sigma[signal][i]), 3), unit_of(name),
            f"{scaled(name, offset):.2g} ± {scaled(name, _Z * width):.1g}" if free else "-",
            f"{100 * r.outside:.0f} %", f"{r.inflation:.2g}",
        ])  # fmt: skip
    head = [
        "Component",
        "Readings",
        "Noise found",
        "Declared",
        "Unit",
        "Offset found",
        "Lags outside",
        "Readings as one",
    ]
    note = (
        "Noise: standard deviation of a reading. Lags outside: share of the autocorrelation beyond its 95 % band, 5 % "
        "for white noise. Readings as one: how many correlated residuals carry as much as one white one."
    )
    return Table("Noise", head, rows, note)


def disturbance_table(result: Any) -> Table:
    """What pushed the vehicle and is in no model, by direction."""
    noise, grid = result.solution.noise, result.problem.segments.grid
    missed, lasting, least = noise.defect[6:12], noise.push(grid.span), 2e-5  # its floor
    mass = np.asarray(result.model().inertia).diagonal()
    rows = [
        [
            name,
            f"{mass[i] * lasting[i]:.2g} {FORCE_UNITS[i]}" if lasting[i] > least else "none seen",
            f"{missed[i]:.2g} {SPEED_UNITS[i]}",
            f"{mass[i] * missed[i]:.2g} {FORCE_UNITS[i]} s",
        ]
        for i, name in enumerate(DIRECTIONS)
    ]
    note = (
        "Standard deviations: of a force that lasts for some seconds, of the speed that the model misses besides after "
        f"{grid.span:g} s of running on its own from the estimated state, and of the impulse that would explain it. "
        "The smallest speed, 1e-05, is a floor: no disturbance was seen."
    )
    return Table("Disturbance", ["Direction", "Lasting force", "Speed missed", "Impulse"], rows, note)


def blind_table(result: Any) -> Table:
    """Directions that the tests cannot tell."""
    rows = [
        [
            str(k),
            b.text,
            ", ".join(f"{n} {w:+.2f}" for n, w in zip(b.names, b.weights, strict=True)),
            f"{b.information:.2g}",
        ]
        for k, b in enumerate(result.blind, start=1)
    ]
    head = ["", "What the tests cannot tell", "Direction (in prior standard deviations)", "Information"]
    return Table("", head, rows, "Information of the readings over that of the prior; below 1 the prior knows more.")


def correlated_table(result: Any) -> Table:
    """Parameters that are only known together: groups joined by strong correlations."""
    std = np.sqrt(np.diag(result.covariance))
    correlation = result.covariance / np.outer(std, std)
    names, rows = result.parameters.names, []
    for members in _joined(np.abs(correlation) > _STRONG):
        signs = np.sign(correlation[members[0], members])
        up, down = ([names[i] for i, s in zip(members, signs, strict=True) if s == way] for way in (1.0, -1.0))
        text = (
            "rise and fall together: their ratios are known better than they are"
            if not down
            else "make good for each other"
        )
        rows.append([f"{in_families(names, up)}{' against ' + in_families(names, down) if down else ''}", text])
    return Table("Known together only", ["Parameters", "Their errors"], rows, f"Correlations beyond ±{_STRONG}.")


def _joined(strong: Bool[np.ndarray, "n n"]) -> list[list[int]]:
    """Members of each group of more than one that a chain of strong pairs joins."""
    left, groups = set(range(len(strong))), []
    while left:
        found, edge = set(), {min(left)}
        while edge:
            found |= edge
            edge = {int(j) for i in edge for j in np.flatnonzero(strong[i])} - found
        left -= found
        groups.append(sorted(found))
    return [group for group in groups if len(group) > 1]


def provenance_table(result: Any) -> Table:
    """What it was made from and with."""
    rows = [
        ["vehicle", f"{result.vehicle.name} ({result.vehicle.where})"],
        ["fingerprint of its parts", fingerprint(result.vehicle.file)],
        ["rovtwin", result.version],
        ["time taken", f"{result.seconds:.0f} s"],
    ]
    if result.solution is not None:
        settled = "settled" if result.solution.converged else "not settled"
        rows.append(["solver", f"{result.solution.steps} steps, {settled}"])
    for r in result.records:
        rows.append([f"test {r['name']}", f"{r['source']}{_hash(r['source'])}"])
    return Table("", ["Entry", "Value"], rows)


def _hash(source: str) -> str:
    path = Path(source)
    try:
        return f", sha256 {hashlib.sha256(path.read_bytes()).hexdigest()[:16]}" if path.is_file() else ""
    except OSError:
        return ""


def learned_errors_table(made: Any) -> Table:
    """Errors of predicted blocks without and with the learned wrench, by component."""
    rows = [
        [component_name(name), *(number(scaled(name, x), 3) for x in pair), unit_of(name),
         f"{100 * (pair[1] / max(pair[0], 1e-300) - 1.0):+.0f} %"]
        for name, pair in made.errors.items()
    ]  # fmt: skip
    note = (
        f"rms over {made.blocks} blocks, each predicted in open loop by what was fitted to the others. The decision is "
        "by the mean of the logarithms over components, then blocks."
    )
    return Table("Predictions without and with it", ["Component", "Without", "With", "Unit", "Change"], rows, note)


def learned_parts_table(learned: Any) -> Table:
    """What was learned along which axis."""
    rows = []
    for part in learned.parts:
        unit = FORCE_UNITS[DIRECTIONS.index(part.axis)]
        inputs = "velocity" if part.of == "motion" else "velocity and thrust"
        rows.append([part.axis, inputs, f"{part.std:.2g} {unit}", str(len(part.weights))])
    note = "Size: standard deviation before the tests, which it has again far from them."
    return Table("Parts", ["Axis", "A function of", "Size", "Kernel functions"], rows, note)
