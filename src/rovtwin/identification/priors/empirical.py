"""Eidsvik's empirical method: added mass and drag of a box-like ROV from its size and projected areas.

Strip theory with 2-D coefficients of rectangles, scaled to three dimensions by square prisms, and drag on projected
areas. It is a prior and never a result: panel methods and tests differ from it by a factor of 2, at worst of 10.

References: Eidsvik (2015), Identification of hydrodynamic parameters for remotely operated vehicles, NTNU, as the
thesis uses it (sec. 2.6.5, 3.3); coefficients DNV-RP-H103 (2011), tables A-1 and A-2, DNV-RP-C205 (2010), app. E, and
Blevins (1984), table 10-20.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.priors.outline import Outline
from rovtwin.identification.priors.widths import LogNormal, log_normals, widths_of
from rovtwin.vehicle.constants import AXES, FRESH_WATER

# Square prisms a x a x b along b, C_A on a^2 b, at b / a. DNV prints 0.13 at 6; Eidsvik's program, whose numbers these
# are to meet to the last digit, has 0.14.
_PRISM = np.array([[1, 0.68], [2, 0.36], [3, 0.24], [4, 0.19], [5, 0.15], [6, 0.14], [7, 0.11]])
# Rectangles, at thickness along the motion / width: C_A on pi (width / 2)^2, turning C_A on pi (longer side / 2)^4.
_RECTANGLE = np.array(
    [
        [0.1, 2.23, 0.147],
        [0.2, 1.98, 0.15],
        [0.5, 1.70, 0.15],
        [1.0, 1.51, 0.234],
        [2.0, 1.36, 0.15],
        [5.0, 1.21, 0.15],
        [10.0, 1.14, 0.125],
    ]
)
# Drag of rectangles and of square rods along their length, at length along the flow / width.
_DRAG_2D = np.array([[0.5, 2.5], [1.5, 1.8], [2.5, 1.4], [6.0, 0.89]])
_DRAG_3D = np.array(
    [[0, 1.25], [0.5, 1.25], [1, 1.15], [1.5, 0.97], [2, 0.87], [2.5, 0.90], [3, 0.93], [4, 0.95], [5, 0.95]]
)

LINEAR_SHARE = 0.16  # D_L / D_Q of the translations [m/s]; the thesis's (3.5) / (3.4)
DAMPING_RATIO = 0.025  # of roll and pitch, of critical

# Relative size within which the tables hold; beyond it a spline says anything.
_SLENDERNESS = (0.5, 7.0)
_ASPECT = (0.15, 6.5)


@dataclass(frozen=True)
class EmpiricalEstimate:
    """What the method says, medians of wide priors (see `priors`).

    Attributes:
        outline: What it was given of the vehicle.
        density: Of the water [kg/m3].
        added_mass: Surge to yaw [kg, kg m2].
        quadratic_damping: Surge to yaw [N s2/m2, N m s2/rad2].
        linear_damping: The same [N s/m, N m s/rad]; NaN in rotation where inertia and stiffness were not given.
        scaling: What strip theory was multiplied with.
        notes: Where the method is stretched, one line each.
    """

    outline: Outline
    density: float
    added_mass: Float[np.ndarray, "6"]
    quadratic_damping: Float[np.ndarray, "6"]
    linear_damping: Float[np.ndarray, "6"]
    scaling: float
    notes: tuple[str, ...] = ()

    def priors(self) -> dict[str, LogNormal]:
        """By name, `added_mass.surge`; as wide as `widths_of` says."""
        values = {
            "added_mass": self.added_mass,
            "linear_damping": self.linear_damping,
            "quadratic_damping": self.quadratic_damping,
        }
        return log_normals(values, widths_of("empirical"), "Eidsvik (2015), strips and prism")


def estimate(
    outline: Outline,
    density: float = FRESH_WATER,
    inertia: Float[np.ndarray, "2"] | None = None,
    stiffness: Float[np.ndarray, "2"] | None = None,
) -> EmpiricalEstimate:
    """Added mass and damping of a box-like ROV.

    Args:
        outline: Size and projected areas.
        density: Of the water [kg/m3].
        inertia: I_x, I_y about CG [kg m2]; for linear damping in rotation.
        stiffness: Righting, W BG, roll and pitch [N m/rad]; for the same.

    Raises:
        IdentificationError: A vehicle outside the tables: a plate or a torpedo.
    """
    _require_box_like(outline)
    strips = density * _strips(outline)
    prism = density * _prism(outline)
    # The geometric mean of prism and strips in surge; strips alone, times the same factor, elsewhere.
    scaling = float(np.sqrt(prism / strips[0]))
    added = scaling * strips
    quadratic = density * _quadratic(outline)
    linear = _linear(quadratic, added, inertia, stiffness)
    return EmpiricalEstimate(outline, density, added, quadratic, linear, scaling, _notes(outline))


def _require_box_like(outline: Outline) -> None:
    length, width, height = outline.size
    slender = length / (0.5 * (width + height))
    aspects = [width / length, height / width, height / length, width / height, length / height]
    least, most = _SLENDERNESS
    if not (least <= slender <= most and _ASPECT[0] <= min(aspects) and max(aspects) <= _ASPECT[1]):
        raise IdentificationError(
            f"empirical method: found a box of {length:.3g} x {width:.3g} x {height:.3g} m, expected a box-like "
            f"vehicle, {least:g} to {most:g} times as long as its mean width and height, no side over "
            f"{_ASPECT[1]:g} times another. Use the panel method: rovtwin evidence panel"
        )


@cache
def _spline(table: str) -> CubicSpline:
    # Not-a-knot through every point, as in Eidsvik's program.
    tables = {
        "prism": _PRISM,
        "rectangle": _RECTANGLE[:, :2],
        "turning": _RECTANGLE[:, ::2],
        "drag 2d": _DRAG_2D,
        "drag 3d": _DRAG_3D,
    }
    points = tables[table]
    return CubicSpline(points[:, 0], points[:, 1])


def _at(table: str, aspect: float) -> float:
    return float(_spline(table)(aspect))


def _permeability(outline: Outline) -> Float[np.ndarray, "4"]:
    """How much a frame that water runs through takes off each direction: x, y, z, rotation."""
    fill = outline.fill
    return np.prod(fill) * np.array([*fill, 1.0])


def _strips(outline: Outline) -> Float[np.ndarray, "6"]:
    """2-D added mass times the length of the strip, per density."""
    length, width, height = outline.size
    along, across = _at("rectangle", width / length), _at("rectangle", length / width)
    linear = np.pi / 4 * np.array([along * width**2 * height, across * length**2 * height, across * length**2 * width])
    turning = np.pi * np.array(
        [
            _at("turning", height / width) * (max(width, height) / 2) ** 4 * length,
            _at("turning", length / height) * (max(length, height) / 2) ** 4 * width,
            _at("turning", width / length) * (max(width, length) / 2) ** 4 * height,
        ]
    )
    open_frame = _permeability(outline)
    return np.concatenate([linear * open_frame[:3], turning * open_frame[3]])


def _prism(outline: Outline) -> float:
    """Added mass in surge of the prism of square section, per density [m3]."""
    length, width, height = outline.size
    side = 0.5 * (width + height)
    return _at("prism", length / side) * length * side**2 * float(_permeability(outline)[0])


def _quadratic(outline: Outline) -> Float[np.ndarray, "6"]:
    """1/2 C_D A in translation, pressure on the turning faces in rotation; per density."""
    length, width, height = outline.size
    slender = length / (0.5 * (width + height))
    scaling = _at("drag 3d", slender) / _at("drag 2d", length / width)
    coefficients = np.array([_at("drag 2d", a) for a in (slender, width / height, height / width)])
    linear = 0.5 * scaling * coefficients * outline.areas
    fill_x, fill_y, fill_z = outline.fill
    turning = [
        _turning_face(height, width, length, fill_y) + _turning_face(width, height, length, fill_z),
        _turning_face(height, length, width, fill_x) + _turning_face(length, height, width, fill_z),
        _turning_face(width, length, height, fill_x) + _turning_face(length, width, height, fill_y),
    ]
    return np.concatenate([linear, scaling * np.array(turning)])


def _turning_face(across: float, thickness: float, span: float, fill: float) -> float:
    """Both halves of a pair of faces that sweep round, `across` wide, on an axis along `span`; as Eidsvik weighs it."""
    half = across / 2
    return 2 * (1 / 6) * (3 / 4) * _at("drag 2d", thickness / half) * fill * span * half**4


def _linear(
    quadratic: Float[np.ndarray, "6"],
    added: Float[np.ndarray, "6"],
    inertia: Float[np.ndarray, "2"] | None,
    stiffness: Float[np.ndarray, "2"] | None,
) -> Float[np.ndarray, "6"]:
    """A share of the quadratic; roll and pitch by damping ratio, yaw by pitch's share."""
    linear = np.append(LINEAR_SHARE * quadratic[:3], [np.nan] * 3)
    if inertia is not None and stiffness is not None and (np.asarray(stiffness) > 0).all():
        linear[3:5] = 2 * DAMPING_RATIO * np.sqrt(np.asarray(stiffness) * (np.asarray(inertia) + added[3:5]))
        linear[5] = quadratic[5] * linear[4] / quadratic[4]
    return linear


