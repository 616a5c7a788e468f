"""Picture of how far a mosaic will be off, place by place: north up, east to the right."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.figure import Figure

from rovtwin.report.parts.style import BLACK, SMALL, dress, name_panel, new_figure


@dataclass(frozen=True, eq=False)
class MosaicPicture:
    """What the picture shows.

    Attributes:
        north: Of the cells' middles [m].
        east: The same.
        panels: Title and sigma of each [m], NaN where nothing is seen.
        area: A shapely MultiPolygon in the plane of n.
        points: The way [m].
        sees: Whether each leg is a line or a lap.
    """

    north: Float[np.ndarray, " rows"]
    east: Float[np.ndarray, " columns"]
    panels: list[tuple[str, Float[np.ndarray, "rows columns"]]]
    area: Any
    points: Float[np.ndarray, "n 2"]
    sees: Bool[np.ndarray, " legs"]


def draw_mosaic(picture: MosaicPicture) -> Figure:
    """One panel for each sigma, each with its own scale: what is common to all hides what differs."""
    size = float(picture.north[1] - picture.north[0]) if len(picture.north) > 1 else 1.0
    extent = (picture.east[0] - size / 2, picture.east[-1] + size / 2, picture.north[0] - size / 2,
              picture.north[-1] + size / 2)  # fmt: skip
    tall = (extent[3] - extent[2]) / max(extent[1] - extent[0], 1e-9)
    count = len(picture.panels)
    across = count if tall > 0.8 else 1
    down = -(-count // across)
    width = 6.9 / across
    figure = new_figure(height=float(np.clip(down * (0.72 * width * tall + 1.0), 2.4, 10.0)))
    axes = np.atleast_1d(figure.subplots(down, across, squeeze=False)).ravel()
    for one, (title, sigma) in zip(axes, picture.panels, strict=True):
        _panel(figure, one, picture, extent, title, 1e3 * sigma)
    return figure


def _panel(figure: Figure, axes: Any, picture: MosaicPicture, extent: Any, title: str, sigma: Any) -> None:
    low, high = np.nanpercentile(sigma, [1, 99]) if np.isfinite(sigma).any() else (0.0, 1.0)
    if high - low < 0.02 * high:  # a scale that would only show rounding
        low, high = 0.98 * low, 1.02 * high
    image = axes.imshow(sigma, origin="lower", extent=extent, cmap="viridis", vmin=low, vmax=high,
                        interpolation="nearest", zorder=1)  # fmt: skip
    dress(axes, "North [m]", "East [m]", ticks=6)
    legs = np.full((int(picture.sees.sum()), 3, 2), np.nan)
    legs[:, 0], legs[:, 1] = picture.points[:-1][picture.sees], picture.points[1:][picture.sees]
    axes.plot(*legs.reshape(-1, 2)[:, ::-1].T, color="white", linewidth=0.8, alpha=0.8, zorder=3)
    for part in picture.area.geoms:
        for ring in (part.exterior, *part.interiors):
            axes.plot(*np.asarray(ring.coords)[:, ::-1].T, color=BLACK, linewidth=1.2, zorder=4)
    axes.set_aspect("equal", adjustable="box")
    margin = 0.03 * max(extent[1] - extent[0], extent[3] - extent[2])
    axes.set(xlim=(extent[0] - margin, extent[1] + margin), ylim=(extent[2] - margin, extent[3] + margin))
    name_panel(axes, f"{title}\n{np.sqrt(np.nanmean(sigma**2)):.3g} mm rms")
    bar = figure.colorbar(image, ax=axes, fraction=0.046, pad=0.02)
    bar.set_label("Sigma [mm]", fontsize=SMALL)
    bar.ax.tick_params(labelsize=SMALL)
