"""Figures of the observer: errors within their bands, and whether it is as sure as it may be (NEES, NIS)."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator
from scipy.special import chdtri

from rovtwin.report.flight import Flight
from rovtwin.report.parts.panels import panels
from rovtwin.report.parts.style import BAND, BLACK, GREY, ORANGE, limits, line, name_panel, note

_ERRORS = (
    ("North [m]", "East [m]", "Depth [m]"),
    ("Roll [deg]", "Pitch [deg]", "Heading [deg]"),
    ("Surge [m/s]", "Sway [m/s]", "Heave [m/s]"),
    ("Roll rate [deg/s]", "Pitch rate [deg/s]", "Yaw rate [deg/s]"),
)
_NEES = {"position": (2, "position (2 dof)"), "pose_velocity": (12, "pose, velocity (12 dof)")}
_EXPECTED: dict[str, Any] = {"color": ORANGE, "linewidth": 1.0, "linestyle": (0, (4, 2)), "zorder": 5}


def errors(flight: Flight) -> Figure:
    """Estimate minus truth with the observer's own 3-sigma band."""
    sheet = panels(flight, _ERRORS, height=1.3, shaded=False)
    assert flight.error is not None
    t, error = flight.error
    std = flight.get("autopilot/std")
    sheet.entry("Estimate − truth", color=BLACK, linewidth=1.0)
    if std is not None:
        sheet.entry("±3σ of the observer", **(BAND | {"linewidth": 7.0}))
    for k in range(12):
        factor = 180 / np.pi if k // 3 in (1, 3) else 1.0
        axes, e = sheet.axes[k // 3, k % 3], factor * error[:, k]
        line(axes, t, e, color=BLACK, linewidth=0.7, points=900)
        text = f"rms {_short(np.sqrt(np.nanmean(e**2)))}" if np.isfinite(e).any() else "no truth at these times"
        later = t > t[0] + 0.02 * (t[-1] - t[0])
        shown = [e[later]]
        if std is not None:
            band = 3 * factor * np.interp(t, std.t, std.values[:, k])
            pick = np.unique(np.linspace(0, len(t) - 1, 700).astype(int))
            axes.fill_between(t[pick], -band[pick], band[pick], **BAND)
            shown.append(np.r_[band[later], -band[later]])
            text += f", {_percent(_share(np.abs(e) <= band, e))} within 3σ"
        note(axes, text)
        axes.set_ylim(*limits(*shown, share=0.998, least=1e-6, symmetric=True))
    return sheet.done()


def _short(value: float) -> str:
    return f"{value:.2g}" if 1e-4 <= value < 100 else f"{value:.1e}"


def _percent(share: float) -> str:
    """A share such that 99.7 % and all of it read differently."""
    return f"{100 * share:.1f} %" if 0.99 <= share < 1 else f"{100 * share:.0f} %"


def _share(hits: Bool[np.ndarray, "..."], values: Float[np.ndarray, "..."]) -> float:
    known = np.isfinite(values)
    return float(hits[known].mean()) if known.any() else float("nan")


def consistency(flight: Flight) -> Figure:
    """NEES against truth, and NIS of each sensor, with the 95 % range that chi-square gives to an honest observer."""
    nees, sensors = flight.get("score/nees"), _nis_sensors(flight)
    fields = [f for f in (nees.channel.fields if nees is not None else ()) if f in _NEES]
    labels = ["NEES [-]"] * len(fields) + ["NIS per dof [-]"] * len(sensors)
    rows = [labels[i : i + 2] for i in range(0, len(labels), 2)]
    odd = len(labels) % 2 == 1 and len(labels) > 1
    if odd:
        rows[-1].append("")
    sheet = panels(flight, rows, height=1.4, shaded=False)
    flat: list[Axes] = list(sheet.axes.ravel())
    if odd:
        sheet.figure.delaxes(flat[-1])
        flat[-3].tick_params(labelbottom=True)
    for axes, field in zip(flat, fields, strict=False):
        assert nees is not None
        _nees(axes, nees.t, nees[field], *_NEES[field])
    for axes, (name, totals, counts) in zip(flat[len(fields) :], sensors, strict=False):
        _nis(axes, flight["autopilot/nis"].t, totals, counts)
        name_panel(axes, name)
    sheet.entry("at one time", color=GREY, linewidth=0.8)
    sheet.entry("mean over a window", color=BLACK, linewidth=1.3)
    sheet.entry("expected", **_EXPECTED)
    sheet.entry("95 % range (χ²)", **(BAND | {"linewidth": 7.0}))
    return sheet.done()


def chi_square_range(
    freedom: Any, share: float = 0.95
) -> tuple[Float[np.ndarray, "*axes"], Float[np.ndarray, "*axes"]]:
    """Central range of a chi-square distribution that holds `share` of it."""
    tail = (1 - share) / 2
    return chdtri(freedom, 1 - tail), chdtri(freedom, tail)


def _nees(axes: Axes, t: Float[np.ndarray, " N"], values: Float[np.ndarray, " N"], freedom: int, name: str) -> None:
    low, high = (float(bound) for bound in chi_square_range(freedom))
    axes.axhspan(low, high, **BAND)
    axes.axhline(freedom, **_EXPECTED)
    positive = np.where(values > 0, values, np.nan)
    line(axes, t, positive, color=GREY, linewidth=0.6, points=1000)
    line(axes, t, _running_mean(t, values), color=BLACK, linewidth=1.3)
    _log_axis(axes, positive[t > t[0] + 0.02 * (t[-1] - t[0])], [low, high])
    name_panel(axes, name)
    finite = values[np.isfinite(values)]
    if finite.size:
        inside = float(np.mean((values >= low) & (values <= high)))
        text = f"mean {finite.mean():.3g}, {_percent(inside)} in range"
        note(axes, text + (", infinite at times" if np.isinf(values).any() else ""))


def _nis(
    axes: Axes,
    t: Float[np.ndarray, " N"],
    totals: Float[np.ndarray, " N"],
    counts: Float[np.ndarray, " N"],
    window: float = 10.0,
) -> None:
    """NIS per scalar innovation in windows [s]; the range narrows with the number of innovations in a window."""
    cells = int(np.clip((t[-1] - t[0]) / window, 1, 150))
    edges = np.linspace(t[0], t[-1] + 1e-9, cells + 1)
    cell = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, cells - 1)
    total, count = np.bincount(cell, totals, cells), np.bincount(cell, counts, cells)
    some = count > 0
    middle = (edges[:-1] + edges[1:])[some] / 2
    ratio, n = total[some] / count[some], count[some]
    low, high = (bound / n for bound in chi_square_range(n))
    axes.fill_between(middle, low, high, **BAND)
    axes.axhline(1.0, **_EXPECTED)
    axes.plot(middle, np.where(ratio > 0, ratio, np.nan), color=BLACK, linewidth=1.2, marker=".", markersize=2.5)
    _log_axis(axes, ratio, [min(0.6, float(low.min())), max(1.7, float(high.max()))])
    note(axes, f"mean {total.sum() / count.sum():.3g}, expected 1")


