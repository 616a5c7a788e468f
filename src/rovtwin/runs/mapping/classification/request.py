"""What is asked of a classification."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

VARIABILITY = 2.0  # root mean square angle between a spectrum of the library and one of its material on the site [deg]
DRAWS = 80


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
        draws: Of the errors of areas.
        seed: Of them.
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
