"""What a vehicle file may say. A vehicle is a part made of parts; the same keys describe a screw and the whole.

Frames: every part has its own frame (x forward, y right, z down, origin wherever its author put it); `pose` places that
frame in its parent's. The outermost frame is the body frame b, its origin is CO. SI units; names ending in `_deg` are
degrees. Nothing here computes: see `assembly`.
"""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from rovtwin.core.config import Degrees3, NonNegative, Number, Positive, Share, Strict, Vector3

_NUMBER = {"type": "number"}
_ARRAY = {"type": "array", "items": _NUMBER}


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _numbers(value: Any, what: str, shapes: tuple[tuple[int, ...], ...], empty: bool = False) -> np.ndarray:
    """An array of one of the shapes; None becomes NaN where `empty` allows it."""
    expected = f"expected {what}"
    if not isinstance(value, list):
        raise ValueError(f"found {value!r}, {expected}")
    rows = value if all(isinstance(v, list) for v in value) else [value]
    for entry in (e for row in rows for e in row):
        if not (_is_number(entry) or (empty and entry is None)):
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


def inertia_matrix(value: list) -> np.ndarray:
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
        if set(value) - {"azimuth_deg", "elevation_deg"} or not all(_is_number(v) for v in value.values()):
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
        if not _is_number(number) or not np.isfinite(number):
            raise ValueError(f"found {number!r}, expected a force [N] or {{ahead: .., astern: ..}}")
        if number < 0:
            raise ValueError(f"found {number!r}, expected the size of the force, positive also astern")
    return value


def _check_buoyancy(value: Any) -> Any:
    if value != "neutral" and not (_is_number(value) and np.isfinite(value) and value >= 0):
        raise ValueError(f"found {value!r}, expected a force [N] or 'neutral'")
    return value


def _check_table(value: Any) -> Any:
    what = "a CSV file, a list of CSV files (one per voltage), or a list of [command, force]"
    if isinstance(value, str):
        return value
    if isinstance(value, dict):
        for points in value.values():
            _check_points(points, what)
    elif isinstance(value, list) and value and all(isinstance(v, str) for v in value):
        return value
    else:
        _check_points(value, what)
    return value


def _check_points(value: Any, what: str) -> None:
    if not isinstance(value, list) or len(value) < 3:
        raise ValueError(f"found {value!r:.60}, expected {what}, at least 3 points")
    points = _numbers(value, what, ((len(value), 2),))
    if (np.diff(points[:, 0]) <= 0).any() or points[0, 0] != -1 or points[-1, 0] != 1:
        raise ValueError("the commands of a table must increase from -1 to 1")


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
Source = Annotated[str | None, Field(description="where the values of this block come from")]


class Pose(Strict):
    """Where a part sits in its parent's frame."""

    position: Vector3 = Field([0.0, 0.0, 0.0], description="origin of the part in the parent's frame [m]")
    attitude_deg: Degrees3 = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw (zyx) of the part [deg]")


class Cylinder(Strict):
    """A circular cylinder along x."""

    radius: Positive = Field(description="[m]")
    length: Positive = Field(description="along x [m]")


class Shape(Strict):
    """A solid that stands for the part in the water: its volume, added mass and drag."""

    box: list[Positive] | None = Field(None, min_length=3, max_length=3, description="length, width, height [m]")
    cylinder: Cylinder | None = Field(None, description="circular, along x")
    sphere: Positive | None = Field(None, description="radius [m]")
    ellipsoid: list[Positive] | None = Field(None, min_length=3, max_length=3, description="semi-axes [m]")
    center: Vector3 = Field([0.0, 0.0, 0.0], description="centre of the shape in the part's frame [m]")
    attitude_deg: Degrees3 = Field([0.0, 0.0, 0.0], description="roll, pitch, yaw of the shape in the part's frame")
    drag_coefficient: list[NonNegative] | None = Field(
        None, min_length=3, max_length=3, description="C_D along x, y, z on the projected areas; else a usual value"
    )

    @model_validator(mode="after")
    def _one_kind(self) -> "Shape":
        kinds = [k for k in ("box", "cylinder", "sphere", "ellipsoid") if getattr(self, k) is not None]
        if len(kinds) != 1:
            raise ValueError(f"found {' and '.join(kinds) or 'none'}, expected one of box, cylinder, sphere, ellipsoid")
        return self


