"""What a saved identification holds: arrays by place, and words; and the identification made of them again."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.numerics import as_array, jax, jnp
from rovtwin.identification.diagnostics.validation import Prediction, Score
from rovtwin.identification.diagnostics.verdict import Blind
from rovtwin.identification.diagnostics.whiteness import Residuals
from rovtwin.identification.joint.estimate import Solution
from rovtwin.identification.joint.model.gaussian import Gaussian
from rovtwin.identification.joint.model.nodes import Nodes
from rovtwin.identification.joint.model.parameters import INFLOW, Parameter, Parameters
from rovtwin.identification.joint.solver.options import Options
from rovtwin.identification.joint.solver.problem import Noise, Unknowns
from rovtwin.identification.joint.uncertainty.unmodelled import Effects
from rovtwin.vehicle import Vehicle, vehicle_from_dict
from rovtwin.vehicle.description.files import with_meshes
from rovtwin.vehicle.description.schema import LearnedDiscrepancy
from rovtwin.vehicle.physics.discrepancy import Discrepancy, replace_discrepancy, without_discrepancy
from rovtwin.vehicle.physics.model import Model

if TYPE_CHECKING:
    from rovtwin.identification.result.identification import Identification

_PLAIN = ("findings", "seconds", "doubts", "version")  # fields that are words as they are
_SOLVED = ("converged", "steps", "cost", "stretches")  # of the solution
_SOLVED_ARRAYS = ("information", "offset_std", "widening")
_OF_EFFECTS = ("size", "covariance", "shift")
_LEARNED = "discrepancy."  # what leaves of the model begin with that it has only where something was learned
_SERIES = ("t", "measured", "predicted")
_folders: list[tempfile.TemporaryDirectory[str]] = []  # mesh files of what was loaded, for as long as the process runs


@dataclass(frozen=True, eq=False)
class Packed:
    """Arrays by `group/name`, of numbers, truths or text, and the rest as data for JSON."""

    arrays: dict[str, np.ndarray]
    words: dict[str, Any]


def packed(result: Identification) -> Packed:
    """All of a result but its `problem`."""
    free = result.parameters.free
    arrays = {
        "parameter": _texts(p.name for p in free),
        "unit": _texts(p.unit for p in free),
        "verdict": _texts(result.verdicts),
        **{key: np.array([getattr(p, key) for p in free]) for key in ("base", "positive", "bound")},
        "theta": result.theta,
        "covariance": result.covariance,
        "prior_theta": result.prior.mean,
        "prior_covariance": result.prior.covariance,
    }
    arrays |= {f"model/{name}": np.asarray(leaf) for name, leaf in _leaves(result.parameters.model).items()}
    vehicle, meshes = _vehicle_packed(result.vehicle)
    words = {key: getattr(result, key) for key in _PLAIN} | {
        "vehicle": vehicle,
        "groups": {group: list(rows) for group, rows in result.parameters.groups.items()},
        "blind": [asdict(b) for b in result.blind],
        # Without folders: a file that is passed on says nothing of the machine it was made on.
        "records": [r | {"source": Path(r["source"]).name} for r in result.records],
        "tested": result.tested,
        "offsets": result.offsets,
        "options": result.options.model_dump(mode="json"),
        "solution": None,
        "discrepancy": None if result.discrepancy is None else result.discrepancy.model_dump(mode="json"),
    }
    arrays |= meshes
    if result.solution is not None:
        words["solution"] = {key: getattr(result.solution, key) for key in _SOLVED}
        found = result.solution.effects
        words["effects"] = None if found is None else [list(found.names), list(found.units)]
        arrays |= _solution_packed(result.solution)
    for group in ("fitted", "held_out"):
        words[group] = [_prediction_packed(p, f"{group}/{k}/", arrays) for k, p in enumerate(getattr(result, group))]
    words["residuals"] = {
        name: _residuals_packed(r, f"residuals/{name}/", arrays) for name, r in result.residuals.items()
    }
    return Packed(arrays, words)


def unpacked(held: Packed, where: str) -> dict[str, Any]:
    """Fields of the result; `where` names its file.

    Raises:
        IdentificationError: The model has other arrays than in this version of rovtwin.
        ConfigError: The vehicle is none that this version of rovtwin can use.
    """
    a, words = held.arrays, held.words
    vehicle = _vehicle_unpacked(words["vehicle"], a, where)
    columns = [a[key].tolist() for key in ("parameter", "unit", "base", "positive", "bound")]
    free = tuple(Parameter(*row) for row in zip(*columns, strict=True))
    groups = {group: tuple(rows) for group, rows in words["groups"].items()}
    theta, covariance = a["theta"], a["covariance"]
    offsets = {name: np.array(value) for name, value in words["offsets"].items()}
    solved, learned = words["solution"], words.get("discrepancy")
    return {key: words[key] for key in _PLAIN} | {
        "vehicle": vehicle,
        "parameters": Parameters(_model_unpacked(vehicle, a, where), free, groups),
        "prior": Gaussian(a["prior_theta"], a["prior_covariance"]),
        "theta": theta,
        "covariance": covariance,
        "verdicts": a["verdict"].tolist(),
        "blind": [Blind(**b | {key: tuple(b[key]) for key in ("names", "weights")}) for b in words["blind"]],
        "records": words["records"],
        "tested": {name: tuple(ends) for name, ends in words["tested"].items()},
        "offsets": offsets,
        "options": Options.read(words["options"]),
        "discrepancy": None if learned is None else LearnedDiscrepancy.model_validate(learned),
        "solution": None if solved is None else _solution_unpacked(words, a, theta, covariance, offsets),
        **{
            group: [_prediction_unpacked(p, f"{group}/{k}/", a) for k, p in enumerate(words[group])]
            for group in ("fitted", "held_out")
        },
        "residuals": {name: _residuals_unpacked(r, f"residuals/{name}/", a) for name, r in words["residuals"].items()},
    }


def _texts(words: Any) -> np.ndarray:
    return np.array(list(words), dtype=object)


def _leaves(model: Model) -> dict[str, Any]:
    """Arrays of a model by the way to them, `thrusters.exponent`."""
    return {jax.tree_util.keystr(path).lstrip("."): leaf for path, leaf in jax.tree_util.tree_leaves_with_path(model)}


def _model_unpacked(vehicle: Vehicle, arrays: Mapping[str, np.ndarray], where: str) -> Model:
    """The starting model: of the vehicle's kind, with the arrays that were kept."""
    pattern = without_discrepancy(vehicle.model())
    lost = jnp.zeros(pattern.thrusters.count) if f"model/thrusters.{INFLOW}" in arrays else None
    pattern = pattern.replace(thrusters=replace(pattern.thrusters, inflow_loss=lost))
    names = _leaves(pattern)
    held = {place.removeprefix("model/"): array for place, array in arrays.items() if place.startswith("model/")}
    learned = {name.removeprefix(_LEARNED): x for name, x in held.items() if name.startswith(_LEARNED)}
    kept = {name for name in held if not name.startswith(_LEARNED)}
    if differing := sorted(kept ^ names.keys()):
        raise IdentificationError(
            f"{where}: model: found arrays {', '.join(sorted(kept))}, expected those of this rovtwin, which differ in "
            f"{', '.join(differing)}; read the file with the rovtwin that wrote it, or run rovtwin identify again"
        )
    leaves = [as_array(held[name], np.asarray(leaf).dtype) for name, leaf in names.items()]
    model: Model = jax.tree.unflatten(jax.tree.structure(pattern), leaves)
    if not learned:
        return model
    return replace_discrepancy(model, Discrepancy(**{name: as_array(x) for name, x in learned.items()}))


