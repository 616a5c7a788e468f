"""What an engine reports: states, alerts, faults of a plan, findings of the monitor, and what does not change."""
