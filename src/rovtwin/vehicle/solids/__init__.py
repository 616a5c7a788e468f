"""Closed meshes of parts, and the solids that they are like."""
