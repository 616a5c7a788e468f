"""What the chart and the plan exchange with files: missions of other programs, maps, tracks of earlier dives."""
