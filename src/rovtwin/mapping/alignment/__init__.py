"""Errors of a mosaic: how unsure its points are, and what overlaps and known points take out of them.

`ground_points` and `strips` below (how points answer to errors; lines as pictures), `joint` (all errors together) and
`uncertainty`; `ties`, `matching`, `registration`, `calibration`. Arrays in, arrays out.
"""
