"""Tables beside photographs: `geo.txt` as OpenDroneMap reads it, and `reference.csv` for Metashape.

References: OpenDroneMap, docs, image geolocation files; Agisoft, Metashape manual, reference pane (yaw, pitch, roll).
"""

import csv
import io
import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from rovtwin.core.user_files.files import write_text
from rovtwin.imaging.photographs.tags import Shot


def write_tables(out: Path, names: list[str], shots: list[Shot], std: Float[np.ndarray, "n 6"] | None) -> None:
    """Write both.

    Args:
        out: Folder.
        names: Of the pictures.
        shots: What their tags say.
        std: Of roll, pitch and yaw in the last three columns [rad]; None where nothing is known.
    """
    rows = ["EPSG:4326"]
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(["label", "longitude", "latitude", "altitude", "yaw", "pitch", "roll", "xy_accuracy_m",
                     "z_accuracy_m", "yaw_accuracy_deg", "pitch_accuracy_deg", "roll_accuracy_deg", "utc"])  # fmt: skip
    for i, (name, shot) in enumerate(zip(names, shots, strict=True)):
        place = [f"{shot.longitude:.9f}", f"{shot.latitude:.9f}", f"{shot.altitude:.4f}"]
        angles = [f"{value:.4f}" for value in (shot.yaw, shot.pitch, shot.roll)]
        accuracy = []
        if shot.horizontal_std is not None and shot.vertical_std is not None:  # per axis, as both programs take it
            accuracy = [f"{shot.horizontal_std / math.sqrt(2):.4f}", f"{shot.vertical_std:.4f}"]
        rows.append(" ".join([name, *place, *angles, *accuracy]))
        turned = [""] * 3 if std is None else [f"{math.degrees(value):.4f}" for value in std[i, 5:2:-1]]
        writer.writerow([name, *place, *angles, *(accuracy or ["", ""]), *turned, f"{shot.time.astype('M8[ms]')}Z"])
    write_text(out / "geo.txt", "\n".join(rows) + "\n")
    write_text(out / "reference.csv", table.getvalue())
