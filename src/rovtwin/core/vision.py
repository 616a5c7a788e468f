"""OpenCV, which finds markers, bends pictures and calibrates lenses, comes with an extra."""

from typing import Any

from rovtwin.core.extras import imported


def opencv(what: str = "finding markers") -> Any:
    """OpenCV.

    Args:
        what: Needs it, for who has not installed it.

    Raises:
        ConfigError: It is not installed; says how to get it.
    """
    return imported("cv2", "vision", f"{what} by OpenCV")
