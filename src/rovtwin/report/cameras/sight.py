"""What a camera saw and what came of it: a picture with its markers, and the track along one axis."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure

from rovtwin.report.parts.style import SERIES, SMALL, dress, line, new_figure, note


@dataclass(frozen=True)
class Seen:
    """A filmed run.

    Attributes:
        picture: One of its pictures, RGB, uint8.
        t: Times of the track [s].
        x: Its position north [m].
        velocity: Its velocity north [m/s].
        truth_t, truth_x: The truth [s], [m].
        rms: Of the track's error [m].
    """

    picture: UInt8[np.ndarray, "H W 3"]
    t: Float[np.ndarray, " n"]
    x: Float[np.ndarray, " n"]
    velocity: Float[np.ndarray, " n"]
    truth_t: Float[np.ndarray, " m"]
    truth_x: Float[np.ndarray, " m"]
    rms: float


def draw_seen(seen: Seen) -> Figure:
    """Picture on the left, position and velocity on the right."""
    figure = new_figure(height=3.4)
    panels = figure.subplot_mosaic([["picture", "x"], ["picture", "u"]], width_ratios=[1.6, 1.0])
    panels["picture"].imshow(seen.picture)
    panels["picture"].set_axis_off()
    dress(panels["x"], "North [m]", "")
    line(panels["x"], seen.truth_t, seen.truth_x, color="0.6", linewidth=3.0, label="truth")
    line(panels["x"], seen.t, seen.x, color=SERIES[0], label="track")
    note(panels["x"], f"error {1e3 * seen.rms:.1f} mm rms")
    panels["x"].legend(fontsize=SMALL, frameon=False, loc="upper left")
    dress(panels["u"], "Velocity north [m/s]", "Time [s]")
    truth = np.gradient(seen.truth_x, seen.truth_t)
    line(panels["u"], seen.truth_t, truth, color="0.6", linewidth=3.0)
    line(panels["u"], seen.t, seen.velocity, color=SERIES[0])
    return figure
