"""OpenCV, which finds markers, bends pictures and calibrates lenses, comes with an extra."""

from typing import Any

from rovtwin.core.errors import ConfigError


def opencv(what: str = "finding markers") -> Any:
    """OpenCV.

    Args:
        what: Needs it, for who has not installed it.

    Raises:
        ConfigError: It is not installed; says how to get it.
    """
    try:
        import cv2
    except ImportError as missing:
        raise ConfigError(f"{what} needs OpenCV: pip install 'rovtwin[vision]'") from missing
    return cv2
