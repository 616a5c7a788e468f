"""From a scenario to blocks: one module for each of its sections, joined by `composition`."""