class Curve(Strict):
    """How the force follows the command, when it is not linear."""

    power: Positive | None = Field(None, description="force = F_max x^power; about 2 for a propeller")
    table: Table = Field(None, description="CSV of a bollard test, one per voltage, or [command, force] points")

    @model_validator(mode="after")
    def _one_kind(self) -> "Curve":
        if (self.power is None) == (self.table is None):
            raise ValueError("expected either 'power' or 'table' (or the word linear for the whole curve)")
        return self


class Thruster(Strict):
    """One thruster, or a pseudo-thruster that stands for several."""

    name: str
    position: Vector3 = Field([0.0, 0.0, 0.0], description="where the force acts, in the part's frame [m]")
    direction: Direction = Field(description="of the force for a positive command: a vector, or azimuth and elevation")
    force: Force = Field(None, description="at full command [N]: one number, or {ahead, astern}")
    curve: Literal["linear"] | Curve = Field("linear", description="linear, {power: n} or {table: ..}")
    dead_band: Annotated[Number, Field(ge=0, lt=1)] = Field(0.0, description="|command| without force")
    time_constant: NonNegative = Field(0.0, description="first-order lag of the force [s]")
    rate_limit: Positive | None = Field(None, description="largest rate of the force [N/s]")
    quantisation: NonNegative = Field(0.0, description="step to which commands are rounded")
    health: Share = Field(1.0, description="share of the force left: 1 sound, 0 dead")
    source: Source = None

    @model_validator(mode="after")
    def _force_or_table(self) -> "Thruster":
        tabulated = isinstance(self.curve, Curve) and self.curve.table is not None
        if tabulated and (self.force is not None or self.dead_band > 0):
            raise ValueError("a table says force and dead band itself: leave out 'force' and 'dead_band'")
        if not tabulated and self.force is None:
            raise ValueError("missing force (at full command [N]: one number, or {ahead, astern})")
        return self


class Camera(Strict):
    """A camera; attitude 0 looks along x with the image upright."""

    name: str
    pose: Pose = Field(default_factory=lambda: Pose.model_validate({}))
    resolution: list[int] | None = Field(None, min_length=2, max_length=2, description="width, height [px]")
    focal_length: list[Positive] = Field([1000.0, 1000.0], min_length=2, max_length=2, description="f_x, f_y [px]")
    principal_point: list[Number] | None = Field(None, min_length=2, max_length=2, description="c_x, c_y [px]")
    distortion: list[Number] = Field(
        [0.0] * 5, min_length=4, max_length=8, description="k_1, k_2, p_1, p_2, k_3 as in OpenCV"
    )
    source: Source = None


class Sensor(Strict):
    """Where a sensor sits; how well it measures is the scenario's business."""

    name: str
    kind: str = Field(description="position, pressure, imu, attitude, dvl, imager, ...")
    pose: Pose = Field(default_factory=lambda: Pose.model_validate({}))
    source: Source = None


class RigidBody(Strict):
    """Published or measured totals instead of the sum of the parts; what is left out comes from the parts."""

    mass: Positive | None = Field(None, description="in air [kg]")
    center_of_gravity: Vector3 | None = Field(None, description="[m]")
    inertia: Inertia = Field(None, description="about the centre of gravity [kg m2]")
    source: Source = None
    sources: dict[str, str] = {}


