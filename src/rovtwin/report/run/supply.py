"""Figures of what ties a vehicle to the world above: tethers and the charge of its batteries."""

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from rovtwin.report.flight import Flight
from rovtwin.report.parts.panels import panels
from rovtwin.report.parts.style import GREY, limits, line, series_colours
from rovtwin.report.series import slow_mean

_DASHED = (0, (4, 2))


def tethers(flight: Flight) -> Figure:
    """Tension of each tether, and its length beside the distance from the anchor."""
    sheet = panels(flight, (("Tension [N]",), ("Paid out [m]",)), height=1.9)
    pull, length = sheet.axes[:, 0]
    shown = []
    for (name, series), colour in zip(flight.tethers.items(), series_colours(len(flight.tethers)), strict=True):
        sheet.entry(_label(name), color=colour, linewidth=1.1)
        line(pull, series.t, series["tension"], color=colour)
        shown.append(series["tension"])
        if "paid_out" in series.channel.fields:
            line(length, series.t, series["paid_out"], color=colour)
        if (found := _distance(flight, name)) is not None:
            line(length, *found, color=colour, linestyle=_DASHED, alpha=0.8)
    if any(_distance(flight, name) is not None for name in flight.tethers):
        sheet.entry("Distance from the anchor", color=GREY, linewidth=1.1, linestyle=_DASHED)
    pull.set_ylim(0.0, limits(*shown, np.zeros(1), share=1.0, least=0.01)[1])
    return sheet.done()


def _distance(flight: Flight, name: str) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]] | None:
    """Time and straight line from the anchor to the other end [m]; None without the tether's shape."""
    shape = flight.get(f"truth/tether_shape/{name}")
    if shape is None or shape.values.shape[1] < 6:
        return None
    return shape.t, np.linalg.norm(shape.values[:, -3:] - shape.values[:, :3], axis=1)


def batteries(flight: Flight) -> Figure:
    """Charge of each battery, and the power drawn from it."""
    sheet = panels(flight, (("Charge [%]",), ("Power [W]",)), height=1.9)
    charge, power = sheet.axes[:, 0]
    drawn = flight["truth/battery"]
    for (name, (t, left)), colour in zip(flight.charges.items(), series_colours(len(flight.charges)), strict=True):
        sheet.entry(_label(name), color=colour, linewidth=1.1)
        line(charge, t, 100 * left, color=colour)
        if f"{name}_power" in drawn.channel.fields:
            mean = slow_mean(t, drawn[f"{name}_power"][:, None], window=10.0)[:, 0]
            line(power, t, mean, color=colour)
    charge.set_ylim(-3, 103)
    return sheet.done()


def about_tethers(flight: Flight) -> str:
    """The largest tension of all, whose and when, in a sentence."""
    peaks = [
        (float(np.nanmax(series["tension"])), float(series.t[np.nanargmax(series["tension"])]), name)
        for name, series in flight.tethers.items()
        if np.isfinite(series["tension"]).any()
    ]
    if not peaks:
        return ""
    tension, t, name = max(peaks)
    size = f"{tension:.3g} N" if tension >= 0.01 else "below 0.01 N"
    return f"Largest tether tension: {size}, {_label(name)} at {t:.0f} s."


def about_batteries(flight: Flight) -> str:
    """What is left in each battery at the end, in a sentence."""
    left = {name: charge[np.isfinite(charge)] for name, (_, charge) in flight.charges.items()}
    words = [f"{_label(name)} {100 * charge[-1]:.0f} %" for name, charge in left.items() if len(charge)]
    return f"Left at the end: {', '.join(words)}." if words else ""


def _label(name: str) -> str:
    return name.replace("_", " ")
