"""A vehicle as tables, labelled arrays, a drawing and a file, as every result has them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rovtwin.core.errors import ConfigError
from rovtwin.core.extras import require
from rovtwin.core.log.files import atomic
from rovtwin.core.notebook import Result, axes_of, labelled
from rovtwin.core.notebook.face import Row
from rovtwin.core.user_files.yamlfile import dump_yaml
from rovtwin.vehicle.constants import GRAVITY

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

    from rovtwin.vehicle.description.totals.assembly import Assembly
    from rovtwin.vehicle.physics.model import Model

MOTIONS = ("surge", "sway", "heave", "roll", "pitch", "yaw")
MATRICES = {  # of a Model: what a matrix times a velocity or acceleration gives
    "rigid_body_mass": "kg, kg m, kg m2",
    "added_mass": "kg, kg m, kg m2",
    "linear_damping_ahead": "N s/m, N s, N m s",
    "linear_damping_astern": "N s/m, N s, N m s",
    "quadratic_damping_ahead": "N s2/m2, N s2/m, N s2, N m s2",
    "quadratic_damping_astern": "N s2/m2, N s2/m, N s2, N m s2",
}


class VehicleFace(Result):
    """What `Vehicle` has of the face of all results."""

    if TYPE_CHECKING:
        name: str
        assembly: Assembly
        water_density: float | None
        pairs_apart: bool

        def model(self) -> Model: ...

        def to_dict(self) -> dict[str, Any]: ...

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        total = self.assembly
        return f"<Vehicle {self.name}: {total.solid.mass:.1f} kg, {len(total.thrusters)} thrusters>"

    def figures_table(self) -> list[Row]:
        """Mass, buoyancy, centres, what is on board.

        Example:
            >>> label, mass, unit = rovtwin.load_vehicle("double_blueye").figures_table()[0]
            >>> label, round(mass), unit
            ('mass', 30, 'kg')
        """
        total = self.assembly
        weight, buoyancy = total.solid.mass * GRAVITY, total.density * GRAVITY * total.volume
        return [
            ("mass", float(total.solid.mass), "kg"),
            ("volume", 1000.0 * float(total.volume), "l"),
            ("water", float(total.density), "kg/m3"),
            ("net buoyancy, positive floats", float(buoyancy - weight), "N"),
            ("centre of gravity", np.asarray(total.solid.center_of_gravity).tolist(), "m"),
            ("centre of buoyancy", np.asarray(total.center_of_buoyancy).tolist(), "m"),
            ("thrusters", len(total.thrusters), ""),
            ("sensors", len(total.sensors), ""),
            ("cameras", len(total.cameras), ""),
            ("tethers", len(total.tethers), ""),
        ]

    def remarks(self) -> list[str]:
        """Why its identification is not to be relied on, where it is not.

        Example:
            >>> rovtwin.load_vehicle("double_blueye").remarks()
            []
        """
        return list(getattr(self, "doubts", []))

    def to_xarray(self) -> xarray.Dataset:
        """Matrices of the equations of motion by `motion` and `motion_2`, and what each thruster does, T by `thruster`.

        Raises:
            ConfigError: xarray is missing, or the parts make no vehicle that can move.

        Example:
            >>> data = rovtwin.load_vehicle("double_blueye").to_xarray()
            >>> bool(data.added_mass.sel(motion="heave", motion_2="heave") > 0)
            True
        """
        model, square = self.model(), ("motion", "motion_2")
        variables: dict[str, Any] = {n: (square, np.asarray(getattr(model, n)), unit) for n, unit in MATRICES.items()}
        variables |= {
            "thruster_configuration": (("motion", "thruster"), np.asarray(model.thrusters.configuration), "1, m"),
            "center_of_gravity": (("direction",), np.asarray(model.center_of_gravity), "m"),
            "center_of_buoyancy": (("direction",), np.asarray(model.center_of_buoyancy), "m"),
            "weight": ((), float(model.weight), "N"),
            "buoyancy": ((), float(model.buoyancy), "N"),
        }
        names = [t.name for t in self.assembly.thrusters]
        places = {"motion": list(MOTIONS), "motion_2": list(MOTIONS), "direction": ["x", "y", "z"], "thruster": names}
        return labelled("Vehicle.to_xarray", variables, places, {"vehicle": self.name, "frame": "b"})

    def to_pandas(self) -> pandas.DataFrame:
        """The thrusters, a row each: place x, y, z [m] and the direction of thrust in b, at CO.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> rovtwin.load_vehicle("double_blueye").to_pandas().loc["port.surge", "along_x"]
            np.float64(1.0)
        """
        require("pandas", "notebook", "Vehicle.to_pandas")
        import pandas

        places, along = self._thrusters()
        names = pandas.Index([t.name for t in self.assembly.thrusters], name="thruster")
        return pandas.DataFrame(np.hstack([places, along]), names, ["x", "y", "z", "along_x", "along_y", "along_z"])

    def _thrusters(self) -> tuple[np.ndarray, np.ndarray]:
        """Places [m] and directions in b, shapes (n, 3)."""
        mounted: Any = self.assembly.thrusters  # whose items are thrusters
        places = [t.placement.point(np.asarray(t.item.position, float)) for t in mounted]
        along = [t.placement.rotation @ np.asarray(t.item.direction, float) for t in mounted]
        unit = [d / np.linalg.norm(d) for d in along]
        return np.reshape(places, (-1, 3)), np.reshape(unit, (-1, 3))

    def plot(self) -> Axes:
        """From above: boxes of the parts, thrusters with the direction in which they push, centre of gravity.

        Example:
            >>> rovtwin.load_vehicle("double_blueye").plot().get_xlabel()
            'y, to starboard [m]'
        """
        from matplotlib.patches import Polygon
        from scipy.spatial import ConvexHull

        axes, total = axes_of("y, to starboard [m]", "x, ahead [m]", equal=True), self.assembly
        for box in total.boxes:
            seen = box.corners()[:, [1, 0]]
            outline = seen[ConvexHull(seen).vertices] if np.all(np.ptp(seen, axis=0) > 1e-9) else seen
            axes.add_patch(Polygon(outline, facecolor="#0072B2", alpha=0.15, edgecolor="#0072B2"))
        places, along = self._thrusters()
        reach = 0.25 * max([0.2, *(float(np.ptp(box.corners()[:, :2], axis=0).max()) for box in total.boxes)])
        for place, push in zip(places, reach * along, strict=True):
            axes.annotate(
                "", (place[1] + push[1], place[0] + push[0]), (place[1], place[0]), arrowprops={"arrowstyle": "->"}
            )
        axes.plot(places[:, 1], places[:, 0], "o", color="#D55E00", label="thruster")
        gravity = np.asarray(total.solid.center_of_gravity)
        axes.plot([gravity[1]], [gravity[0]], "x", color="#1a1a1a", label="centre of gravity")
        axes.legend(frameon=False, fontsize=8)
        return axes

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Written as one vehicle file with all parts in it, which `load_vehicle` reads; mesh files stay where they are.

        Raises:
            LogError: The file cannot be written, or it exists.
            ConfigError: It is in other water than its file is written for, or has its pairs apart.

        Example:
            >>> rovtwin.load_vehicle("double_blueye").save("mine.yaml", overwrite=True).name
            'mine.yaml'
        """
        if self.water_density is not None or self.pairs_apart:
            what = "is in water of another density" if self.water_density is not None else "has its pairs apart"
            raise ConfigError(
                f"{self.name}: found a vehicle that {what}, which a vehicle file does not hold; save the one that "
                "rovtwin.load_vehicle gives, and change it again behind `load`"
            )
        path = Path(path)
        with atomic(path, overwrite) as temporary:
            temporary.write_text(dump_yaml(self.to_dict()), encoding="utf-8")
        return path
