"""From parts to totals at one origin: mass, inertia, added mass, drag, and what must hold for them."""
