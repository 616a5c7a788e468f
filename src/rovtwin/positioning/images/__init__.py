"""From images to observations: video read, markers found, how a camera sees them."""
