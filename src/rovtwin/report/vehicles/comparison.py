"""Vehicle files side by side: tables, force curves with bands where they were identified, and an HTML report.

Takes what `identification.diagnostics.stated` reads of a file: `label`, `vehicle`, `values`, `tested`, `covariance`,
`parameters` and `model_at`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rovtwin.report.identification.html import Section
from rovtwin.report.identification.tables import between, estimated, number, percent, pretty
from rovtwin.report.identification.words import is_coupling
from rovtwin.report.parts.curves import DIRECTIONS, FORCE_UNITS, SPEED_UNITS, Curves, Subject, curves, speed_grid
from rovtwin.report.parts.page import save, write_page
from rovtwin.report.parts.tables import Table
from rovtwin.report.parts.verdict import Verdict
from rovtwin.report.vehicles import comparison_figures as figures
from rovtwin.vehicle.analysis.stability import steady_speed
from rovtwin.vehicle.description.identified import fingerprint

_UNREACHED = 0.5  # speed of the picture where no thruster pushes [m/s, rad/s]
_AGREE, _NOTABLE = 0.05, 3.0  # chance below which files differ as a whole; deviations from which a parameter is named


@dataclass(frozen=True)
class Force:
    """Damping of all files at one speed: force, ends of its band (NaN without a width), deviations from the first."""

    direction: str
    speed: float
    force: tuple[float, ...]
    band: tuple[tuple[float, float], ...]
    deviations: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Vehicle files side by side.

    Attributes:
        files: As stated, the first is what the others are compared with.
        rows: Names of the parameters, in order.
        differences: Per other file, by name of the parameter.
        wholes: Per other file, as a whole; None where nothing has a width.
        curves: Per file, over common speeds and commands.
    """

    files: Sequence[Any]
    rows: Sequence[str]
    differences: Sequence[Mapping[str, Any]]
    wholes: Sequence[Any]
    curves: Sequence[Curves]

    def pairs(self) -> "list[Comparison]":
        """Each other file beside the first."""
        others = zip(self.files[1:], self.differences, self.wholes, self.curves[1:], strict=True)
        return [
            Comparison(
                [self.files[0], one],
                [name for name in self.rows if name in self.files[0].values or name in one.values],
                [differences], [whole], [self.curves[0], curves],
            )
            for one, differences, whole, curves in others
        ]  # fmt: skip

    def forces(self) -> list[Force]:
        """At the ends of the speeds and half-way."""
        out = []
        for name in DIRECTIONS:
            own = [c.damping[name] for c in self.curves]
            v = own[0].x
            for k in sorted({int(np.argmin(np.abs(v - s))) for s in (v[0], v[0] / 2, v[-1] / 2, v[-1])}):
                if v[k] != 0.0:
                    std = [(c.high[k] - c.low[k]) / 2 / 1.96 for c in own]
                    gaps = [
                        np.sign(v[k]) * (c.y[k] - own[0].y[k]) / _joint(std[0], s)
                        for c, s in zip(own, std, strict=True)
                    ]
                    out.append(Force(name, float(v[k]), tuple(float(c.y[k]) for c in own),
                                     tuple((float(c.low[k]), float(c.high[k])) for c in own), tuple(gaps)))  # fmt: skip
        return out


def _joint(a: float, b: float) -> float:
    """Of two standard deviations; what is NaN is taken as exact, NaN where both are."""
    total = float(np.sqrt(sum(s**2 for s in (a, b) if np.isfinite(s))))
    return total if total > 0 else float("nan")


def compare_files(
    files: Sequence[Any], difference: Callable[[Any, Any], Any], as_a_whole: Callable[[Any, Any], Any]
) -> Comparison:
    """Everything that tables and figures show.

    Args:
        files: Two or more, as `stated` reads them.
        difference: Of two values of a parameter (`rovtwin.identification.diagnostics.differences`).
        as_a_whole: Of two files.
    """
    rows = list(dict.fromkeys(name for one in files for name in one.values))
    rows = [name for name in rows if not _twice(files, name)]
    first = files[0]
    differences = [
        {n: difference(first.values[n], one.values[n]) for n in rows if n in first.values and n in one.values}
        for one in files[1:]
    ]
    grids = {
        name: speed_grid([one.tested[name] for one in files if name in one.tested], _reach(files, i))
        for i, name in enumerate(DIRECTIONS)
    }
    commands = np.linspace(-1.0, 1.0, 81)
    drawn = [curves(_subject(one), grids, commands) for one in files]
    return Comparison(files, rows, differences, [as_a_whole(first, one) for one in files[1:]], drawn)


