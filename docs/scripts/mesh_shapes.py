"""Added mass of meshes as a `shape` beside the panel method, for docs/vehicles.md.

python -m docs.scripts.mesh_shapes
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from rovtwin.identification.priors.mesh_file import mesher_of_file
from rovtwin.identification.priors.panel import panel_added_mass
from rovtwin.vehicle.description.schema import Shape
from rovtwin.vehicle.description.totals.added_mass import Solid, added_mass

make = trimesh.creation
PANELS = 900


def along_x(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """A body of revolution about z, laid along x."""
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    return mesh


def at(mesh: trimesh.Trimesh, *place: float) -> trimesh.Trimesh:
    """The mesh moved."""
    mesh.apply_translation(place)
    return mesh


def stretched(mesh: trimesh.Trimesh, *factors: float) -> trimesh.Trimesh:
    """The mesh scaled along its axes."""
    mesh.apply_scale(factors)
    return mesh


def torpedo(length: float, radius: float) -> trimesh.Trimesh:
    """A nose of one and a half, a stern of three radii (Myring's proportions), a cylinder between."""
    nose, tail = 1.5 * radius, 3.0 * radius
    ends = np.array([0.0, nose, length - tail, length])
    x = np.unique(np.concatenate([np.linspace(*pair, 13) for pair in zip(ends[:-1], ends[1:], strict=True)]))
    r = np.where(x < nose, np.sqrt(np.clip(1 - (1 - x / nose) ** 2, 0, 1)), 1.0)
    r = radius * np.where(x > length - tail, 1 - ((x - length + tail) / tail) ** 2, r)
    return along_x(make.revolve(np.column_stack([np.clip(r, 0, None), x - 0.5 * length]), sections=32))


def bodies() -> Iterator[tuple[str, trimesh.Trimesh]]:
    """What people bolt together, from primitives."""
    join = trimesh.util.concatenate
    yield "box 0.6 x 0.4 x 0.3", make.box((0.6, 0.4, 0.3))
    yield "cylinder, 3 : 1", along_x(make.cylinder(radius=0.1, height=0.6, sections=32))
    yield "ellipsoid 5 : 2 : 1.5", stretched(make.icosphere(subdivisions=3), 0.5, 0.2, 0.15)
    yield "capsule, 4 : 1", along_x(make.capsule(radius=0.1, height=0.6, count=[24, 24]))
    yield "torpedo, 9 : 1", torpedo(1.5, 0.085)
    yield "torpedo, 6 : 1", torpedo(1.0, 0.085)
    yield "elliptic cylinder across", stretched(make.cylinder(radius=0.1, height=0.3, sections=32), 2.5, 1.5, 1.0)
    yield "cone, 2 : 1", along_x(make.cone(radius=0.15, height=0.6, sections=32))
    yield "icosahedron", stretched(make.icosphere(subdivisions=0), 0.3, 0.2, 0.2)
    yield (
        "wedge",
        make.extrude_triangulation(np.array([[-0.3, -0.2], [0.3, 0.0], [-0.3, 0.2]]), np.array([[0, 1, 2]]), 0.2),
    )
    yield "flat drop", stretched(torpedo(1.0, 0.2), 0.45, 0.55, 0.2)
    yield "L of two boxes", join([make.box((0.5, 0.2, 0.2)), at(make.box((0.2, 0.2, 0.198)), -0.15, 0, -0.2)])
    yield "two hulls, gap 0.3", join([at(make.box((0.5, 0.2, 0.3)), 0, y, 0) for y in (-0.25, 0.25)])
    yield "two hulls, gap 0.1", join([at(make.box((0.5, 0.2, 0.3)), 0, y, 0) for y in (-0.15, 0.15)])
    tube = [at(along_x(make.cylinder(radius=0.06, height=0.5, sections=24)), 0, y, 0.1) for y in (-0.12, 0.12)]
    yield "float over two tubes", join([at(make.box((0.5, 0.36, 0.1)), 0, 0, -0.1), *tube])
    posts = [at(make.box((0.05, 0.05, 0.30)), x, y, 0.05) for x in (-0.3, 0.3) for y in (-0.2, 0.2)]
    skids = [at(make.box((0.65, 0.05, 0.05)), 0, y, 0.24) for y in (-0.2, 0.2)]
    yield "frame: float, posts, skids", join([at(make.box((0.65, 0.45, 0.12)), 0, 0, -0.18), *posts, *skids])
    walls = [at(make.box((0.50, 0.02, 0.228)), 0, y, 0.011) for y in (-0.15, 0.15)]
    ends = [at(make.box((0.02, 0.278, 0.228)), x, 0, 0.011) for x in (-0.24, 0.24)]
    yield "flooded hull, open below", join([at(make.box((0.50, 0.32, 0.02)), 0, 0, -0.115), *walls, *ends])
    yield "ring", make.annulus(r_min=0.12, r_max=0.2, height=0.15, sections=48)


def main() -> None:
    """Print the table, and the spread of its logarithms."""
    print("| body | surge | sway | heave | roll | pitch | yaw |\n|---|---|---|---|---|---|---|")
    logs = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "body.stl"
        for name, mesh in bodies():
            mesh.export(path)
            ours = np.diag(added_mass(Solid.of(Shape(mesh=str(path))), 1000.0))
            panel = np.diag(panel_added_mass(mesher_of_file(path), panel_size=np.sqrt(mesh.area / PANELS)).matrix)
            small = panel < 0.02 * np.array([*[panel[:3].max()] * 3, *[panel[3:].max()] * 3])
            with np.errstate(divide="ignore"):
                logs.append(np.where(small, np.nan, np.log(ours / panel)))
            cells = ["-" if s else f"{100 * (a / b - 1):+.0f} %" for s, a, b in zip(small, ours, panel, strict=True)]
            print(f"| {name} | {' | '.join(cells)} |", flush=True)
    for words, part in (("translation", np.array(logs)[:, :3]), ("rotation", np.array(logs)[:, 3:])):
        part = part[np.isfinite(part)]
        rms, largest = np.sqrt(np.mean(part**2)), np.abs(part).max()
        print(f"{words}: rms of ln {rms:.2f}, bias {part.mean():+.2f}, largest {largest:.2f}")


if __name__ == "__main__":
    main()
