"""Cells of a mosaic: values of pixels with their noise, sums over the pixels that fall into each cell, all joined."""
