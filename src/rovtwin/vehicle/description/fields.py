"""Values with a form of their own in vehicle files: what may be written, how it is checked, how editors see it.

Each is a list or mapping as YAML gives it, checked here and left as it is; `schema` names them as field types.
"""

import re
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float
from pydantic import AfterValidator, BeforeValidator, WithJsonSchema

from rovtwin.core.user_files.quantity import is_number

_NUMBER = {"type": "number"}
_ARRAY = {"type": "array", "items": _NUMBER}


def _numbers(value: Any, what: str, shapes: tuple[tuple[int, ...], ...], empty: bool = False) -> np.ndarray:
    """An array of one of the shapes; None becomes NaN where `empty` allows it."""
    expected = f"expected {what}"
    if not isinstance(value, list):
        raise ValueError(f"found {value!r}, {expected}")
    rows = value if all(isinstance(v, list) for v in value) else [value]
    for entry in (e for row in rows for e in row):
        if not (is_number(entry) or (empty and entry is None)):
            raise ValueError(f"found {entry!r} among the numbers, {expected}")
        if entry is not None and not np.isfinite(entry):
            raise ValueError(f"found {entry!r}, expected finite numbers")
    try:
        array = np.array(value, dtype=float)
    except ValueError:
        array = np.empty(0)
    if array.shape not in shapes:
        counts = f"{len(value)} rows" if rows is value else f"{len(value)} numbers"
        raise ValueError(f"found {counts}, {expected}")
    return array


def inertia_matrix(value: list) -> Float[np.ndarray, "3 3"]:
    """Tensor (3, 3) of [xx, yy, zz], [xx, yy, zz, xy, xz, yz] or the matrix itself.

    xy, xz, yz are the matrix's off-diagonal elements, I_xy = -sum(m x y); some CAD programs print them negated.
    """
    array = np.array(value, dtype=float)
    if array.shape == (3, 3):
        return array
    if array.shape == (3,):
        return np.diag(array)
    xx, yy, zz, xy, xz, yz = array
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _check_inertia(value: Any) -> Any:
    _numbers(value, "3 (xx, yy, zz), 6 (xx, yy, zz, xy, xz, yz) or 3x3 numbers [kg m2]", ((3,), (6,), (3, 3)))
    matrix = inertia_matrix(value)
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-9):
        raise ValueError("the matrix is not symmetric; write the same product of inertia on both sides")
    moments = np.linalg.eigvalsh(matrix)
    if moments[0] <= 0:
        raise ValueError(f"not positive definite: a principal moment is {moments[0]:.4g} kg m2, expected all above 0")
    if moments[2] > (moments[0] + moments[1]) * (1 + 1e-6):
        raise ValueError(
            f"no body has principal moments {', '.join(f'{m:.4g}' for m in moments)} kg m2: "
            "the largest exceeds the sum of the others"
        )
    return value


def _check_coefficients(value: Any) -> Any:
    what = "6 numbers (surge, sway, heave, roll, pitch, yaw; null: from the parts) or 6 rows of 6"
    array = _numbers(value, what, ((6,), (6, 6)), empty=True)
    if array.ndim == 2 and np.isnan(array).any():
        raise ValueError("null is for the list of 6 only; write all of a 6x6 matrix")
    diagonal = array if array.ndim == 1 else np.diag(array)
    if (diagonal < 0).any():
        names = [n for n, d in zip(("surge", "sway", "heave", "roll", "pitch", "yaw"), diagonal, strict=True) if d < 0]
        raise ValueError(f"negative for {', '.join(names)}; coefficients are written positive (X_u = -5 is 5)")
    return value


def _check_direction(value: Any) -> Any:
    if isinstance(value, dict):
        if set(value) - {"azimuth_deg", "elevation_deg"} or not all(is_number(v) for v in value.values()):
            raise ValueError(f"found {value!r}, expected {{azimuth_deg: .., elevation_deg: ..}}")
        return value
    if np.linalg.norm(_numbers(value, "a vector of 3 or {azimuth_deg, elevation_deg}", ((3,),))) < 1e-9:
        raise ValueError("a direction of length zero points nowhere")
    return value


def _check_force(value: Any) -> Any:
    if isinstance(value, dict):
        if set(value) != {"ahead", "astern"}:
            raise ValueError(f"found keys {sorted(map(str, value))}, expected 'ahead' and 'astern' [N]")
        numbers = list(value.values())
    else:
        numbers = [value]
    for number in numbers:
        if not is_number(number) or not np.isfinite(number):
            raise ValueError(f"found {number!r}, expected a force [N] or {{ahead: .., astern: ..}}")
        if number < 0:
            raise ValueError(f"found {number!r}, expected the size of the force, positive also astern")
    return value


