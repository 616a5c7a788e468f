"""The panels of a body, coloured by the pressure of the water that it accelerates."""

import numpy as np
from jaxtyping import Float
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from rovtwin.report.parts.style import FONT, SMALL, TINY, new_figure

_WAYS = ("surge", "sway", "heave")


def surface_figure(
    corners: Float[np.ndarray, "m 4 3"], pressure: Float[np.ndarray, "m directions"], title: str = ""
) -> Figure:
    """One view for each translation.

    Args:
        corners: Of the panels in b [m].
        pressure: For unit acceleration in each direction [Pa s2/m].
        title: Above.
    """
    figure = new_figure(3.0)
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=FONT)
    # Drawn with z up: forward x, port -y, up -z is right-handed too.
    turned = corners * np.array([1.0, -1.0, -1.0])
    middle, half = 0.5 * (turned.min((0, 1)) + turned.max((0, 1))), 0.5 * float(np.ptp(turned, axis=(0, 1)).max())
    for i, way in enumerate(_WAYS):
        axes = figure.add_subplot(1, 3, i + 1, projection="3d")
        largest = max(float(np.abs(pressure[:, i]).max()), 1e-12)
        colours = ScalarMappable(TwoSlopeNorm(0.0, -largest, largest), "RdBu_r")
        faces = Poly3DCollection(list(turned), facecolors=colours.to_rgba(pressure[:, i]), edgecolors="#00000030")
        faces.set_linewidth(0.2)
        axes.add_collection3d(faces)
        axes.set(**{f"{k}lim": (middle[n] - half, middle[n] + half) for n, k in enumerate("xyz")})
        axes.set_box_aspect((1, 1, 1), zoom=1.25)  # type: ignore[arg-type]  (any number; its stub says int)
        axes.view_init(elev=24, azim=-52)
        axes.set_axis_off()
        axes.set_title(f"accelerated in {way}", fontsize=SMALL, pad=0)
        bar = figure.colorbar(colours, ax=axes, orientation="horizontal", shrink=0.7, pad=0.02, aspect=24)
        bar.ax.tick_params(labelsize=TINY)
        bar.set_label("pressure for 1 m/s² [Pa]", fontsize=TINY)
    return figure
