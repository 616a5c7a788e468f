"""From observations to positions: filter, smoother, the thesis's observer, each frame by itself."""
