"""Who is in control: one browser at a time; the others watch, see who it is, and may ask."""

import time
from dataclasses import dataclass, field
from typing import Any

KEPT = 10.0  # a page that is loaded anew, or lost its network for a moment, finds its control again [s]


@dataclass
class Rights:
    """Browsers by the name that each has given itself, which it keeps when its page is loaded anew.

    Attributes:
        holder: Who is in control, or None.
        asked: Who would like to be, or None.
    """

    holder: str | None = None
    asked: str | None = None
    _here: dict[str, int] = field(default_factory=dict)
    _gone_at: float = 0.0

    def come(self, name: str) -> None:
        """A browser opened the page; the first one is in control."""
        self._here[name] = self._here.get(name, 0) + 1
        if self._free():
            self.holder = name

    def leave(self, name: str) -> bool:
        """A page was closed, or its network broke; whether it was in control."""
        self._here[name] = self._here.get(name, 1) - 1
        if self._here[name] > 0:
            return False
        del self._here[name]
        if self.asked == name:
            self.asked = None
        if self.holder == name:
            self._gone_at = time.monotonic()
            if self.asked is not None:
                self.holder, self.asked = self.asked, None
            return True
        return False

    def take(self, name: str) -> str:
        """Be in control, if nobody is, else ask who is; what came of it, for people."""
        if self.holder == name:
            return "you are in control"
        if self._free() or self.holder not in self._here:
            self.holder, self.asked = name, None
            return "you are in control now"
        self.asked = name
        return f"{self.holder} is in control and was asked"

    def give(self, name: str) -> None:
        """Who is in control hands it to who asked, or to nobody."""
        if self.holder == name:
            self.holder, self.asked = self.asked, None

    def refuse(self, name: str) -> None:
        """Who is in control keeps it."""
        if self.holder == name:
            self.asked = None

    def message(self, name: str) -> dict[str, Any]:
        """The message for a browser."""
        return {
            "kind": "rights",
            "you": name,
            "in_control": self.holder if self.holder in self._here else None,
            "asked": self.asked,
            "watchers": len(self._here),
            "may": self.holder == name,
        }

    def _free(self) -> bool:
        gone = self.holder not in self._here
        return self.holder is None or (gone and time.monotonic() - self._gone_at > KEPT)
