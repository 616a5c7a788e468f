"""The pictures of docs/campaigns.md: the first forty missions of examples/campaign.yaml.

python docs/scripts/campaign.py [--out docs/figures] [--results runs/campaign-campaign]
"""

import argparse
from pathlib import Path

from rovtwin.campaign.reporting import result_of
from rovtwin.campaign.run import run_campaign
from rovtwin.campaign.schema import load_campaign
from rovtwin.campaign.workers import cores_here, on_this_machine
from rovtwin.report.studies.campaign import draw_scatter, draw_scores

ROOT = Path(__file__).parents[2]


def main():
    """Fly what is not flown yet, and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "figures")
    parser.add_argument("--results", type=Path, default=Path("runs/campaign-campaign"))
    parser.add_argument("--samples", type=int, default=40)
    given = parser.parse_args()
    campaign = load_campaign(ROOT / "examples" / "campaign.yaml", given.samples)
    result = result_of(run_campaign(campaign, given.results, on_this_machine(cores_here())))
    draw_scores(result).savefig(given.out / "campaign_scores.png", dpi=100)
    draw_scatter(result).savefig(given.out / "campaign_scatter.png", dpi=100)


if __name__ == "__main__":
    main()
