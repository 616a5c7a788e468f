"""The folder of a campaign: its file, and what has been flown, such that a kill at any moment loses nothing.

campaign.yaml      the complete campaign; another one is refused
parts/*.parquet    results as they came, each file written beside and moved into place
samples.parquet    all of them, when a session ends
"""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rovtwin._version import __version__
from rovtwin.campaign.rows import table_schema
from rovtwin.campaign.schema import Campaign
from rovtwin.core.errors import ConfigError
from rovtwin.core.user_files.config import read_yaml
from rovtwin.core.user_files.files import cannot, whole, write_text
from rovtwin.core.user_files.yamlfile import dump_yaml

FREE = ("samples", "name", "description", "scatter")  # may change from one session to the next: no draw depends on them


class Store:
    """Results of a campaign, open for one process; a context.

    Attributes:
        done: Numbers of the samples that are flown.
    """

    def __init__(self, folder: Path, campaign: Campaign):
        """Open or make the folder.

        Raises:
            ConfigError: It belongs to another campaign or version, another process has it, or it cannot be written.
        """
        self.folder, self._schema = folder, table_schema(campaign)
        self._parts = folder / "parts"
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            self._lock = (folder / ".lock").open("w")
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be written ({error.strerror}). Choose another with --out") from None
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # falls with the process, however it ends
        except OSError:
            raise ConfigError(f"{folder}: another process flies this campaign; wait for it, or stop it") from None
        try:
            require_same(folder, campaign)
            for left in (*folder.glob(".*.part"), *self._parts.glob(".*.part")):
                left.unlink()  # a session that was killed was writing it
            _keep_campaign(folder, campaign)
            self.done = set(self.table()["index"].to_pylist())
        except BaseException:
            self._lock.close()
            raise

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self._lock.close()

    def add(self, rows: list[dict[str, Any]]) -> None:
        """Keep rows of samples that are flown; those that are there already stay as they are.

        Raises:
            ConfigError: They cannot be written; what was kept before is.
        """
        new = [row for row in rows if row["index"] not in self.done]
        if not new:
            return
        table = pa.Table.from_pylist(new, schema=self._schema)
        with self._keeping():
            _write_atomically(table, self._parts / f"{new[0]['index']:07d}-{len(new)}.parquet")
        self.done |= {row["index"] for row in new}

    def table(self) -> pa.Table:
        """All rows in order of the samples, each once."""
        return read_table(self.folder, self._schema)

    def gather(self) -> pa.Table:
        """The whole table, and the parts become one file.

        Raises:
            ConfigError: It cannot be written; the parts stay.
        """
        table = self.table()
        with self._keeping():
            _write_atomically(table, self.folder / "samples.parquet")
        for part in self._parts.glob("*.parquet"):
            part.unlink()
        return table

    @contextmanager
    def _keeping(self) -> Iterator[None]:
        """A block that writes: when it can't, the error says what is kept all the same."""
        try:
            yield
        except OSError as error:
            kept = f"{len(self.done)} missions are kept in {self.folder}: the same command goes on from there"
            raise ConfigError(f"{cannot(error)}. {kept}") from None


def read_table(folder: Path, schema: pa.Schema) -> pa.Table:
    """What the folder of a campaign holds so far, in order of the samples, each once."""
    paths = [folder / "samples.parquet", *sorted((folder / "parts").glob("*.parquet"))]
    tables = [pq.read_table(path, schema=schema) for path in paths if path.is_file()]
    whole = pa.concat_tables([schema.empty_table(), *tables])
    # A part may be in the whole already, if a kill came between writing it and deleting the part.
    _, first = np.unique(whole["index"].to_numpy(), return_index=True)
    return whole.take(first)


def _write_atomically(table: pa.Table, path: Path) -> None:
    """Under another name first: whoever reads finds a whole file or none."""
    with whole(path) as beside:
        pq.write_table(table, beside)


def left_in(folder: Path, campaign: Campaign) -> int:
    """How many samples a folder, which need not be there, has not yet.

    Raises:
        ConfigError: It belongs to another campaign or version.
    """
    require_same(folder, campaign)
    flown = read_table(folder, table_schema(campaign))["index"].to_numpy()
    return campaign.samples - int((flown < campaign.samples).sum())


def require_same(folder: Path, campaign: Campaign) -> None:
    """ConfigError where a folder holds results of another campaign, or of another version of rovtwin."""
    path = folder / "campaign.yaml"
    if not path.is_file():
        return
    kept, mine = read_yaml(path), campaign.model_dump(mode="json")
    version = kept.pop("made_with", "")
    changed = [key for key in mine if key not in FREE and kept.get(key) != mine[key]]
    if changed:
        raise ConfigError(
            f"{folder}: holds another campaign, which differs in {', '.join(_places(kept, mine, changed))}. Its "
            "results would not be samples of this one: choose another folder with --out, or delete this one"
        )
    if version != __version__:
        raise ConfigError(
            f"{folder}: was made with rovtwin {version}, this is {__version__}. Results of two versions are not "
            "samples of one campaign: choose another folder with --out"
        )


def _keep_campaign(folder: Path, campaign: Campaign) -> None:
    """Write the campaign's file."""
    write_text(folder / "campaign.yaml", dump_yaml(campaign.model_dump(mode="json") | {"made_with": __version__}))


def _places(kept: dict[str, Any], mine: dict[str, Any], keys: list[str], most: int = 4) -> list[str]:
    """Where two campaigns differ, with both values: `seed (there 1, here 2)`."""
    found: list[str] = []

    def look(one: Any, other: Any, path: str) -> None:
        if isinstance(one, dict) and isinstance(other, dict):
            for key in dict.fromkeys([*one, *other]):
                look(one.get(key), other.get(key), f"{path}.{key}" if path else str(key))
        elif one != other:
            found.append(f"{path} (there {_short(one)}, here {_short(other)})")

    for key in keys:
        look(kept.get(key), mine.get(key), key)
    return found if len(found) <= most else [*found[:most], f"and {len(found) - most} more"]


def _short(value: Any) -> str:
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
