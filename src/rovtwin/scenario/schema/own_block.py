"""A block of one's own in place of one of ours."""

import re
from typing import Any

from pydantic import Field, field_validator

from rovtwin.core.trust import is_address
from rovtwin.core.user_files.config import Strict

_ENTRY_POINT = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


class OwnBlock(Strict):
    """A Block, a class of Blocks or a function that makes one."""

    block: str = Field(default="", description="package.module:Name, or an entry point of rovtwin.blocks")
    settings: dict[str, Any] = Field(default_factory=dict, description="arguments to make it with")
    given: str = Field(default="", description="class of a block that was handed over in Python")

    @field_validator("block")
    @classmethod
    def _is_name(cls, value: str) -> str:
        return require_name(value)

    @property
    def is_own(self) -> bool:
        """Whether it names a block at all."""
        return bool(self.block or self.given)

    @property
    def label(self) -> str:
        """What it names."""
        return self.block or self.given


def require_name(value: str) -> str:
    """An address, the name of an entry point, or nothing; ValueError otherwise."""
    if value and not is_address(value) and not _ENTRY_POINT.fullmatch(value):
        raise ValueError(f"found {value!r}, expected package.module:Name, or the name of an entry point")
    return value


def by_short_form(value: Any) -> Any:
    """A text alone is the block's name."""
    return {"block": value} if isinstance(value, str) else value
