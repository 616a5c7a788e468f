"""Packages that not everybody needs: they come with an extra of the installation."""

import importlib
import importlib.util
from typing import Any

from rovtwin.core.errors import ConfigError, RovtwinError


def installed(module: str) -> bool:
    """Whether a package is there, by its module such as `blueye.sdk`; it is not imported."""
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:  # of a parent package
        return False


def require(module: str, extra: str, why: str, error: type[RovtwinError] = ConfigError) -> None:
    """Raise an error with the command to run, where a package of an extra is missing.

    Args:
        module: Of the package, such as `xarray`.
        extra: That brings it.
        why: What needs it, for the message.
        error: To raise.
    """
    if not installed(module):
        raise error(f"{why} needs {module}: pip install 'rovtwin[{extra}]'")


def imported(module: str, extra: str, why: str, error: type[RovtwinError] = ConfigError) -> Any:
    """The module of an extra, for who needs it to go on.

    Raises:
        RovtwinError: It is missing, or cannot be imported; arguments as of `require`.
    """
    require(module, extra, why, error)
    try:
        return importlib.import_module(module)
    except ImportError as failed:  # installed, but not what it needs itself
        raise error(f"{why} needs {module}, which is installed but cannot be imported: {failed}") from failed