class Restoring(Strict):
    """Weight against buoyancy, instead of what the parts' volumes give."""

    buoyancy: Buoyancy = Field(None, description="[N], or neutral")
    net_buoyancy: Number | None = Field(None, description="buoyancy less weight, positive floats [N]")
    center_of_buoyancy: Vector3 | None = Field(None, description="[m]")
    metacentric_height: Number | None = Field(None, description="BG: how far CB is above CG, straight up [m]")
    source: Source = None
    sources: dict[str, str] = {}

    @model_validator(mode="after")
    def _no_contradiction(self) -> "Restoring":
        if self.buoyancy is not None and self.net_buoyancy is not None:
            raise ValueError("found buoyancy and net_buoyancy, expected one of them")
        if self.center_of_buoyancy is not None and self.metacentric_height is not None:
            raise ValueError("found center_of_buoyancy and metacentric_height, expected one of them")
        return self


class Hydrodynamics(Strict):
    """Published or measured totals, all about the part's origin and written positive.

    A list of 6 is the diagonal; null leaves that direction to the parts, a number replaces it with its couplings.
    """

    added_mass: Coefficients = Field(None, description="M_A: 6 or 6x6 [kg, kg m2]")
    linear_damping: Coefficients = Field(None, description="D_L, ahead and astern [N s/m, N m s/rad]")
    quadratic_damping: Coefficients = Field(None, description="D_Q, ahead and astern [N s2/m2, N m s2/rad2]")
    linear_damping_astern: Coefficients = Field(None, description="for negative velocities, where it differs")
    quadratic_damping_astern: Coefficients = Field(None, description="for negative velocities, where it differs")
    source: Source = None
    sources: dict[str, str] = {}


class Body(Strict):
    """What a part and a vehicle have in common."""

    description: str | None = None
    source: Source = None
    sources: dict[str, str] = Field({}, description="where values come from, by key")
    mass: Positive | None = Field(None, description="in air [kg]")
    center_of_gravity: Vector3 = Field([0.0, 0.0, 0.0], description="[m]")
    inertia: Inertia = Field(None, description="about its own CG [kg m2]; else that of the homogeneous shape, or none")
    volume: NonNegative | None = Field(None, description="displaced [m3]; else that of the shape, or none")
    center_of_buoyancy: Vector3 | None = Field(None, description="[m]; else the centre of the shape, or the origin")
    shape: Shape | None = None
    thrusters: list[Thruster] = []
    cameras: list[Camera] = []
    sensors: list[Sensor] = []
    parts: list["Part"] = []
    rigid_body: RigidBody | None = None
    restoring: Restoring | None = None
    hydrodynamics: Hydrodynamics | None = None
    water_density: Annotated[Number, Field(ge=900, le=1100)] | None = Field(
        None, description="of the water in which the given values hold [kg/m3]; else the parent's, or 1000"
    )
    supply_voltage: Annotated[Number, Field(gt=0, le=1000)] | None = Field(
        None, description="at which thrust tables are read [V]"
    )

    @model_validator(mode="after")
    def _distinct_names(self) -> "Body":
        for what in ("parts", "thrusters", "cameras", "sensors"):
            names = [item.name for item in getattr(self, what)]
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                raise ValueError(f"{what}: the name '{twice[0]}' is given twice; names must differ")
        return self


class Part(Body):
    """A part: its own description, or `part: <library name or file>`, placed by `pose`."""

    name: str
    part: str | None = Field(None, description="name of a library file, or path of a file, that describes the part")
    pose: Pose = Field(default_factory=lambda: Pose.model_validate({}))

    @model_validator(mode="after")
    def _own_or_file(self) -> "Part":
        if self.part is not None:
            also = sorted(self.model_fields_set - {"name", "part", "pose", "description", "source", "sources"})
            if also:
                raise ValueError(f"found 'part' and '{also[0]}': a part from a file is described there; keep one")
        return self


class VehicleFile(Body):
    """A vehicle file."""

    name: str
    description: str = Field(description="one line: what it is")


Body.model_rebuild()
Part.model_rebuild()
VehicleFile.model_rebuild()
