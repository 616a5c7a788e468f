"""What a campaign left, as one object: its rows, and what every result can do."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rovtwin.campaign.rows import SCORES, table_schema
from rovtwin.campaign.schema import Campaign, load_campaign
from rovtwin.campaign.store import read_table
from rovtwin.campaign.summary import column, summarise
from rovtwin.core.errors import LogError
from rovtwin.core.extras import require
from rovtwin.core.log.files import atomic
from rovtwin.core.notebook import Result, axes_of, labelled
from rovtwin.core.notebook.face import Row
from rovtwin.core.user_files.config import near, parse
from rovtwin.core.user_files.quantity import named_unit

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

_KEY = b"rovtwin_campaign"  # of the metadata of a file's schema
_OURS = ("completed", "index", "lanes", "phase", "reason", "began", "wall_s", "cpu_s", *SCORES)


def unit_of(name: str) -> str:
    """Unit of a column; "" of what is drawn, whose path says it."""
    if name not in _OURS:
        return ""
    return "s" if name == "began" else named_unit(name)[1] or "1"


@dataclass(frozen=True, eq=False, repr=False)
class CampaignSession(Result):
    """What a session of a campaign left.

    Attributes:
        folder: Of the results.
        campaign: Complete.
        table: All rows of the campaign's samples, those of earlier sessions too.
        flown: Number of samples that this session flew.
        wall_s: How long it took [s].
        by: Who flew.

    Example:
        >>> rovtwin.run_campaign("examples/campaign.yaml", "runs/many", samples=20)  # doctest: +SKIP
        <CampaignSession campaign: 20 of 20 flown, 19 completed>
    """

    folder: Path
    campaign: Campaign
    table: pa.Table
    flown: int
    wall_s: float
    by: str

    @property
    def whole(self) -> bool:
        """Whether all samples are flown."""
        return self.table.num_rows == self.campaign.samples

    def __repr__(self) -> str:
        """One line, as a notebook shows it."""
        completed = int(np.sum(column(self.table, "completed")))
        rows = f"{self.table.num_rows} of {self.campaign.samples} flown, {completed} completed"
        return f"<CampaignSession {self.campaign.name}: {rows}>"

    def figures_table(self) -> list[Row]:
        """How many completed, and median, 5 and 95 % of the scores.

        Example:
            >>> rovtwin.CampaignSession.load("runs/many").summary()  # doctest: +SKIP
        """
        found = summarise(self.campaign, self.table)
        head: list[Row] = [(name, found[name], "") for name in ("samples", "flown", "completed")]
        if found["completed_interval"]:
            head.append(("share completed, 95 % interval", found["completed_interval"], ""))
        scores = found["scores"].items()
        return head + [
            (f"{name}, 5 / 50 / 95 %", [q["p5"], q["median"], q["p95"]], unit_of(name)) for name, q in scores
        ]

    def remarks(self) -> list[str]:
        """Reasons of what did not complete.

        Example:
            >>> rovtwin.CampaignSession.load("runs/many").remarks()  # doctest: +SKIP
            ['1 x geofence', 'in runs/many']
        """
        reasons = summarise(self.campaign, self.table)["reasons"]
        return [f"{number} x {reason}" for reason, number in reasons.items()] + [f"in {self.folder}"]

    def to_pandas(self) -> "pandas.DataFrame":
        """A row for each sample: what was drawn, verdict, scores, cost.

        Example:
            >>> rovtwin.CampaignSession.load("runs/many").to_pandas()["cross_track_rms_m"].median()  # doctest: +SKIP
        """
        require("pandas", "notebook", "CampaignSession.to_pandas")
        import pandas

        names = [name for name in self.table.schema.names if name != "index"]
        columns = {name: self.table[name].to_numpy() for name in names}
        return pandas.DataFrame(columns, pandas.Index(self.table["index"].to_numpy(), name="sample"))

    def to_xarray(self) -> "xarray.Dataset":
        """A variable for each column, by `sample`; scores have units, what was drawn has its path as the name.

        Example:
            >>> rovtwin.CampaignSession.load("runs/many").to_xarray().cross_track_rms_m.attrs["units"]  # doctest: +SKIP
            'm'
        """
        names = [name for name in self.table.schema.names if name != "index"]
        variables: dict[str, Any] = {name: (("sample",), column(self.table, name), unit_of(name)) for name in names}
        places = {"sample": self.table["index"].to_numpy()}
        return labelled("CampaignSession.to_xarray", variables, places, {"campaign": self.campaign.name})

    def plot(self, score: str = "") -> "Axes":
        """How a score is distributed: its cumulative share.

        Args:
            score: A column; by default the first of the campaign's `scatter` that has numbers.

        Raises:
            LogError: No such score.

        Example:
            >>> rovtwin.CampaignSession.load("runs/many").plot("duration_s")  # doctest: +SKIP
        """
        if score and score not in SCORES:
            raise LogError(f"score: found {score!r}, expected one of {', '.join(SCORES)}.{near(score, SCORES)}")
        names = [score] if score else [*self.campaign.scatter, *SCORES]
        values = {name: column(self.table, name) for name in names}
        name = next((one for one in names if np.isfinite(values[one]).any()), names[0])
        finite = np.sort(values[name][np.isfinite(values[name])])
        axes = axes_of(f"{name} [{unit_of(name)}]", "Share of missions")
        axes.step(finite, np.arange(1, len(finite) + 1) / max(len(finite), 1), where="post", color="#0072B2")
        axes.set_ylim(0.0, 1.02)
        return axes

    def save(self, path: str | Path, overwrite: bool = False) -> Path:
        """Written as one Parquet file, the campaign in its metadata; returns the path.

        Raises:
            LogError: The file cannot be written, or it exists.

        Example:
            >>> rovtwin.CampaignSession.load("runs/many").save("many.parquet")  # doctest: +SKIP
        """
        path, about = (
            Path(path),
            {"folder": str(self.folder), "flown": self.flown, "wall_s": self.wall_s, "by": self.by},
        )
        text = json.dumps(about | {"campaign": self.campaign.model_dump(mode="json")})
        kept = self.table.replace_schema_metadata({**(self.table.schema.metadata or {}), _KEY: text.encode()})
        with atomic(path, overwrite) as temporary:
            pq.write_table(kept, temporary)
        return path

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """What `save` or `rovtwin campaign` left.

        Args:
            path: The Parquet file, or a folder of results.

        Raises:
            LogError: The file is missing, damaged, or of something else.
            ConfigError: The campaign is missing, or this version of rovtwin cannot use it.

        Example:
            >>> rovtwin.CampaignSession.load("runs/many").whole  # doctest: +SKIP
            True
        """
        path = Path(path)
        if path.is_dir():
            campaign = load_campaign(path)
            return cls(path, campaign, read_table(path, table_schema(campaign)), 0, 0.0, "")
        if not path.is_file():
            around = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
            raise LogError(
                f"{path}: found no such file, expected a saved campaign or a folder.{near(path.name, around)}"
            )
        try:
            table = pq.read_table(path)
        except (pa.ArrowException, OSError) as error:
            raise LogError(
                f"{path}: found no Parquet file, or a damaged one ({str(error).splitlines()[0]}), expected one that "
                "CampaignSession.save wrote; save it again from its folder"
            ) from None
        held = (table.schema.metadata or {}).get(_KEY)
        if held is None:
            raise LogError(
                f"{path}: found a Parquet file without its campaign, expected one that CampaignSession.save wrote; "
                "load the folder in which it lies"
            )
        try:
            return cls(**_read(table, json.loads(held), path.name))
        except (LookupError, TypeError, ValueError, OverflowError, RecursionError, pa.ArrowException) as error:
            raise LogError(
                f"{path}: found a damaged file, or one of another version ({type(error).__name__}: {error}), expected "
                "all that CampaignSession.save writes; save it again from its folder"
            ) from error


def _read(table: pa.Table, about: dict[str, Any], where: str) -> dict[str, Any]:
    """Fields of a session from what `save` kept; raises where something is missing or of another kind."""
    campaign = parse(Campaign, about["campaign"], where)
    schema = table_schema(campaign)
    return {
        "folder": Path(about["folder"]),
        "campaign": campaign,
        "table": table.select(schema.names).cast(schema),
        "flown": int(about["flown"]),
        "wall_s": float(about["wall_s"]),
        "by": str(about["by"]),
    }
