"""Reports of many flights: a campaign, a tuning, a watch over runs."""
