"""What is asked of a classification."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

from rovtwin.core.errors import ConfigError

VARIABILITY = 2.0  # root mean square angle between a spectrum of the library and one of its material on the site [deg]
DRAWS = 80
_FEWEST_DRAWS = 40  # of which 2.5 and 97.5 % can be taken
_WIDEST, _LARGEST = 30.0, 90.0  # of the variability and of limits [deg]


@dataclass(frozen=True)
class ClassifyRequest:
    """What is asked for.

    Attributes:
        library: CSV `wavelength,name1,name2,..` or an ENVI spectral library; None: the one made here, or with `train`
            none.
        classes: Of the library; empty: all of a file, `mapping.classes.library.USUAL` of the one made here.
        train: CSV of places on the mosaic whose spectra are classes: name,north,east[,radius] or
            name,latitude,longitude[,radius]; a name may come several times.
        check: CSV of places whose class somebody saw: name,north,east or name,latitude,longitude; `other` is none of
            the classes.
        truth: File of lines of a simulation, whose scene says what lies where.
        variability: How far spectra of one material lie apart, root mean square angle [deg].
        threshold: Limits of the angle by class, "" for all others [deg]; without one as errors and variability say.
        fixed_brightness: Whether spectra have their library's brightness; else each cell's is fitted.
        draws: Of the errors of areas, 40 or more; 0: none, so that intervals reach from nothing to all.
        seed: Of them.

    Raises:
        ConfigError: One of them is of another kind, or outside its range.
    """

    library: Path | None = None
    classes: tuple[str, ...] = ()
    train: Path | None = None
    check: Path | None = None
    truth: Path | None = None
    variability: float = VARIABILITY
    threshold: Mapping[str, float] = field(default_factory=dict)
    fixed_brightness: bool = False
    draws: int = DRAWS
    seed: int = 1

    def __post_init__(self) -> None:
        if isinstance(self.classes, str) or not all(isinstance(name, str) for name in self.classes):
            raise ConfigError(f"classes: found {self.classes!r}, expected several names, such as ('sand', 'kelp')")
        if not _is_number(self.variability) or not 0.0 <= self.variability <= _WIDEST:
            raise ConfigError(f"variability: found {self.variability!r}, expected 0 to {_WIDEST:g} deg")
        if not isinstance(self.threshold, Mapping):
            raise ConfigError(
                f"threshold: found {self.threshold!r}, expected degrees by class, such as {{'kelp': 9.0, '': 6.0}}"
            )
        for name, degrees in self.threshold.items():
            if not _is_number(degrees) or not 0.0 < degrees <= _LARGEST:
                raise ConfigError(
                    f"threshold of '{name}': found {degrees!r}, expected more than 0, at most {_LARGEST:g} deg"
                )
        if not _is_count(self.draws) or 0 < self.draws < _FEWEST_DRAWS:
            raise ConfigError(f"draws: found {self.draws!r}, expected 0, or {_FEWEST_DRAWS} or more")
        if not _is_count(self.seed):
            raise ConfigError(f"seed: found {self.seed!r}, expected a whole number of 0 or more")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
