"""The figures of docs/scene.md: scenes through the vehicle's camera, the vehicle from outside, murky water.

python docs/scripts/scene.py [--out docs/figures]
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from rovtwin.simulation.camera.outside import outside_view
from rovtwin.simulation.camera.renderer import renderer
from rovtwin.simulation.camera.sensor import camera_named
from rovtwin.simulation.scene import load_scene
from rovtwin.vehicle import load_vehicle

LEVEL = np.eye(3)
SMALL = (512, 288)


def main():
    """Write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/figures"))
    folder = parser.parse_args().out
    vehicle = load_vehicle("double_blueye")
    camera = camera_named(vehicle, "port.camera", 0.5)
    views = {"mclab": (2.9, 0.3, 0.75), "pool": (1.5, 0.1, 0.9), "seabed": (0.8, 0.2, 10.6)}
    seen = [renderer(load_scene(name), camera, "gl").image(at, LEVEL) for name, at in views.items()]
    outside = outside_view(load_scene("mclab"), vehicle, (3.2, 0.4, 0.8), LEVEL, size=(960, 540))
    save(folder / "scene_views.png", [[seen[0], seen[1]], [seen[2], outside]], SMALL)
    front = outside_view(load_scene("mclab"), vehicle, (3.2, 0.4, 0.8), LEVEL, distance=1.3, bearing_deg=35.0)
    save(folder / "scene_double_blueye.png", [[front]], (800, 450))
    pool = load_scene("pool")
    murky = [
        renderer(pool.with_water(beam_attenuation=c), camera, "gl").image((3.0, 0.1, 0.9), LEVEL, seed=1)
        for c in (0.11, 0.3, 0.6, 1.0)
    ]
    save(folder / "scene_water.png", [murky], (320, 180))


def save(path, rows, size):
    """Pictures side by side; 256 colours keep the file small."""
    stacked = np.vstack([np.hstack([np.asarray(Image.fromarray(p).resize(size)) for p in row]) for row in rows])
    whole = Image.fromarray(stacked)
    whole.quantize(palette=whole.quantize(256), dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)


if __name__ == "__main__":
    main()
