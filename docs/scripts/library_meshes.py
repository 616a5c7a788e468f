"""The meshes of the vehicle library, made of primitives: `python -m docs.scripts.library_meshes`."""

import numpy as np
import trimesh

from rovtwin.vehicle.description.files import LIBRARY

make = trimesh.creation


def rounded(length: float, width: float, height: float, power: float = 4.0) -> trimesh.Trimesh:
    """A block with round edges: |x/a|^p + |y/b|^p + |z/c|^p = 1."""
    ball = make.icosphere(subdivisions=3)
    ball.vertices /= np.linalg.norm(ball.vertices, ord=power, axis=1, keepdims=True)
    return ball.apply_scale(0.5 * np.array([length, width, height]))


def tube(length: float, radius: float, *place: float) -> trimesh.Trimesh:
    """A tube with round ends along x."""
    body = make.capsule(height=length - 2 * radius, radius=radius, count=[10, 20])
    body.apply_translation(-body.bounds.mean(axis=0))
    body.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    return body.apply_translation(place)


def tilt_six() -> trimesh.Trimesh:
    """A float over a pressure tube and two skids; the shells do not touch, so that their volumes add up."""
    float_block = rounded(0.44, 0.33, 0.09).apply_translation([0, 0, -0.10])
    skids = [tube(0.40, 0.018, 0, y, 0.125) for y in (-0.13, 0.13)]
    return trimesh.util.concatenate([float_block, tube(0.38, 0.06, 0.01, 0, 0.015), *skids])


def main() -> None:
    """Write them, z down as vehicle files have it."""
    folder = LIBRARY / "meshes"
    folder.mkdir(exist_ok=True)
    tilt_six().export(folder / "tilt_six.stl")


if __name__ == "__main__":
    main()
