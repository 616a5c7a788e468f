"""The numbers of an identification as tables: pandas, xarray, and draws as ArviZ takes them.

pandas and xarray are an extra, imported where they are used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import require
from rovtwin.core.user_files.config import near
from rovtwin.identification.joint.model.couplings import place_of

if TYPE_CHECKING:
    import pandas
    import xarray

    from rovtwin.identification.result.identification import Identification

EXTRA = "notebook"
_SUMMARY = {"mean": "estimate", "sd": "sd", "low": "low_95", "high": "high_95"}
_SUMMARY |= {"prior_mean": "prior_mean", "prior_sd": "prior_sd", "verdict": "verdict"}
_ABOUT = {
    "mean": "estimate",
    "sd": "standard deviation, to first order",
    "low": "lower end of the 95 % interval",
    "high": "upper end of the 95 % interval",
    "prior_mean": "what was known before the tests",
    "prior_sd": "standard deviation of what was known before the tests, to first order",
    "verdict": "learnt, partly, prior only or contradicted",
    "start": "value where theta = 0",
}
_COORDINATE = "1 where the parameter is positive or a share, else that of the coordinate unit"


def by_parameter(result: Identification) -> dict[str, Float[np.ndarray, " n"]]:
    """By column; in the parameters' units but for theta and its like."""
    free, theta, prior = result.parameters.free, result.theta, result.prior
    ends = np.array([result.interval(p.name) for p in free]).reshape(-1, 2)
    return {
        "mean": result.parameters.values(theta),
        "sd": result.std * slopes(result, theta),
        "low": ends[:, 0],
        "high": ends[:, 1],
        "prior_mean": result.parameters.values(prior.mean),
        "prior_sd": np.sqrt(np.diag(prior.covariance)) * slopes(result, prior.mean),
        "verdict": np.array(result.verdicts, dtype=object),
        "start": np.array([p.base for p in free]),
        "theta": theta,
        "theta_sd": result.std,
        "prior_theta": prior.mean,
        "prior_theta_sd": np.sqrt(np.diag(prior.covariance)),
    }


def slopes(result: Identification, theta: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Change of each value by that of its coordinate."""
    values = result.parameters.values(theta)
    return np.array([p.slope(value) for p, value in zip(result.parameters.free, values, strict=True)])


def frame(result: Identification) -> pandas.DataFrame:
    """`by_parameter` with the unit in front, indexed by the parameters' names."""
    require("pandas", EXTRA, "a table of an identification")
    import pandas

    index = pandas.Index(result.parameters.names, name="parameter")
    return pandas.DataFrame({"unit": _units(result)} | by_parameter(result), index=index)


def summary(result: Identification, truth: Mapping[str, float] | None) -> pandas.DataFrame:
    """What people ask for first; see `Identification.summary`."""
    table = frame(result)
    table = table.drop(columns=[name for name in table if name not in ("unit", *_SUMMARY)]).rename(columns=_SUMMARY)
    if truth is not None:
        table["truth"] = truths(result, truth)
    return table


def truths(result: Identification, truth: Mapping[str, float] | None) -> Float[np.ndarray, " n"]:
    """True values in their units, NaN where none is known.

    Raises:
        IdentificationError: A name is that of no parameter.
    """
    names, truth = result.parameters.names, truth or {}
    for name in truth:
        if name not in names:
            raise IdentificationError(f"truth: '{name}' is no parameter of this result.{near(name, names)}")
    return np.array([float(truth.get(name, np.nan)) for name in names])


def chosen(result: Identification, patterns: Sequence[str]) -> list[int]:
    """Places of the parameters whose names fit a pattern; of all but couplings where there is none.

    Raises:
        IdentificationError: A pattern fits nothing.
    """
    names = result.parameters.names
    patterns = [patterns] if isinstance(patterns, str) else list(patterns)
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise IdentificationError(f"names: '{pattern}' fits no parameter of this result.{near(pattern, names)}")
    if patterns:
        return [i for i, name in enumerate(names) if any(fnmatchcase(name, pattern) for pattern in patterns)]
    return [i for i, name in enumerate(names) if place_of(name) is None] or list(range(len(names)))


def dataset(result: Identification) -> xarray.Dataset:
    """Everything over the dimensions `parameter` and `parameter_2`.

    `mean`, `sd`, `covariance` and their prior's like are in the units of the coordinate `unit`, widths to first order.
    `theta`, `theta_covariance` and their prior's like are the coordinates in which the distribution is normal: the
    logarithm over the start for what is positive.
    """
    require("xarray", EXTRA, "a data set of an identification")
    import xarray

    columns = by_parameter(result)
    here, before = slopes(result, result.theta), slopes(result, result.prior.mean)
    squares = {
        "covariance": result.covariance * np.outer(here, here),
        "theta_covariance": result.covariance,
        "prior_covariance": result.prior.covariance * np.outer(before, before),
        "prior_theta_covariance": result.prior.covariance,
    }
    variables: dict[str, Any] = {
        name: ("parameter", values, _attributes(name, "that of the coordinate unit"))
        for name, values in columns.items()
    }
    for name, values in squares.items():
        variables[name] = (("parameter", "parameter_2"), values, _attributes(name, "product of the two units"))
    names = result.parameters.names
    axes = {"parameter": names, "parameter_2": names, "unit": ("parameter", _units(result))}
    return xarray.Dataset(variables, axes, _about(result))


def draws(result: Identification, n: int, seed: int, chains: int) -> xarray.Dataset:
    """See `Identification.draws`."""
    require("xarray", EXTRA, "draws of an identification")
    import xarray

    for name, number in (("n", n), ("chains", chains)):
        if number < 1:
            raise IdentificationError(f"draws: {name}: found {number}, expected 1 or more")
    theta = result.sampled(n * chains, seed).reshape(chains, n, -1)
    variables = {
        p.name: (("chain", "draw"), np.asarray(p.value(theta[..., i])), {"units": p.unit})
        for i, p in enumerate(result.parameters.free)
    }
    return xarray.Dataset(
        variables, {"chain": np.arange(chains), "draw": np.arange(n)}, _about(result) | {"seed": seed}
    )


def _units(result: Identification) -> list[str]:
    return [p.unit for p in result.parameters.free]


def _attributes(name: str, units: str) -> dict[str, str]:
    if name == "verdict":
        return {"long_name": _ABOUT[name]}
    if "theta" in name:
        return {"long_name": name.replace("_", " "), "units": _COORDINATE}
    return {"long_name": _ABOUT.get(name, name.replace("_", " ")), "units": units}


def _about(result: Identification) -> dict[str, Any]:
    """Texts and numbers, which every format of a file takes as attributes."""
    return {
        "vehicle": result.vehicle.name,
        "logs": "; ".join(result.evidence),
        "rovtwin_version": result.version,
        "doubts": "; ".join(result.doubts),
    }
