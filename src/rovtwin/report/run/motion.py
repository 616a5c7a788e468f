"""Figures of the motion: pose, body velocity, and the distance to the commanded path."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from rovtwin.report.flight import POSES, VELOCITIES, Flight
from rovtwin.report.parts.panels import panels
from rovtwin.report.parts.style import BLACK, ESTIMATE, GREY, LIMIT, REFERENCE, TRUTH, limits, line, note
from rovtwin.report.series import beside, unwrapped

_STYLES = (
    ("truth", "Truth", TRUTH),
    ("autopilot", "Estimate", ESTIMATE),
    ("reference", "Reference", REFERENCE),
)
_POSE = (("North [m]", "Roll [deg]"), ("East [m]", "Pitch [deg]"), ("Depth [m]", "Heading [deg]"))
_SPEED = (("Surge $u$ [m/s]", "Roll rate $p$ [deg/s]"), ("Sway $v$ [m/s]", "Pitch rate $q$ [deg/s]"),
          ("Heave $w$ [m/s]", "Yaw rate $r$ [deg/s]"))  # fmt: skip


def pose(flight: Flight) -> Figure:
    """Each degree of freedom: reference, estimate and truth."""
    sheet = panels(flight, _POSE, height=1.5)
    shown = []
    for _, label, style in _STYLES:
        series = flight.get(_pose_channel(label))
        if series is not None:
            sheet.entry(label, **style)
            shown.append((label, series, style))
    base = shown[0][1] if shown else None
    for k, field in enumerate(POSES):
        axes = sheet.axes[k % 3, k // 3]
        drawn = []
        for _, series, style in shown:
            y = series[field]
            if k >= 3 and base is not None:
                y = np.degrees(beside(y, series.t, _turns(unwrapped(base[field])), base.t))
            line(axes, series.t, y, **style)
            drawn.append(y)
        if k >= 3:
            axes.set_ylim(*limits(*drawn, share=1.0, least=0.5))
    depth, heading = sheet.axes[2]
    depth.invert_yaxis()
    _heading_ticks(heading)
    return sheet.done()


def _pose_channel(label: str) -> str:
    return {"Truth": "truth/eta", "Estimate": "autopilot/eta", "Reference": "autopilot/reference"}[label]


def _turns(angle: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Unwrapped angles moved by whole turns to lie about zero."""
    middle = np.nanmedian(angle) if np.isfinite(angle).any() else 0.0
    return angle - 2 * np.pi * np.round(middle / (2 * np.pi))


def _heading_ticks(axes: Axes) -> None:
    low, high = axes.get_ylim()
    for step in (1, 2, 5, 10, 15, 30, 45, 90, 180, 360):
        if (high - low) / step <= 6 and (high - low) / step >= 2:
            axes.yaxis.set_major_locator(MultipleLocator(step))
            return


def velocity(flight: Flight) -> Figure:
    """Body velocities: estimate and truth, with the speed ahead that guidance asks for."""
    sheet = panels(flight, _SPEED, height=1.35)
    for source, label, style in _STYLES[:2]:
        series = flight.get(f"{source}/nu")
        if series is None:
            continue
        sheet.entry(label, **style)
        for k, field in enumerate(VELOCITIES):
            factor = 1.0 if k < 3 else 180 / np.pi
            line(sheet.axes[k % 3, k // 3], series.t, factor * series[field], **style)
    truth = flight.get("truth/nu") or flight.get("autopilot/nu")
    for k, field in enumerate(VELOCITIES if truth is not None else ()):
        assert truth is not None
        scaled = truth[field] * (1.0 if k < 3 else 180 / np.pi)
        estimate = flight.get("autopilot/nu")
        other = scaled if estimate is None else estimate[field] * (1.0 if k < 3 else 180 / np.pi)
        sheet.axes[k % 3, k // 3].set_ylim(*limits(scaled, other, share=0.9995, least=0.01))
    return sheet.done()


def tracking(flight: Flight) -> Figure:
    """Cross-track and depth error over time."""
    sheet = panels(flight, (("Cross-track error [m]",), ("Depth error [m]",)), height=1.9)
    across, down = sheet.axes[:, 0]
    _cross_track(across, flight)
    _depth_error(down, flight)
    return sheet.done()


def _cross_track(axes: Axes, flight: Flight) -> None:
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    found, where = flight.cross_track, "on legs"
    if found is not None and not np.isfinite(found[1]).any() and flight.station is not None:
        found, where = flight.station, "never on a leg"
        axes.set_ylabel("Distance to way-point [m]")
    if found is None:
        note(axes, "not in this log")
        return
    t, distance = found
    line(axes, t, distance, color=BLACK, linewidth=1.1)
    text = where
    if np.isfinite(distance).any():
        most = float(np.nanmax(np.abs(distance)))
        text = f"{where}: rms {np.sqrt(np.nanmean(distance**2)):.2f} m, largest {most:.2f} m"
        low, high = limits(distance, np.zeros(1), share=1.0, least=0.02)
        axes.set_ylim(0.0 if np.nanmin(distance) >= 0 else low, high)
    radii = {float(w["acceptance"]) for w in flight.waypoints if w.get("acceptance")}
    if len(radii) == 1:
        (radius,) = radii
        for side in (-radius, radius):
            axes.axhline(side, **LIMIT)
        text += f"; dashed: acceptance {radius:g} m"
    note(axes, text)


def _depth_error(axes: Axes, flight: Flight) -> None:
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    if (found := flight.depth_error) is None:
        note(axes, "not in this log")
        return
    t, error = found
    line(axes, t, error, color=BLACK, linewidth=1.1)
    later = error[(t > flight.first_dive_end) & np.isfinite(error)]
    if later.size:
        rms, most = np.sqrt(np.mean(later**2)), np.abs(later).max()
        note(axes, f"after the first dive: rms {rms:.3f} m, largest {most:.3f} m; positive: too deep")
        axes.set_ylim(*limits(later, share=1.0, least=0.01, symmetric=True))