def _vehicle_packed(vehicle: Vehicle) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The vehicle's data, and its mesh files by the numbers that these have in it.

    Raises:
        IdentificationError: A mesh file is no longer there.
    """
    meshes: dict[str, str] = {}
    data = with_meshes(vehicle.to_dict(), lambda file: meshes.setdefault(file, f"{len(meshes)}{Path(file).suffix}"))
    contents = {}
    for file, name in meshes.items():
        try:
            contents[f"meshes/{name}"] = np.frombuffer(Path(file).read_bytes(), np.uint8)
        except OSError as error:
            raise IdentificationError(
                f"{vehicle.where}: mesh: found no file {file} ({error.strerror}), expected it where it was when the "
                "vehicle was read; put it back"
            ) from None
    about = {"where": vehicle.where, "water_density": vehicle.water_density, "pairs_apart": vehicle.pairs_apart}
    return about | {"data": data}, contents


def _vehicle_unpacked(words: Mapping[str, Any], arrays: Mapping[str, np.ndarray], where: str) -> Vehicle:
    """The vehicle; its mesh files go to a folder of their own, since they are read from files."""
    data = words["data"]
    meshes = {place.removeprefix("meshes/"): value for place, value in arrays.items() if place.startswith("meshes/")}
    if meshes:
        _folders.append(tempfile.TemporaryDirectory(prefix="rovtwin_"))
        folder = Path(_folders[-1].name)
        for name, content in meshes.items():
            (folder / name).write_bytes(content.tobytes())
        data = with_meshes(data, lambda name: str(folder / name))
    vehicle = vehicle_from_dict(data, words["where"])
    return Vehicle(vehicle.file, words["where"], words["water_density"], words["pairs_apart"])


def _solution_packed(solution: Solution) -> dict[str, np.ndarray]:
    """Without theta, covariance and offsets, which are the result's."""
    found = {name: getattr(solution, name) for name in _SOLVED_ARRAYS}
    found |= {"sigma": solution.noise.sigma, "defect": solution.noise.defect}
    found |= {f"nodes_{name}": value for name, value in solution.unknowns.nodes._asdict().items()}
    if solution.effects is not None:
        found |= {f"effects_{key}": getattr(solution.effects, key) for key in _OF_EFFECTS}
    return {f"solution/{name}": np.asarray(value) for name, value in found.items()}


