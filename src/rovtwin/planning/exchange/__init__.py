"""Missions in other programs' files: GPX, KML, GeoJSON, plans of QGroundControl; `missions` has them all."""