def _nis_sensors(flight: Flight) -> list[tuple[str, Float[np.ndarray, " N"], Float[np.ndarray, " N"]]]:
    """Sensors that brought innovations: name, sums of NIS and numbers of innovations."""
    nis, freedom = flight.get("autopilot/nis"), flight.get("autopilot/nis_dof")
    if nis is None or freedom is None or nis.values.shape != freedom.values.shape:
        return []
    totals, counts = np.nan_to_num(nis.values), np.nan_to_num(freedom.values)
    fields = enumerate(nis.channel.fields)
    return [(name, totals[:, k], counts[:, k]) for k, name in fields if counts[:, k].sum() > 0]


def _running_mean(
    t: Float[np.ndarray, " N"], values: Float[np.ndarray, " N"], window: float = 60.0
) -> Float[np.ndarray, " N"]:
    """Mean over the window [s] before each time, NaN left out."""
    known = np.isfinite(values)
    total = np.r_[0.0, np.cumsum(np.where(known, values, 0.0))]
    number = np.r_[0, np.cumsum(known)]
    start = np.searchsorted(t, t - window)
    end = np.arange(1, len(t) + 1)
    count = number[end] - number[start]
    return np.where(count > 0, (total[end] - total[start]) / np.maximum(count, 1), np.nan)


def _log_axis(axes: Axes, values: Float[np.ndarray, "..."], also: list[float]) -> None:
    finite = values[np.isfinite(values) & (values > 0)]
    low, high = np.quantile(finite, [0.01, 0.999]) if finite.size else also
    low, high = min(low, *also) / 1.6, max(high, *also) * 1.6
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    wide = np.log10(high / low)
    steps = (1.0,) if wide > 2.2 else (1.0, 2.0, 5.0) if wide > 0.9 else (0.5, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0)
    ticks = [s * 10.0**k for k in range(-30, 31) for s in steps if low <= s * 10.0**k <= high]
    ticks = ticks[:: -(-len(ticks) // 6)] if len(ticks) > 6 else ticks
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter(FuncFormatter(_power))


def _power(value: float, _: int | None) -> str:
    return f"{value:g}" if 1e-3 <= value < 1e4 else f"$10^{{{np.log10(value):.0f}}}$"
