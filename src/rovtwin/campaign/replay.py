"""A sample of a campaign by its place, to be flown again."""

from pathlib import Path

from rovtwin.campaign.schema import Campaign, load_campaign
from rovtwin.core.errors import ConfigError


def sample_of(place: str) -> tuple[Campaign, int]:
    """The campaign and the number of the sample that `DIR/INDEX` names.

    Raises:
        ConfigError: There is no such campaign, or it has no such sample.
    """
    folder, _, number = place.rstrip("/").rpartition("/")
    if not folder or not number.isdecimal():
        raise ConfigError(f"--replay {place}: expected the campaign's folder and the sample's number: DIR/INDEX")
    if not (Path(folder) / "campaign.yaml").is_file():
        raise ConfigError(f"--replay {place}: {folder} holds no campaign.yaml; expected a folder of `rovtwin campaign`")
    campaign = load_campaign(folder)
    if int(number) >= campaign.samples:
        raise ConfigError(f"--replay {place}: there are samples 0 to {campaign.samples - 1}")
    return campaign, int(number)
