"""Packages that not everybody needs: they come with an extra of the installation."""

import importlib.util

from rovtwin.core.errors import ConfigError


def require(module: str, extra: str, why: str) -> None:
    """Raise a ConfigError with the command to run, where a package of an extra is missing.

    Args:
        module: Of the package, such as `xarray`.
        extra: That brings it.
        why: What needs it, for the message.
    """
    try:
        found = importlib.util.find_spec(module)
    except ModuleNotFoundError:  # of a parent package
        found = None
    if found is None:
        raise ConfigError(f"{why} needs {module}: pip install 'rovtwin[{extra}]'")
