"""A run that is over, as one object: its log, its figures, and what every result can do."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from rovtwin.core.errors import LogError
from rovtwin.core.log import Log
from rovtwin.core.notebook import Result
from rovtwin.core.notebook.face import Row
from rovtwin.core.user_files.config import parse_yaml
from rovtwin.runs.scoring.figures import rows
from rovtwin.scenario.files import scenario_of
from rovtwin.scenario.schema import Scenario

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class Flight(Result):
    """A run that is over.

    Attributes:
        scenario: What was flown.
        folder: Where everything of it lies, None if nothing was written.
        log: All channels.
        figures: Figures, verdict and reason (see `scoring`), as in `summary.json`.

    Example:
        >>> flight = rovtwin.fly("square", overrides=["duration=0.1"], say=lambda line: None)
        >>> flight.completed, flight.figures["phase"]
        (False, 'dive')
        >>> flight.log["truth/eta"].to_xarray().sizes["field"]
        6
    """

    scenario: Scenario
    folder: Path | None
    log: Log
    figures: dict[str, Any]

    @property
    def completed(self) -> bool:
        return bool(self.figures["completed"])

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        return f"<Flight of {self.scenario.name}, seed {self.scenario.seed}: {self._verdict}>"

    def figures_table(self) -> list[Row]:
        """Those of `figures` that have a name for people: label, value, unit; a share in per cent.

        Example:
            >>> flight.figures_table()[0][0]
            'duration'
        """
        return list(rows(self.figures))

    def remarks(self) -> Sequence[str]:
        """Why it ended so, by what it was judged, and where it lies.

        Example:
            >>> flight.remarks()
            []
        """
        notes = [str(self.figures[key]) for key in ("why", "judged_by") if self.figures.get(key)]
        return notes + ([f"in {self.folder}"] if self.folder else [])

    def to_xarray(self) -> "xarray.DataTree":
        """A tree of the log's channels, see `Log.to_xarray`; `figures` that are numbers or text are attributes.

        Raises:
            ConfigError: xarray is missing.

        Example:
            >>> flight.to_xarray()["truth/eta/x"].sizes["time"]
            2
        """
        found = self.log.to_xarray()
        plain = {key: value for key, value in self.figures.items() if isinstance(value, int | float | str)}
        found.attrs |= {"scenario": self.scenario.name, "seed": self.scenario.seed}
        found.attrs |= {key: int(value) if isinstance(value, bool) else value for key, value in plain.items()}
        return found

    def to_pandas(self) -> "pandas.DataFrame":
        """The log's channels side by side, see `Log.to_pandas`.

        Raises:
            ConfigError: pandas is missing.

        Example:
            >>> flight.to_pandas()["truth/eta", "z"].notna().sum()
            np.int64(2)
        """
        return self.log.to_pandas()

    def plot(self) -> "Axes":
        """The path over ground: commanded, estimated, true.

        Example:
            >>> flight.plot().get_ylabel()
            'North [m]'
        """
        from rovtwin.report.flight import Flight as Recorded
        from rovtwin.report.run.path import path

        return path(Recorded(self.log)).axes[0]

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Its log as one MCAP file, which holds the scenario and the figures too; returns the path.

        Raises:
            LogError: The file cannot be written, or it exists.

        Example:
            >>> flight.save("flight.mcap", overwrite=True).name
            'flight.mcap'
        """
        return self.log.write(path, overwrite)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """A flight of what `save` or `rovtwin fly` wrote; its scenario has the vehicle written out.

        Args:
            path: The log, or the folder of a run.

        Raises:
            LogError: The file is missing, damaged, or no log of a run.
            ConfigError: This version of rovtwin cannot use its scenario.

        Example:
            >>> rovtwin.Flight.load(flight.save("flight.mcap", overwrite=True)).figures == flight.figures
            True
        """
        path = Path(path)
        file = path / "log.mcap" if path.is_dir() else path
        log = Log.read(file)
        for key in ("scenario", "summary"):
            if not log.metadata.get(key):
                raise LogError(
                    f"{file}: found a log without the {key} of a run, expected one that Flight.save or rovtwin fly "
                    "wrote; rovtwin.Log.load reads it as it is"
                )
        try:
            figures = json.loads(log.metadata["summary"])
        except ValueError as error:
            raise LogError(f"{file}: summary: found no JSON ({error}), expected what rovtwin fly writes") from None
        scenario = scenario_of(parse_yaml(log.metadata["scenario"], file.name), file.name)
        return cls(scenario, path if path.is_dir() else None, log, figures)

    @property
    def _verdict(self) -> str:
        return "completed" if self.completed else f"not completed: {self.figures['reason']}"
