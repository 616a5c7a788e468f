"""Added mass by the panel method: potential flow about a vehicle's shapes or a mesh, with capytaine.

Direct boundary integral method with capytaine's influence matrices, as its `method="direct"`: the indirect one is 3.5 %
off on a sphere where this is 0.3 %. Two meshes give the limit of ever finer ones, and the numerical error. The larger
error is what potential flow does not know: water caught in open frames, and how well the shapes stand for the vehicle.

References: Ancellin and Dias (2019), Capytaine: a Python-based linear potential flow solver, JOSS 4(36):1341; Newman
(1977), Marine Hydrodynamics, ch. 4; walls by images: Lamb (1932), Hydrodynamics, art. 99 and 137.
"""

from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from typing import Any

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import IdentificationError
from rovtwin.core.extras import imported
from rovtwin.identification.priors.surface import LEAST, Panels
from rovtwin.identification.priors.widths import USUAL_OPENNESS, LogNormal, log_normals, widths_of
from rovtwin.vehicle.constants import AXES, FRESH_WATER

PANELS = 1500  # of the finer mesh, unless the user gives a size: the box of the tests within 0.5 % in 2 s
MOST_PANELS = 6000  # matrices of 6000 x 6000: 2 GB
_SOURCES_ERROR = 0.05  # of parts that run into each other: two cylinders as one, a box in a box, against one body
_NOTHING, _HARDLY = 1e-6, 1e-3  # of the body's scale: rounding; what a mesh's faults may make
_IMAGES = 3  # each way, between surface and floor

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Mesher:
    """Makes the surface at any size of panel, and knows how fast the error falls with it.

    Attributes:
        at: Mean side of a panel [m], least number along any side -> panels.
        area: Wetted, roughly [m2].
        order: The error falls as size^order; 0: not so regularly that two meshes tell the limit.
        name: For messages.
        coarser: The other mesh's panels, of this one's.
    """

    at: Callable[[float, int], Panels]
    area: float
    order: float
    name: str
    coarser: float = 1.45


@dataclass(frozen=True, eq=False)
class PanelAddedMass:
    """Added mass of a body in ideal water.

    Attributes:
        matrix: M_A at CO, symmetric [kg, kg m, kg m2], in the limit of fine panels.
        error: Numerical, of the diagonal, as a share of it; 0 where the diagonal is.
        asymmetry: Largest difference across the diagonal before it was taken out, of sqrt(M_ii M_jj).
        panels: The finer mesh.
        pressure: On each panel for unit acceleration in each direction, [Pa s2/m, Pa s2/rad].
        density: Of the water [kg/m3].
        surroundings: In words: unbounded, or where surface and floor are.
        notes: What to know of the mesh, one line each.
    """

    matrix: Float[np.ndarray, "6 6"]
    error: Float[np.ndarray, "6"]
    asymmetry: float
    panels: Panels
    pressure: Float[np.ndarray, "m 6"]
    density: float
    surroundings: str
    notes: tuple[str, ...] = ()

    def priors(self, openness: float | None = None) -> dict[str, LogNormal]:
        """The diagonal by name, `added_mass.surge`; what is numerical noise is left out.

        Args:
            openness: Of the hull, `widths.openness_of(vehicle)`; None: the usual one.
        """
        known = np.where(self.error < 0.5, np.diag(self.matrix), 0.0)
        widths = widths_of("panel", USUAL_OPENNESS if openness is None else openness)
        return log_normals({"added_mass": known}, widths, "panel method (capytaine), " + self.surroundings)