def _twice(files: Sequence[Any], name: str) -> bool:
    """Damping astern that says what damping ahead says, and is nobody's own parameter."""
    if "_astern." not in name or name.startswith("thrusters."):
        return False
    ahead = name.replace("_astern", "")
    return all(
        name not in one.values or (np.isnan(one.values[name].std) and one.values[name].value == one.values[ahead].value)
        for one in files
    )


def _subject(one: Any) -> Subject:
    theta = np.zeros(len(one.parameters.free))
    return Subject(one.label, one.model_at, theta, one.covariance, one.parameters.groups, one.tested)


def _reach(files: Sequence[Any], axis: int) -> tuple[float, float]:
    """Speeds that every file reaches on one axis under full thrust, for pictures of what nobody tested."""
    speeds = []
    for one in files:
        model = one.parameters.model
        row = np.asarray(model.thrusters.configuration)[axis]
        force = float(np.abs(row) @ np.asarray(model.thrusters.force_ahead))
        speeds.append(steady_speed(model, axis, force) if force > 1e-6 else _UNREACHED)
    fastest = min((s for s in speeds if 0 < s < np.inf), default=_UNREACHED)
    return -fastest, fastest


def parameter_table(comparison: Comparison, short: bool = False) -> Table:
    """Values with 95 % intervals where known, and differences from the first file.

    `short` is for narrow screens: half intervals, and no couplings.
    """
    files = comparison.files
    head = ["Parameter", "Unit", *(one.label for one in files)]
    head += _difference_heads(files)
    rows = []
    for name in comparison.rows:
        if short and is_coupling(name):
            continue
        values = [one.values.get(name) for one in files]
        unit = next(v.unit for v in values if v is not None)
        cells = ["-" if v is None else value_text(v, short) for v in values]
        rows.append([name, pretty(unit), *cells, *(difference_text(d.get(name)) for d in comparison.differences)])
    note = (
        f"Differences are from {files[0].label}; in brackets in standard deviations (sd) of the difference. "
        "A ~ says that only one of the files was identified; the other is taken as exact."
    )
    if short and any(map(is_coupling, comparison.rows)):
        note += " Couplings between directions are in the report and in --json."
    return Table("", head, rows, note)


def _difference_heads(files: Sequence[Any]) -> list[str]:
    return [f"{one.label} differs by" for one in files[1:]] if len(files) > 2 else ["Difference"]


def value_text(value: Any, short: bool = False) -> str:
    """`31.2 (28.9 to 33.8)`, or, for narrow screens, `31.2 ±7.9 %`."""
    shown, (low, high) = number(value.value), value.interval()
    if not np.isfinite(value.std):
        return shown
    if short:
        half = (high - low) / 2
        if value.positive and half > value.value:
            return f"{shown} ({between(low, high)})"
        return f"{shown} ±{percent(half / value.value) if value.positive else f'{half:.2g}'}"
    return f"{estimated(value.value, low, high)} ({between(low, high)})"


def difference_text(difference: Any) -> str:
    """`+12 % (2.1 sd)`."""
    if difference is None:
        return "-"
    relative, deviations = difference.relative, difference.deviations
    parts = []
    if np.isfinite(relative):
        parts.append(relative_text(relative))
    if np.isfinite(deviations):
        parts.append(f"({'' if difference.both else '~'}{deviations_text(deviations)})")
    return " ".join(parts) or "-"


def relative_text(share: float) -> str:
    """`+12 %`, `x 14` beyond ten times."""
    if abs(share) >= 10:
        return f"x {share + 1:.3g}"
    return f"{100 * share:+.0f} %" if abs(share) >= 0.095 else f"{round(100 * share, 1) + 0.0:+.1f} %"


def deviations_text(deviations: float) -> str:
    """`+2.1 sd`."""
    return f"{round(deviations, 1) + 0.0:+.1f} sd"


def force_table(comparison: Comparison, short: bool = False) -> Table:
    """Damping forces at some speeds, with 95 % intervals, or `short` half of them."""
    files = comparison.files
    rows = []
    for f in comparison.forces():
        i = DIRECTIONS.index(f.direction)
        cells = [_with_band(y, sorted(b), short) for y, b in zip(f.force, f.band, strict=True)]
        gaps = [
            (relative_text(y / f.force[0] - 1) if f.force[0] else "-")
            + (f" ({deviations_text(d)})" if np.isfinite(d) else "")
            for y, d in zip(f.force[1:], f.deviations[1:], strict=True)
        ]
        rows.append([f.direction, f"{f.speed:+.3g} {SPEED_UNITS[i]}", FORCE_UNITS[i], *cells, *gaps])
    head = ["Direction", "Speed", "Unit", *(one.label for one in files)]
    head += _difference_heads(files)
    note = (
        "Motion in one direction alone, over the speeds tested, or, where nobody tested, those that all vehicles reach."
    )
    return Table("", head, rows, note)