def _notes(outline: Outline) -> tuple[str, ...]:
    length, width, height = outline.size
    notes = []
    if max(width, height) > 1.1 * min(width, height):
        notes.append(
            f"the prism data want about equal width and height; found {width:.3g} x {height:.3g} m, "
            f"{max(width, height) / min(width, height):.2g} : 1"
        )
    if length < 0.97 * 0.5 * (width + height):
        notes.append(
            f"shorter than the shortest prism of the tables: length / mean side {2 * length / (width + height):.2g}"
        )
    if outline.fill.min() < 0.6:
        notes.append(
            f"an open outline, {100 * outline.fill.min():.0f} % of a side filled: the method multiplies the fill of "
            "all three sides, which is too much for hulls side by side"
        )
    return tuple(notes)


@dataclass(frozen=True)
class Published:
    """A number of the thesis beside what its method gives."""

    axis: str
    quantity: str
    equation: str
    printed: float
    computed: float
    decimals: int

    @property
    def follows(self) -> bool:
        """To one unit of the last digit that was printed: the thesis cuts digits off as often as it rounds."""
        return bool(abs(self.computed - self.printed) < 1.0001 * 10.0**-self.decimals)


# Thesis table 5.1; and of one Pioneer, from which the single vehicle's published numbers follow.
DOUBLE_BLUEYE = Outline(np.array([0.640, 0.950, 0.354]), np.array([0.173964, 0.140366, 0.301998]))
SINGLE_BLUEYE = Outline(np.array([0.485, 0.257, 0.354]), np.array([0.056387, 0.140366, 0.0795615]))
_PRINTED = (
    ("added_mass", "(3.3)", ("21.2", "8.95", "28.6", "1.7", "3.8", "1.5")),
    ("quadratic_damping", "(3.4)", ("90.55", "46.58", "194.05", "4.62", "1.21", "3.03")),
    ("linear_damping", "(3.5)", ("14.48", "7.45", "31.05", "0.0928", "0.44", "0.085")),
)


def against_thesis() -> list[Published]:
    """The thesis's empirical numbers, (3.3) to (3.5), beside what the method gives for its vehicle (table 5.1).

    Inertia (3.2) and restoring 30 x 0.17 N m/rad as in (3.15).
    """
    found = estimate(DOUBLE_BLUEYE, FRESH_WATER, np.array([2.69, 3.88]), np.array([5.1, 5.1]))
    return [
        Published(axis, quantity, equation, float(text), float(value), len(text.split(".")[1]))
        for quantity, equation, texts in _PRINTED
        for axis, text, value in zip(AXES, texts, getattr(found, quantity), strict=True)
    ]
