"""Consent to run the code that a scenario names: a file from elsewhere must not bring programs along unseen.

Consent stands in the environment, so that processes which this one starts have it too. It is given by whoever starts
the program: for all code, or for single addresses, as those are that come by `--set` or from Python.
"""

import os
import sys
from collections.abc import Iterator
from typing import Any

from rovtwin.core.errors import ConfigError

VARIABLE = "ROVTWIN_TRUST_CODE"
OPTION = "--trust-code"
ALL = "1"


def is_address(text: str) -> bool:
    """Whether a text has the form `package.module:Name`."""
    module, colon, name = text.partition(":")
    return bool(colon) and all(part.isidentifier() for part in f"{module}.{name}".split("."))


def consent() -> str:
    """What is consented to: `1` for all code, or addresses, separated by commas; "" for nothing."""
    return os.environ.get(VARIABLE, "").strip()


def consent_to(text: str) -> None:
    """Adds to what this process and those that it starts may run.

    Args:
        text: As `consent` gives it.
    """
    if ALL in (text, consent()):
        os.environ[VARIABLE] = ALL
    elif text:
        addresses = [*consent().split(","), *text.split(",")]
        os.environ[VARIABLE] = ",".join(dict.fromkeys(one.strip() for one in addresses if one.strip()))


def consent_to_addresses(value: Any) -> None:
    """Adds the addresses `package.module:Name` among the texts of nested lists and dictionaries."""
    consent_to(",".join(one for one in _texts(value) if is_address(one)))


def require(address: str, where: str) -> None:
    """That the code at an address may be run; before its module is imported, as importing runs it.

    Args:
        address: `package.module:Name`.
        where: Scenario and key that name it, for the message.

    Raises:
        ConfigError: Nobody consented, or it is Python's own, which has no blocks.
    """
    module = address.partition(":")[0]
    if module.partition(".")[0] in sys.stdlib_module_names:
        raise ConfigError(f"{where}: found {address}, a part of Python itself, expected a module of your own")
    given = [one.strip() for one in consent().split(",")]
    if ALL not in given and address not in given:
        raise ConfigError(
            f"{where}: names code, {address}, which would be run on this machine: a file runs code only with "
            f"your consent. Read the module {module} first; then rovtwin {OPTION} COMMAND .. (or the environment "
            f"variable {VARIABLE}=1) consents to all code that files name, {VARIABLE}={address} to this alone; what "
            "--set or Python names needs none"
        )


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for one in value.values():
            yield from _texts(one)
    elif isinstance(value, list | tuple):
        for one in value:
            yield from _texts(one)