def panel_added_mass(
    mesher: Mesher,
    density: float = FRESH_WATER,
    *,
    depth: float | None = None,
    floor: float | None = None,
    panel_size: float | None = None,
    progress: Progress | None = None,
) -> PanelAddedMass:
    """M_A of a body about CO.

    Args:
        mesher: Makes its surface.
        density: Of the water [kg/m3].
        depth: Of CO below the surface [m]; None: no surface. The surface is that of slow motion, a rigid lid.
        floor: From CO down to the floor [m]; None: no floor.
        panel_size: Mean side of a panel of the finer mesh [m]; None: about PANELS panels.
        progress: Called with how many of how many solutions are done.

    Raises:
        IdentificationError: No capytaine, a body through surface or floor, too many panels, a mesh that gives no
            positive added mass.
    """
    size = np.sqrt(mesher.area / PANELS) if panel_size is None else panel_size
    if not (np.isfinite(size) and size > 0):
        raise IdentificationError(f"panel method: found a panel size of {size} m, expected more than 0")
    fine = _meshed(mesher, size, LEAST)
    walls = _Walls.between(fine, depth, floor)
    coarse = _meshed(mesher, mesher.coarser * size, LEAST * 2 // 3)
    step = _counter(progress, 2 * (2 + len(walls.images)))
    raw, pressure = _solve(fine, density, walls, step)
    other, _ = _solve(coarse, density, walls, step)
    ratio = len(fine.faces) / len(coarse.faces)
    regular = mesher.order > 0 and fine.wet is None and ratio > 1
    limit = raw + (raw - other) / (ratio ** (mesher.order / 2) - 1) if regular else raw
    scale = _scale(limit, fine)
    matrix, asymmetry = 0.5 * (limit + limit.T), _asymmetry(limit)
    matrix[np.abs(matrix) < _NOTHING * scale] = 0.0
    _require_positive(matrix, mesher.name)
    error = _error(np.diag(matrix), np.diag(raw - (limit if regular else other)), fine)
    notes = (*fine.notes, *_doubts(np.where(np.diag(matrix) > _HARDLY * np.diag(scale), error, 0.0), asymmetry))
    return PanelAddedMass(matrix, error, asymmetry, fine, pressure, density, walls.words, notes)


def _error(
    diagonal: Float[np.ndarray, "6"], difference: Float[np.ndarray, "6"], panels: Panels
) -> Float[np.ndarray, "6"]:
    """What was extrapolated, or where that is not possible how far the meshes differ; share of the diagonal, (6,)."""
    carried = diagonal > 0
    error = np.where(carried, np.abs(difference) / np.where(carried, diagonal, 1.0), 0.0)
    return error if panels.wet is None else np.where(carried, np.maximum(error, _SOURCES_ERROR), 0.0)


def _scale(matrix: Float[np.ndarray, "6 6"], panels: Panels) -> Float[np.ndarray, "6 6"]:
    """What an element of the body's size would be: its largest mass times its arm."""
    arm = np.repeat([1.0, 0.5 * float(np.linalg.norm(panels.size))], 3)
    return float(np.abs(matrix[:3, :3]).max()) * np.outer(arm, arm)


def _counter(progress: Progress | None, total: int) -> Callable[[], None]:
    done = 0

    def step() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            progress(done, total)

    return step


def _meshed(mesher: Mesher, size: float, least: int) -> Panels:
    expected = mesher.area / size**2
    if expected > MOST_PANELS:
        least = np.sqrt(mesher.area / MOST_PANELS)
        raise IdentificationError(
            f"{mesher.name}: panels of {size:.3g} m on {mesher.area:.3g} m2 make {expected:.0f}, expected at most "
            f"{MOST_PANELS} (memory); give a panel size of {least:.2g} m or more"
        )
    panels = mesher.at(size, least)
    if len(panels.faces) > MOST_PANELS:
        raise IdentificationError(
            f"{mesher.name}: found {len(panels.faces)} panels, expected at most {MOST_PANELS}; give a larger panel size"
        )
    return panels


@dataclass(frozen=True)
class _Walls:
    """Planes without flow through them, by images. Slow motion sees the surface as a lid.

    Attributes:
        words: For people.
        images: Of every height z, the image's: sign z + shift [m].
    """

    words: str
    images: tuple[tuple[float, float], ...] = ()

    @classmethod
    def between(cls, panels: Panels, depth: float | None, floor: float | None) -> "_Walls":
        top, bottom = panels.vertices[:, 2].min(), panels.vertices[:, 2].max()  # z is down
        if depth is not None and not depth + top > 0:
            raise IdentificationError(
                f"panel method: at depth {depth:g} m the body reaches {-top - depth:.3g} m out of the water, "
                f"expected a depth of CO above {-top:.3g} m"
            )
        if floor is not None and not floor - bottom > 0:
            raise IdentificationError(
                f"panel method: a floor {floor:g} m below CO cuts the body, expected more than {bottom:.3g} m"
            )
        if depth is not None and floor is not None:
            # Mirrors face each other: the images repeat every 2 H and fade with the cube of their distance.
            period = 2 * (depth + floor)
            moved = [(1.0, n * period) for n in range(-_IMAGES, _IMAGES + 1) if n != 0]
            turned = [(-1.0, -2 * depth + n * period) for n in range(-_IMAGES, _IMAGES + 1)]
            words = f"CO {depth:g} m below the surface and {floor:g} m above the floor, slow motion"
            return cls(words, tuple(moved + turned))
        if depth is not None:
            return cls(f"CO {depth:g} m below the surface, slow motion", ((-1.0, -2 * depth),))
        if floor is not None:
            return cls(f"CO {floor:g} m above the floor", ((-1.0, 2 * floor),))
        return cls("unbounded water")


def _solve(
    panels: Panels, density: float, walls: _Walls, step: Callable[[], None]
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "m 6"]]:
    """M_A of one mesh, and the pressure for unit accelerations."""
    cpt = _capytaine()
    # Its table of wave integrals, half a minute to make, is not needed: a token one.
    green = cpt.Delhommeau(tabulation_nr=10, tabulation_nz=10, tabulation_cache_dir=None)
    mesh = cpt.Mesh(vertices=panels.vertices, faces=panels.faces)
    direct = panels.wet is None
    S, D = _influence(green, mesh, mesh, direct)
    step()
    for sign, shift in walls.images:
        vertices = panels.vertices * [1.0, 1.0, sign] + [0.0, 0.0, shift]
        faces = panels.faces if sign > 0 else panels.faces[:, ::-1]
        S_image, D_image = _influence(green, mesh, cpt.Mesh(vertices=vertices, faces=faces), direct)
        S, D = S + S_image, D + D_image
        step()
    normal = np.asarray(mesh.faces_normals)
    motions = np.concatenate([normal, np.cross(np.asarray(mesh.faces_centers), normal)], axis=1)
    # Green's identity on the surface, D phi = S dphi/dn, holds on closed surfaces. Parts that run into each other are
    # not one: sources on all of them, whose flow outside is right whatever they do inside. Pressure is -rho dphi/dt.
    potential = np.linalg.solve(D, S @ motions) if direct else S @ np.linalg.solve(D, motions)
    pressure = -density * potential
    step()
    wet = np.asarray(mesh.faces_areas) * (1.0 if panels.wet is None else panels.wet)
    matrix = motions.T @ (wet[:, None] * pressure)
    return matrix, pressure


