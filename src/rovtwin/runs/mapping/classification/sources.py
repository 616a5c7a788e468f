"""All that a classification starts from: bands, the library on them, noise and stated errors of the mosaic."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from rovtwin.core.errors import ConfigError, LogError
from rovtwin.mapping.change.channels import noise_of
from rovtwin.mapping.classes.angle import angle_between
from rovtwin.mapping.classes.library import USUAL, Library, common_bands, made_here, read_library, similarity
from rovtwin.mapping.classes.unmixing import Unmixing
from rovtwin.mapping.formats.envi import NO_DATA
from rovtwin.runs.mapping.classification.places import Ground, Place, read_places
from rovtwin.runs.mapping.classification.refusals import require_apart, require_independent, require_name
from rovtwin.runs.mapping.classification.request import ClassifyRequest
from rovtwin.runs.mapping.result import Mosaic

_SHARE = 0.9  # of the cells that must know a band for it to count
_FEWEST = 3  # bands
_SAMPLED = 50  # rows of which typical values are taken
_LEAST = np.radians(0.5)  # variability that a few training cells may say at least [rad]
ERRORS = ("height", "water", "lamps", "panel")  # a panel takes the place of the lamps
_FLOOR = 0.05  # reflectance that relative errors of uncertainty.csv refer to at least


@dataclass(frozen=True)
class Classes:
    """Spectra to classify by, on the bands that count.

    Attributes:
        names: Of the classes.
        spectra: Of them.
        variability: Of each, root mean square angle [rad].
        source: Of whom, for people.
        trained: Whether they are the mosaic's own.
    """

    names: tuple[str, ...]
    spectra: Float[np.ndarray, "class band"]
    variability: Float[np.ndarray, " class"]
    source: str
    trained: bool

    @cached_property
    def between(self) -> Float[np.ndarray, "class class"]:
        """Angles [rad]."""
        return similarity(self.spectra)


@dataclass(frozen=True)
class Prepared:
    """What is known before the cells are looked at.

    Attributes:
        mosaic: To classify.
        request: What is asked for.
        ground: Where its cells lie.
        classes: Library or training.
        bands: Numbers of the bands that count.
        noise: Standard deviation of a usual cell by band.
        scale: By which a cell's noise is larger.
        typical: Mean spectrum.
        errors: Relative standard deviations by what, over the bands, that all cells share.
        remarks: For people.
    """

    mosaic: Mosaic
    request: ClassifyRequest
    ground: Ground
    classes: Classes
    bands: Int[np.ndarray, " band"]
    noise: Float[np.ndarray, " band"]
    scale: Float[np.ndarray, "row column"]
    typical: Float[np.ndarray, " band"]
    errors: dict[str, Float[np.ndarray, " band"]]
    remarks: list[str] = field(default_factory=list)

    @property
    def wavelengths(self) -> Float[np.ndarray, " band"]:
        """Of the bands that count [nm]."""
        return self.mosaic.wavelengths[self.bands]

    @cached_property
    def common(self) -> Float[np.ndarray, " class"]:
        """Angle by which stated errors turn each class, root mean square [rad]."""
        E = self.classes.spectra
        turned = [angle_between(E, E * (1.0 + d)) ** 2 for d in self.errors.values()]
        return np.sqrt(np.sum(turned, axis=0)) if turned else np.zeros(len(E))

    @cached_property
    def unmixing(self) -> Unmixing:
        """Residuals are weighed by noise and what the library may be off by together."""
        v = float(np.median(self.classes.variability))
        weight = 1.0 / np.sqrt(self.noise**2 + (v * self.typical) ** 2)
        weight = weight / np.sqrt(np.mean(weight**2))
        return Unmixing(self.classes.spectra, self.noise, weight, not self.request.fixed_brightness)

    def cells(self, rows: slice) -> tuple[np.ndarray, np.ndarray]:
        """Spectra of rows, (cell, band), 0 where not known, and which are."""
        first, last = self.bands[0], self.bands[-1] + 1
        block = np.moveaxis(np.array(self.mosaic.cube[rows, first:last]), 1, 2)[:, :, self.bands - first]
        x = block.reshape(-1, len(self.bands))
        known = x != np.float32(NO_DATA)
        x[~known] = 0.0
        return x, known


def prepare(mosaic: Mosaic, request: ClassifyRequest) -> Prepared:
    """What a classification needs.

    Raises:
        ConfigError: Something that is asked for is not there, or does not go together.
        LogError: A file of the mosaic cannot be read.
    """
    _require_units(mosaic, request)
    ground = Ground.of(mosaic)
    share = mosaic.share_known()
    usable = share > _SHARE
    places = None if request.train is None else read_places("--train", request.train, ground)
    library, remarks = _library(request, places)
    spectra = None
    if library is not None:
        w, fwhm = mosaic.wavelengths, np.array(mosaic.about.get("fwhm_nm", np.zeros(len(mosaic.wavelengths))))
        spectra = library.resampled(w, fwhm)
        usable, words = _of_both(mosaic, library, usable, common_bands(spectra))
        remarks += words
    if usable.sum() < _FEWEST:
        raise ConfigError(
            f"{mosaic.folder}: {int(usable.sum())} bands are known in more than {_SHARE:.0%} of its cells, expected "
            f"{_FEWEST} or more"
        )
    bands = np.flatnonzero(usable)
    w = mosaic.wavelengths
    masked = int((share <= _SHARE).sum())
    remarks.append(
        f"classified by {len(bands)} of {len(w)} bands between {w[bands[0]]:.0f} and {w[bands[-1]]:.0f} nm"
        + (f"; {masked} are masked in {1.0 - _SHARE:.0%} of the cells or more" if masked else "")
    )
    noise, scale, typical, words = _noise(mosaic, bands)
    remarks += words
    classes, words = _classes(mosaic, request, library, spectra, places, bands)
    remarks += words
    require_apart(classes.source, classes.names, classes.spectra, _fewer(request))
    errors, words = ({}, []) if classes.trained else _errors(mosaic, bands)
    remarks += words
    if unknown := [name for name in request.threshold if name and name not in classes.names]:
        raise ConfigError(f"--threshold: found '{unknown[0]}', expected some of {', '.join(classes.names)}")
    prepared = Prepared(mosaic, request, ground, classes, bands, noise, scale, typical, errors, remarks)
    weighed = classes.spectra * prepared.unmixing.weight
    require_independent(classes.source, classes.names, weighed, _fewer(request))
    return prepared


def _fewer(request: ClassifyRequest) -> str:
    return "choose some with --classes" if request.train is None else "take its places out of the file"


def _require_units(mosaic: Mosaic, request: ClassifyRequest) -> None:
    if mosaic.about["quantity"] != "reflectance" and request.train is None:
        raise ConfigError(
            f"{mosaic.folder}: holds {mosaic.about['quantity']}, and a library has reflectances. Say --train "
            "places.csv (spectra of the mosaic itself), or map without --radiance"
        )
    if request.train is not None and request.classes:
        raise ConfigError(
            "--train, --classes: expected one of them: classes are those of the places. Take --classes out, and "
            "places that are not to count out of the file"
        )
    if request.train is not None and request.library is not None:
        raise ConfigError("--train, --library: expected one of them: classes are the mosaic's own, or a library's")


def _library(request: ClassifyRequest, places: list[Place] | None) -> tuple[Library | None, list[str]]:
    if places is not None:
        for row, place in enumerate(places, 2):
            require_name(f"--train {request.train}: row {row}", place.name)
        return None, []
    if request.library is not None:
        library = read_library(request.library)
        chosen = library.chosen(request.classes or library.names)
        for name in chosen.names:
            require_name(f"--library {request.library}", name)
        return chosen, []
    words = ["library: shapes made here, no measurements; of your site measure your own (--library, --train)"]
    return made_here().chosen(request.classes or USUAL), words


def _of_both(
    mosaic: Mosaic, library: Library, usable: np.ndarray, has: np.ndarray
) -> tuple[Float[np.ndarray, " band"], list[str]]:
    """Bands that mosaic and library have."""
    both = usable & has
    w, own = mosaic.wavelengths[usable], library.wavelengths
    if both.sum() < _FEWEST:
        mine = f"{w[0]:.0f} to {w[-1]:.0f} nm" if len(w) else "none"
        raise ConfigError(
            f"{library.source}: has {own[0]:.0f} to {own[-1]:.0f} nm, and the usable bands of {mosaic.folder} are "
            f"{mine}: they share {int(both.sum())} bands, expected {_FEWEST} or more"
        )
    lost = int((usable & ~has).sum())
    return both, [f"{lost} bands of the mosaic are not in {library.source} and left out"] if lost else []


def _noise(mosaic: Mosaic, bands: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """Of a usual cell by band, how much more each cell has, and the mean spectrum."""
    step = max(mosaic.shape[0] // _SAMPLED, 1)
    some = np.moveaxis(np.asarray(mosaic.cube[::step])[:, bands], 1, 2).reshape(-1, len(bands)).astype(float)
    some[some == np.float32(NO_DATA)] = np.nan
    some = some[np.isfinite(some).mean(axis=1) > 0.5]
    if not len(some):
        raise LogError(f"{mosaic.folder}: has no cell with a number in the bands that count")
    typical = np.nanmean(some, axis=0)
    layer = mosaic.layer("noise")
    stated = mosaic.budget("noise_of_a_pixel")
    if stated is not None and layer is not None and np.nanmax(layer, initial=0.0) > 0.0:
        shown = int(np.argmin(np.abs(mosaic.wavelengths[bands] - 550.0)))
        noise = stated[bands] * np.maximum(np.abs(typical), _FLOOR)
        usual = float(np.nanmedian(layer))
        return noise * usual / noise[shown], np.nan_to_num(layer / usual, nan=1.0), typical, []
    noise = noise_of(some[None])
    return noise, np.ones(mosaic.shape[:2], np.float32), typical, [
        "the mosaic states no noise: that between neighbouring bands is taken, alike for all cells"
    ]  # fmt: skip


def _errors(mosaic: Mosaic, bands: np.ndarray) -> tuple[dict[str, np.ndarray], list[str]]:
    found = {name: mosaic.budget(name, name == "panel") for name in ERRORS}
    errors = {name: d[bands] for name, d in found.items() if d is not None and np.nansum(np.abs(d[bands])) > 0.0}
    errors = {name: np.nan_to_num(d) for name, d in errors.items()}
    without = [name for name in ERRORS if name not in errors and name != ("lamps" if "panel" in errors else "panel")]
    words = f"the mosaic states no error of {', '.join(without)}: areas are as sure as if they were exact"
    return errors, [words] if without else []


def _classes(
    mosaic: Mosaic,
    request: ClassifyRequest,
    library: Library | None,
    spectra: np.ndarray | None,
    places: list[Place] | None,
    bands: np.ndarray,
) -> tuple[Classes, list[str]]:
    variability = float(np.radians(request.variability))
    if library is not None and spectra is not None:
        every = np.full(len(library.names), variability)
        return Classes(library.names, spectra[:, bands], every, library.source, False), []
    assert places is not None
    return _trained(mosaic, places, bands, variability)


def _trained(mosaic: Mosaic, places: list[Place], bands: np.ndarray, variability: float) -> tuple[Classes, list[str]]:
    """Means of the places of each name; how far places of a name, or else their cells, lie from it."""
    names = tuple(dict.fromkeys(place.name for place in places))
    means, spread, single = [], [], []
    for name in names:
        of_places = []
        for place in (one for one in places if one.name == name):
            cells = mosaic.cells_about(float(place.xy[0]), float(place.xy[1]), place.radius)[:, bands]
            cells = cells[np.isfinite(cells).all(axis=1)]
            if not len(cells):
                raise ConfigError(
                    f"--train: {name}, place at x {place.xy[0]:.2f}, y {place.xy[1]:.2f}: no cell within "
                    f"{place.radius:g} m has all {len(bands)} bands that count; take another place, or a larger radius"
                )
            of_places.append(cells.mean(axis=0))
        mean = np.mean(of_places, axis=0)
        means.append(mean)
        off = angle_between(np.array(of_places), mean[None])
        n = len(of_places)
        spread.append(max(np.sqrt(np.sum(off**2) / (n - 1)), _LEAST) if n > 1 else variability)
        single += [name] if n == 1 else []
    words = ["classes are spectra of the mosaic itself: errors of height, water and lamps that all cells share cancel"]
    if single:
        words.append(f"one place alone for {', '.join(single)}: variability taken as {np.degrees(variability):.1f} deg")
    return Classes(names, np.array(means), np.array(spread), "training places", True), words
