"""What a mosaic lost of its pixels and cells, as remarks."""

import numpy as np
from jaxtyping import Float

from rovtwin.mapping.cells.masking import HIDDEN
from rovtwin.mapping.cells.mosaic import Joined


def losses(counts: dict[str, int], joined: Joined, pixels: int, wavelengths: Float[np.ndarray, " band"]) -> list[str]:
    """Of pixels, cells and bands; `pixels` is how many all lines that are used have."""
    remarks = _whole_bands(joined.masked, wavelengths)
    in_cells = float(np.nansum(joined.layers["coverage"][0], dtype=float))
    if (beyond := pixels - counts.get("missed", 0) - round(in_cells)) > 0:
        remarks.append(
            f"{beyond} pixels lie beyond the mosaic's edge, or see the floor from its back, and are left out"
        )
    seen = max(int(joined.seen.sum()), 1)
    if (without := int((joined.seen & ~np.isfinite(joined.rgb).all(-1)).sum()) / seen) > 0:
        why = "full counts, or more noise than signal" if counts.get("saturated") else "more noise than signal"
        remarks.append(f"{without:.1%} of the cells seen have no number in red, green or blue ({why}): hatched in the "
                       "report, transparent in rgb")  # fmt: skip
    if counts.get("saturated"):
        share = counts["saturated"] / max(counts["samples"], 1)
        remarks.append(f"{share:.2%} of the counts are full and masked")
    if counts.get("no_number"):
        share = counts["no_number"] / max(counts["samples"], 1)
        remarks.append(f"{share:.2%} of the radiances are no numbers and masked")
    if counts.get("missed"):
        remarks.append(f"{counts['missed']} pixels see no floor within reach")
    filled = int((joined.seen & ~joined.direct).sum())
    if filled:
        remarks.append(f"{filled} cells ({filled / max(int(joined.seen.sum()), 1):.1%}) between two lines are filled "
                       "from their neighbours; their coverage is 0")  # fmt: skip
    return remarks


def _whole_bands(masked: Float[np.ndarray, " band"], wavelengths: Float[np.ndarray, " band"]) -> list[str]:
    """Runs of bands that are masked in all cells."""
    edges = np.flatnonzero(np.diff(np.r_[False, masked >= 1.0, False].astype(int)))
    runs = [
        f"{wavelengths[a]:.0f} to {wavelengths[b - 1]:.0f} nm" for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    if not runs:
        return []
    return [f"bands masked whole, as noise hides {HIDDEN:.0%} of their cells or more: {', '.join(runs)}"]