def _solution_unpacked(
    words: Mapping[str, Any],
    arrays: Mapping[str, np.ndarray],
    theta: Float[np.ndarray, " n"],
    covariance: Float[np.ndarray, "n n"],
    offsets: Mapping[str, Float[np.ndarray, " _"]],
) -> Solution:
    kept = {place.removeprefix("solution/"): x for place, x in arrays.items() if place.startswith("solution/")}
    nodes = Nodes(*(kept[f"nodes_{name}"] for name in Nodes._fields))
    every = np.concatenate(list(offsets.values())) if offsets else np.zeros(0)
    return Solution(
        unknowns=Unknowns(theta, every, nodes),
        noise=Noise(kept["sigma"], kept["defect"]),
        covariance=covariance,
        **{name: kept[name] for name in _SOLVED_ARRAYS},
        effects=_effects_unpacked(words.get("effects"), kept),
        **words["solution"],
    )


def _effects_unpacked(words: list[list[str]] | None, kept: Mapping[str, np.ndarray]) -> Effects | None:
    """None of files of before, which have no such words."""
    if words is None:
        return None
    names, units = words
    return Effects(tuple(names), tuple(units), *(kept[f"effects_{key}"] for key in _OF_EFFECTS))


def _prediction_packed(prediction: Prediction, place: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Its words; its series go to `arrays`."""
    for signal, series in prediction.readings.items():
        arrays |= {f"{place}{signal}/{name}": np.asarray(x) for name, x in zip(_SERIES, series, strict=True)}
    return {
        "record": prediction.record,
        "window": prediction.window,
        "signals": list(prediction.readings),
        "scores": {component: asdict(score) for component, score in prediction.scores.items()},
        "excited": prediction.excited,
    }


def _prediction_unpacked(words: Mapping[str, Any], place: str, arrays: Mapping[str, np.ndarray]) -> Prediction:
    def series(signal: str) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n k"], Float[np.ndarray, "n k"]]:
        t, measured, predicted = (arrays[f"{place}{signal}/{name}"] for name in _SERIES)
        return t, measured, predicted

    return Prediction(
        words["record"],
        words["window"],
        {signal: series(signal) for signal in words["signals"]},
        {component: Score(**score) for component, score in words["scores"].items()},
        words["excited"],
    )


def _residuals_packed(residuals: Residuals, place: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Its words; its series go to `arrays`."""
    held = {f.name: getattr(residuals, f.name) for f in fields(residuals)}
    arrays |= {place + name: value for name, value in held.items() if isinstance(value, np.ndarray)}
    return {name: value for name, value in held.items() if not isinstance(value, np.ndarray)}


def _residuals_unpacked(words: Mapping[str, Any], place: str, arrays: Mapping[str, np.ndarray]) -> Residuals:
    series: dict[str, Any] = {f.name: arrays[place + f.name] for f in fields(Residuals) if f.name not in words}
    return Residuals(**words, **series)
