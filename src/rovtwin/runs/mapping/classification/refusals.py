"""Names and spectra that cannot be classes, each refused before a cell is looked at."""

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.mapping.classes.angle import angle_between
from rovtwin.mapping.classes.library import ALIKE

MIXED_NAME, OUTSIDE_NAME = "mixed", "not of this library"
OTHER = "other"  # in files of check points: none of the classes
RESERVED = (MIXED_NAME, OUTSIDE_NAME, OTHER)
MOST = 60  # classes: sets of them are the bits of 64, and a cell's class has 8 bits
_CONDITION = 1e7  # of the Gram matrix: the noise of usual mosaics makes shares uncertain by more than 1


def require_name(where: str, name: str) -> None:
    """A class has a name that stands for nothing else.

    Raises:
        ConfigError: It does not.
    """
    if name.casefold() in RESERVED:
        raise ConfigError(
            f"{where}: found a class '{name}', expected none of {', '.join(RESERVED)}, which the map itself uses. "
            "Rename it"
        )


def require_apart(source: str, names: tuple[str, ...], spectra: Float[np.ndarray, "class band"], fix: str) -> None:
    """Spectra that are not 0, no more than the bands can tell apart, no two of one shape.

    Args:
        source: Of whom, for people.
        names: Of the classes.
        spectra: Of them, on the bands that count.
        fix: How there are fewer of them.

    Raises:
        ConfigError: They are otherwise.
    """
    count, bands = spectra.shape
    if count > MOST or count >= bands:
        raise ConfigError(
            f"{source}: found {count} classes, expected at most {min(MOST, bands - 1)}, fewer than the {bands} bands "
            f"that count and no more than {MOST}: {fix}"
        )
    if dark := [name for name, row in zip(names, spectra, strict=True) if not np.any(row)]:
        raise ConfigError(
            f"{source}: {dark[0]} is 0 in all {bands} bands that count, and no angle to it exists. Leave it out, or "
            "give it the little that it reflects"
        )
    for k, name in enumerate(names[1:], 1):
        between = angle_between(spectra[:k], spectra[k])
        i = int(np.argmin(between))
        if between[i] < ALIKE:
            raise ConfigError(
                f"{source}: {names[i]} and {name} have spectra of one shape ({np.degrees(between[i]):.2f} deg apart), "
                f"which neither angle nor mixture tells apart. Join them, or leave one out: {fix}"
            )


def require_independent(
    source: str, names: tuple[str, ...], spectra: Float[np.ndarray, "class band"], fix: str
) -> None:
    """No spectrum is a mixture of the others, negative shares included.

    Args:
        source: Of whom, for people.
        names: Of the classes.
        spectra: Of them, weighed as residuals are.
        fix: How there are fewer of them.

    Raises:
        ConfigError: One is, or nearly: the condition number of the Gram matrix of unit spectra is too large.
    """
    unit = spectra / np.linalg.norm(spectra, axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(unit @ unit.T)
    condition = values[-1] / max(values[0], np.finfo(float).eps)
    if condition > _CONDITION:
        part = np.abs(vectors[:, 0])
        dependent = int(np.argmax(part))
        others = [name for k, name in enumerate(names) if k != dependent and part[k] > 0.1 * part[dependent]]
        raise ConfigError(
            f"{source}: the spectrum of {names[dependent]} is nearly a sum of multiples of {', '.join(others)} "
            f"(condition number {condition:.1e}, expected below {_CONDITION:.0e}), so that shares are undetermined. "
            f"Leave it or one of them out: {fix}"
        )
