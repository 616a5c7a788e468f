"""The geometry library."""

from typing import Any

from rovtwin.core.extras import imported


def shapely_library() -> Any:
    """Shapely, or how to get it."""
    return imported("shapely", "survey", "a survey")
