"""Plans: surveys over an area, and tests that tell most of a vehicle within a tank."""
