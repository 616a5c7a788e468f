"""A campaign on a full disk: what is flown so far is kept and said, and what a kill left half-written goes."""

from pathlib import Path

import pytest
import yaml
from tests.core.full_disk import full_at

from rovtwin.campaign.schema import Campaign, load_campaign
from rovtwin.campaign.store import Store
from rovtwin.core.errors import ConfigError

FILE = {
    "scenario": "lawnmower_waves",
    "samples": 40,
    "vary": {"world.net_buoyancy": {"distribution": "uniform", "low": 0, "high": 1}},
}


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    (tmp_path / "short.yaml").write_text(yaml.safe_dump(FILE))
    return load_campaign(tmp_path / "short.yaml")


def test_what_is_flown_is_kept_and_gone_on_with(campaign: Campaign, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    with Store(folder, campaign) as store:
        store.add([{"index": k} for k in range(3)])
        with full_at(2000), pytest.raises(ConfigError) as failed:
            store.add([{"index": 3, "reason": "long " * 2000}])
        said = str(failed.value)
        assert said.startswith(f"{folder / 'parts' / '0000003-1.parquet'}: ") and "File too large" in said
        assert f"3 missions are kept in {folder}: the same command goes on from there" in said
        with full_at(2000), pytest.raises(ConfigError, match=r"samples\.parquet: .*3 missions are kept"):
            store.gather()
    assert not list(folder.rglob("*.part"))
    with Store(folder, campaign) as store:
        assert store.done == {0, 1, 2}
        store.add([{"index": 3}])
        assert store.gather()["index"].to_pylist() == [0, 1, 2, 3]


def test_what_a_kill_left_half_written_goes(campaign: Campaign, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    with Store(folder, campaign) as store:
        store.add([{"index": 0}])
    left = folder / "parts" / ".0000001-1.parquet.123.part"
    left.write_bytes(b"half")
    with Store(folder, campaign) as store:
        assert store.done == {0} and not left.exists()
