"""Packages that only campaigns need."""

from importlib.util import find_spec

from rovtwin.core.errors import ConfigError


def require(*modules: str) -> None:
    """ConfigError where a package of the extra `campaign` is missing."""
    missing = [name for name in modules if find_spec(name) is None]
    if missing:
        raise ConfigError(
            f"campaigns need {' and '.join(missing)}, which is not installed. Install the extra: pip install "
            "'rovtwin[campaign]'"
        )
