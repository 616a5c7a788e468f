"""What the server of the console has for its chart: files of the plan, maps, tracks of earlier dives."""