def _check_buoyancy(value: Any) -> Any:
    if value != "neutral" and not (is_number(value) and np.isfinite(value) and value >= 0):
        raise ValueError(f"found {value!r}, expected a force [N] or 'neutral'")
    return value


def _check_table(value: Any) -> Any:
    what = "a CSV file, a list of CSV files (one per voltage), or a list of [command, force]"
    if isinstance(value, str):
        return value
    if isinstance(value, dict):
        if not value:
            raise ValueError(f"found {value!r}, expected {what}")
        for voltage, points in value.items():
            if not _is_voltage(voltage):
                raise ValueError(f"found key {voltage!r}, expected a voltage")
            _check_points(points, what)
    elif isinstance(value, list) and value and all(isinstance(v, str) for v in value):
        return value
    else:
        _check_points(value, what)
    return value


def _is_voltage(key: Any) -> bool:
    try:
        return bool(0 < float(key) < np.inf)
    except (TypeError, ValueError):
        return False


def _check_points(value: Any, what: str) -> None:
    if not isinstance(value, list) or len(value) < 3:
        raise ValueError(f"found {value!r:.60}, expected {what}, at least 3 points")
    points = _numbers(value, what, ((len(value), 2),))
    if (np.diff(points[:, 0]) <= 0).any() or points[0, 0] != -1 or points[-1, 0] != 1:
        raise ValueError("the commands of a table must increase from -1 to 1")


_LOG_NAME = re.compile(r"[A-Za-z]\w*", re.ASCII)


def _check_log_name(value: str) -> str:
    if not _LOG_NAME.fullmatch(value):
        raise ValueError(f"found {value!r}, expected a letter, then letters, digits and _: logs are named after it")
    return value


# Of thrusters and parts: their commands and forces are fields of log channels.
LogName = Annotated[
    str, AfterValidator(_check_log_name), WithJsonSchema({"type": "string", "pattern": f"^{_LOG_NAME.pattern}$"})
]
Inertia = Annotated[
    Any,
    BeforeValidator(_check_inertia),
    WithJsonSchema({"anyOf": [_ARRAY | {"minItems": 3, "maxItems": 6}, {"type": "array", "items": _ARRAY}]}),
]
Coefficients = Annotated[
    Any,
    BeforeValidator(_check_coefficients),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "array", "items": {"anyOf": [_NUMBER, {"type": "null"}]}, "minItems": 6, "maxItems": 6},
                {"type": "array", "items": _ARRAY | {"minItems": 6, "maxItems": 6}, "minItems": 6, "maxItems": 6},
            ]
        }
    ),
]
_VECTOR = _ARRAY | {"minItems": 3, "maxItems": 3}
_ANGLES = {
    "type": "object",
    "properties": {"azimuth_deg": _NUMBER, "elevation_deg": _NUMBER},
    "additionalProperties": False,
}
Direction = Annotated[Any, BeforeValidator(_check_direction), WithJsonSchema({"anyOf": [_VECTOR, _ANGLES]})]
_FORCES = {
    "type": "object",
    "properties": {"ahead": {"type": "number", "minimum": 0}, "astern": {"type": "number", "minimum": 0}},
    "required": ["ahead", "astern"],
    "additionalProperties": False,
}
Force = Annotated[
    Any, BeforeValidator(_check_force), WithJsonSchema({"anyOf": [{"type": "number", "minimum": 0}, _FORCES]})
]
Buoyancy = Annotated[Any, BeforeValidator(_check_buoyancy), WithJsonSchema({"anyOf": [_NUMBER, {"const": "neutral"}]})]
_POINTS = {"type": "array", "items": _ARRAY | {"minItems": 2, "maxItems": 2}, "minItems": 3}
Table = Annotated[
    Any,
    BeforeValidator(_check_table),
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "string"},
                {"type": "array", "items": {"type": "string"}, "minItems": 1},
                _POINTS,
                {"type": "object", "additionalProperties": _POINTS},
            ]
        }
    ),
]


def _check_colour(value: Any) -> Any:
    """`#rrggbb` as three shares; a list as it is."""
    if not isinstance(value, (str, list)) or (isinstance(value, str) and not re.fullmatch(_HEX, value)):
        raise ValueError(f"found {value!r}, expected a colour such as '#e6b800' or [0.9, 0.7, 0.0]")
    if isinstance(value, str):
        return [int(value[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    if len(value) != 3 or not all(is_number(v) and 0 <= v <= 1 for v in value):
        raise ValueError(f"found {value!r}, expected red, green and blue, each 0 to 1")
    return value


_HEX = "#[0-9a-fA-F]{6}"
Colour = Annotated[
    Any,
    BeforeValidator(_check_colour),
    WithJsonSchema({"anyOf": [{"type": "string", "pattern": f"^{_HEX}$"}, _VECTOR]}),
]
