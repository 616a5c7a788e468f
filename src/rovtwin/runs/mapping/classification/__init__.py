"""Classes of a mosaic: `rovtwin map-classify`."""