def _influence(
    green: Any, mesh: Any, sources: Any, direct: bool
) -> tuple[Float[np.ndarray, "m m"], Float[np.ndarray, "m m"]]:
    """Single layer, and double layer (`direct`) or its adjoint, of a mesh or an image of it, in unbounded water."""
    options: dict[str, Any] = {"adjoint_double_layer": not direct}
    # capytaine 2 sees itself whether a mesh acts on itself; 3 has to be asked, and its `evaluate` does not pass it on.
    if "diagonal_term_in_double_layer" in signature(green.evaluate_rankine_only).parameters:
        options["diagonal_term_in_double_layer"] = sources is mesh
    S, D = green.evaluate_rankine_only(mesh, sources, **options)
    return np.asarray(S), np.asarray(D)


def _capytaine() -> Any:
    capytaine = imported("capytaine", "panel", "the panel method", IdentificationError)
    capytaine.set_logging("ERROR")
    return capytaine


def _asymmetry(matrix: Float[np.ndarray, "6 6"]) -> float:
    own = np.sqrt(np.maximum(np.diag(matrix), 1e-6 * np.abs(matrix).max()))
    return float(np.abs((matrix - matrix.T) / np.outer(own, own)).max())


def _require_positive(matrix: Float[np.ndarray, "6 6"], name: str) -> None:
    least = np.linalg.eigvalsh(matrix)[0]
    if not np.isfinite(matrix).all() or least < -0.02 * np.abs(matrix).max():
        raise IdentificationError(
            f"{name}: the panel method gave an added mass with an eigenvalue of {least:.3g}, expected none below 0; "
            "normals point inward, or the surface has holes"
        )


def _doubts(error: Float[np.ndarray, "6"], asymmetry: float) -> list[str]:
    notes = []
    if (worst := float(error.max())) > 0.03:
        axis = AXES[int(error.argmax())]
        notes.append(f"the two meshes leave {100 * worst:.0f} % open in {axis}: give a smaller panel size")
    if asymmetry > 0.05:
        notes.append(f"asymmetry of {100 * asymmetry:.0f} % before it was taken out: the surface may have gaps")
    return notes
