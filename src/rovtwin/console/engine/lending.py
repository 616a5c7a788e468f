"""The vehicle lent to a commissioning: while it holds the vehicle, the engine lets go of it and commands nothing."""

import time
from pathlib import Path

from rovtwin.console.locks import is_locked

LENT = "lent"  # the engine's stage then
WHY = "a commissioning holds the vehicle: end it, or give the vehicle back in the view Commission"
LOOK = 0.5  # between two looks whether it is given back [s]


class Lending:
    """Whether the vehicle is lent.

    Attributes:
        lent: Whether it is.
    """

    def __init__(self, held: Path | None):
        """`held` is locked as long as a commissioning holds the vehicle; None: nothing ever does."""
        self._held, self._looked = held, 0.0
        self.lent = self.is_held

    @property
    def is_held(self) -> bool:
        """Whether a commissioning holds the vehicle."""
        return self._held is not None and is_locked(self._held)

    def lend(self) -> None:
        """From now on it is."""
        self.lent, self._looked = True, time.monotonic()

    def came_back(self) -> bool:
        """Whether it is free again, once; looked at now and then."""
        if not self.lent or time.monotonic() - self._looked < LOOK:
            return False
        self._looked = time.monotonic()
        self.lent = self.is_held
        return not self.lent
