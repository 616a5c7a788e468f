"""Files of a mosaic as other programs read them: ENVI, GeoTIFF, netCDF, GeoJSON, CSV. Each module is one of them."""
