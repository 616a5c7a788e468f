"""The geometry library."""

from typing import Any

from rovtwin.core.errors import ConfigError


def shapely_library() -> Any:
    """Shapely, or how to get it."""
    try:
        import shapely
    except ImportError as missing:
        raise ConfigError("surveys need shapely: pip install 'rovtwin[survey]'") from missing
    return shapely
