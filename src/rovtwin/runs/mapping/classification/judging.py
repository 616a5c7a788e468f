"""How good the map is: against the scene of a simulation, and by check points of people who were there."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.imaging.lines import LinesFile
from rovtwin.mapping.classes.accuracy import Adjusted, Confusion, adjusted, counted
from rovtwin.runs.mapping.classification.places import read_places
from rovtwin.runs.mapping.classification.refusals import MIXED_NAME, OTHER, OUTSIDE_NAME
from rovtwin.runs.mapping.classification.sources import Prepared
from rovtwin.runs.mapping.classification.work import NOT_SEEN, OUTSIDE, Classified
from rovtwin.simulation.imager.ground import Ground
from rovtwin.simulation.scene import Scene, scene_from_dict

_CELLS = 8000  # of which the truth is looked up
_WITHIN = 0.25  # of a cell: where within it, to each side


@dataclass(frozen=True)
class Truth:
    """Of a scene.

    Attributes:
        confusion: Cells by the map and by what there is most of in them.
        share: Of the cells with a number, by class, then of none: what was estimated for all of them, and the mean
            difference of some.
        sd: Of it, as some stand for all.
    """

    confusion: Confusion
    share: Float[np.ndarray, " class"]
    sd: Float[np.ndarray, " class"]


@dataclass(frozen=True)
class Checked:
    """By check points.

    Attributes:
        confusion: Of them.
        areas: By them.
        unseen: Points on cells without a class.
    """

    confusion: Confusion
    areas: Adjusted
    unseen: int


def scene_of(path: Path) -> Scene:
    """What a simulation showed the imager.

    Raises:
        ConfigError: The file knows no truth.
        LogError: It cannot be read.
    """
    with LinesFile(path) as lines:
        truth = lines.truth
    scene = None if truth is None else scene_from_dict(yaml.safe_load(truth.scene), f"{path.name}: its scene")
    if scene is None or scene.floor is None:
        raise ConfigError(f"--truth {path}: knows no scene with a floor; expected lines of `rovtwin scan`")
    return scene


def against_scene(found: Classified, scene: Scene) -> Truth:
    """Of some cells, four places in each."""
    prepared, value = found.prepared, found.layers.value
    grid, ground = prepared.ground.grid, Ground(scene, prepared.wavelengths)
    rows, columns = np.nonzero(value != NOT_SEEN)
    some = np.random.default_rng(2).choice(len(rows), min(_CELLS, len(rows)), replace=False)
    rows, columns = rows[some], columns[some]
    kinds = (*found.names, OUTSIDE_NAME)
    share = np.zeros((len(rows), len(kinds)))
    of = [kinds.index(name if name in found.names else OUTSIDE_NAME) for name in ground.materials]
    for dx in (-_WITHIN, _WITHIN):
        for dy in (-_WITHIN, _WITHIN):
            xy = np.column_stack([grid.x[columns] + dx * grid.cell, grid.y[rows] + dy * grid.cell])
            seen = ground.shares_from_above(prepared.ground.projection.to_place(xy)).astype(float)
            seen /= np.maximum(seen.sum(axis=1, keepdims=True), 1e-9)  # brightness is in them
            for k, row in enumerate(of):
                share[:, row] += 0.25 * seen[:, k]
    true = [kinds[k] for k in share.argmax(axis=1)]
    mapped = [found.mapped[k] for k in value[rows, columns]]
    outside, shares = value[rows, columns] == OUTSIDE, found.layers.share[rows, columns]
    named = value[rows, columns][:, None] == np.arange(1, len(found.names) + 1)  # by angle alone where without shares
    estimated = np.where(outside[:, None], 0.0, np.where(np.isnan(shares), named, shares))
    off = share - np.column_stack([estimated, outside])
    every = np.append(found.areas.unmixed, found.areas.outside)
    share = np.maximum(every + off.mean(axis=0), 0.0)  # the difference of some may be larger than a small area
    return Truth(counted(mapped, true, found.mapped), share, off.std(axis=0) / np.sqrt(len(rows)))


def by_points(found: Classified, path: Path) -> Checked:
    """Area by class from places whose class somebody saw.

    Raises:
        ConfigError: The file cannot be used, or names a class that is none.
    """
    prepared: Prepared = found.prepared
    places = read_places("--check", path, prepared.ground)
    if unknown := [one.name for one in places if one.name not in (*found.names, OTHER)]:
        raise ConfigError(
            f"--check {path}: found class '{unknown[0]}', expected some of {', '.join((*found.names, OTHER))}"
        )
    value = found.layers.value.reshape(-1)
    numbers = [int(value[int(prepared.ground.grid.number(one.xy))]) for one in places]
    seen = [k for k, number in enumerate(numbers) if number != NOT_SEEN]
    if not seen:
        raise ConfigError(f"--check {path}: none of its {len(places)} places lies on a cell that was classified")
    mapped, true = [found.mapped[numbers[k]] for k in seen], [places[k].name for k in seen]
    true = [OUTSIDE_NAME if name == OTHER else name for name in true]
    confusion = counted(mapped, true, found.mapped)
    return Checked(confusion, adjusted(confusion, found.weights, (MIXED_NAME,)), len(places) - len(seen))
