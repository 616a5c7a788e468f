"""What the stages prove and predict share: four-corner missions, flights of drawn vehicles, bands and verdicts."""
