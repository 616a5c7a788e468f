"""Files of a mosaic: what was made, written and noted; its page."""
