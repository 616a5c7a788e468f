"""Figures of lenses: residuals of a calibration, and what ignoring a flat port costs."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from rovtwin.vehicle.physics.camera import Lens

BLUE, RED, GREEN = "#1f5a87", "#c0392b", "#3a8a4d"
_SHOWN = (5.0, 3e3)  # errors of positions [mm]


def residual_figure(
    lens: Lens, points: Float[np.ndarray, "n 2"], residuals: Float[np.ndarray, "n 2"], magnified: float = 100.0
) -> Figure:
    """Residuals as arrows where they are, and how large they are from the middle outwards.

    Args:
        lens: As calibrated.
        points: Corners as found [px].
        residuals: Found minus predicted [px].
        magnified: How many times longer than they are they are drawn.
    """
    figure = Figure(figsize=(9.5, 3.9), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.75, 1])
    width, height = lens.size
    left.quiver(
        *points.T, *(magnified * residuals).T, angles="xy", scale_units="xy", scale=1.0, width=0.0018, color=BLUE
    )
    left.plot(*np.asarray(lens.principal), "+", color=RED, ms=12)
    left.set(
        xlim=(0, width), ylim=(height, 0), aspect="equal", xlabel="x [px]", ylabel="y [px]",
        title=f"residuals, {magnified:g} times; + principal point",
    )  # fmt: skip
    radius, size = np.linalg.norm(points - np.asarray(lens.principal), axis=1), np.linalg.norm(residuals, axis=1)
    rms = float(np.sqrt(np.mean(size**2)))
    right.plot(radius, size, ".", ms=3, alpha=0.5, color=BLUE)
    right.axhline(rms, color=RED, lw=1.2)
    right.set(xlabel="from principal point [px]", ylabel="residual [px]", title=f"rms {rms:.3f} px", ylim=(0, None))
    for axis in (left, right):
        axis.spines[["top", "right"]].set_visible(False)
    return figure


def port_figure(distance: Float[np.ndarray, " n"], error: Mapping[str, Float[np.ndarray, " n"]]) -> Figure:
    """Errors of positions against distance.

    Args:
        distance: From the camera to the markers [m].
        error: rms [m], by how the port is dealt with.
    """
    figure = Figure(figsize=(7.2, 4.2), layout="constrained")
    axis = figure.subplots()
    for (name, values), colour in zip(error.items(), (RED, BLUE, GREEN), strict=True):
        most = 1e3 * values.max()
        if most < _SHOWN[0]:
            name += f": below {max(most, 0.01):.2g} mm"
        axis.loglog(distance, 1e3 * values, color=colour, lw=2, label=name)
    axis.set(xlabel="distance to the markers [m]", ylabel="position error [mm]", ylim=_SHOWN)
    axis.set_xticks([0.5, 1, 2, 3, 5], ["0.5", "1", "2", "3", "5"])
    axis.minorticks_off()
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    axis.spines[["top", "right"]].set_visible(False)
    return figure