def _with_band(force: float, band: Sequence[float], short: bool) -> str:
    if not np.all(np.isfinite(band)):
        return number(force)
    if short and band[1] - band[0] <= 2 * abs(force):
        return f"{number(force)} ±{percent((band[1] - band[0]) / 2 / abs(force))}"
    return f"{estimated(force, *band)} ({between(*band)})"


def agreement(comparison: Comparison) -> list[str]:
    """A sentence per other file: whether it differs from the first by more than errors explain."""
    first, sentences = comparison.files[0].label, []
    for one, whole, differences in zip(
        comparison.files[1:], comparison.wholes, comparison.differences, strict=True
    ):  # fmt: skip
        if whole is None:
            sentences.append(f"{one.label} and {first}: neither says how well its values are known")
            continue
        differ = whole.chance < _AGREE
        chance = f"{percent(whole.chance)}" if whole.chance >= 1e-3 else "less than 0.1 %"
        far = sorted((n for n in differences if abs(differences[n].deviations) > _NOTABLE),
                     key=lambda n: -abs(differences[n].deviations))  # fmt: skip
        named = f"; beyond 3 sd: {', '.join(far[:6])}{' and more' if len(far) > 6 else ''}" if far else ""
        sentences.append(
            f"{one.label} {'differs from' if differ else 'agrees with'} {first} "
            f"{'by more than' if differ else 'within'} their errors: squared distance {whole.distance:.4g} where "
            f"{whole.count} is expected (chance {chance}){named}"
        )
    return sentences


def write_vehicle_comparison(comparison: Comparison, folder: Path, title: str = "") -> Path:
    """Write `report.html` and its figures as `figures/*.png` and `figures/*.svg`; the path of the page."""
    folder, files = Path(folder), comparison.files
    labels = [one.label for one in files]
    damping = save(
        figures.damping_figure(labels, comparison.curves), folder, "damping", "Damping against speed",
        "Motion in one direction at a time, over the speeds tested, or those that every vehicle reaches. Bands: 95 %, "
        "where a file was identified.",
    )  # fmt: skip
    thrust = save(
        figures.thrust_figure(labels, comparison.curves), folder, "thrust", "Thrust against command",
        "Steady force of one thruster of each group.",
    )  # fmt: skip
    added = save(
        figures.added_mass_figure(labels, comparison.curves), folder, "added_mass", "Added mass",
        "Diagonal of M_A, with 95 % intervals where a file was identified.",
    )  # fmt: skip
    identified = [one.label for one in files if one.covariance is not None]
    words = [
        f"Identified: {', '.join(identified) or 'none'}. Errors of the files are taken as independent; where two share "
        "a prior or a test, they differ by less than the standard deviations say."
    ]
    provenance = Table("", ["File", "Vehicle", "Parts", "Identified from"], [
        [one.label, f"{one.vehicle.name} ({one.vehicle.where})", fingerprint(one.vehicle.file), _evidence(one)]
        for one in files
    ])  # fmt: skip
    return write_page(
        folder / "report.html",
        "sections.html.j2",
        title=title or " / ".join(labels),
        verdict=_verdict(comparison),
        sections=[
            Section("forces", "Forces", items=[damping, force_table(comparison), thrust]),
            Section("parameters", "Parameters", words, (), [parameter_table(comparison), added]),
            Section("files", "Files", items=[provenance]),
        ],
    )


def _verdict(comparison: Comparison) -> Verdict:
    known = [w for w in comparison.wholes if w is not None]
    good = all(w.chance >= _AGREE for w in known) if known else None
    count = len(comparison.files)
    headline = f"{count} vehicle files side by side"
    if good is not None:
        headline = "They agree within their errors" if good else "They differ by more than their errors"
    return Verdict(good, headline, [f"{line}." for line in agreement(comparison)], [])


def _evidence(one: Any) -> str:
    found = one.vehicle.file.identified
    return "-" if found is None else "; ".join(found.estimate.evidence) or "no test"
