"""When a plan is rehearsed: at once where somebody asks for it, and again once it has stayed as it is for a moment."""

import math
from typing import Any

QUIET = 1.5  # a plan that is being changed is not rehearsed yet [s]


class Repetition:
    """Decides when a rehearsal is due.

    Attributes:
        again: Whether it is repeated by itself, once somebody has asked for the first.
        basis: What was rehearsed last, or is being rehearsed: plan and water; None: nothing.
    """

    def __init__(self) -> None:
        self.again = True
        self.basis: Any = None
        self._seen: Any = None
        self._since = -math.inf
        self._asked = False

    def ask(self) -> None:
        """It is due at once."""
        self._asked = True

    def due(self, basis: Any, now: float) -> bool:
        """Whether to begin now [s], with plan and water as they are."""
        if basis != self._seen:
            self._seen, self._since = basis, now
        repeats = self.again and self.basis is not None and basis != self.basis
        if not self._asked and not (repeats and now - self._since >= QUIET):
            return False
        self._asked, self.basis = False, basis
        return True
