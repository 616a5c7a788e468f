"""Added mass of a vehicle's shapes by the panel method, all parts together, beside the sum of the parts.

    python docs/scripts/added_mass_panels.py double_blueye
    python docs/scripts/added_mass_panels.py --boxes

The first prints where `hydrodynamics.added_mass` of double_blueye comes from; the second the boxes to which the end
loss in rovtwin.vehicle.hydrodynamics is fitted. Needs capytaine (pip install capytaine), which is not a dependency yet.
Unbounded water, direct boundary integral method; panels of about `--panel` metres.
"""

import argparse

import capytaine as cpt
import numpy as np

from rovtwin.vehicle import load_vehicle
from rovtwin.vehicle.assembly import bodies
from rovtwin.vehicle.hydrodynamics import Solid, added_mass
from rovtwin.vehicle.rigid_body import HERE, Placement

BOXES = ((1, 1, 1), (1, 1, 0.5), (1, 0.5, 0.5), (1, 0.5, 0.25), (1, 0.53, 0.73), (1, 1, 0.2), (2, 1, 0.4))


def solids(body, placement=HERE):
    """All shapes of a description, with their place in b."""
    if body.shape is not None:
        solid = Solid.of(body.shape)
        yield solid, solid.placement.after(placement)
    for part in body.parts:
        inner = Placement.of(part.pose.position, part.pose.attitude_deg).after(placement)
        yield from solids(part, inner)


def mesh_of(solid, placement, panel):
    """Panels of a box or cylinder, placed in b."""
    count = [max(3, int(round(d / panel))) for d in solid.size]
    if solid.kind == "box":
        mesh = cpt.mesh_parallelepiped(size=tuple(solid.size), resolution=tuple(count), missing_sides=set())
    elif solid.kind == "cylinder":
        mesh = cpt.mesh_horizontal_cylinder(
            length=solid.size[0], radius=solid.size[1] / 2, resolution=(3, 16, max(4, count[0]))
        )
    else:
        raise SystemExit(f"no mesh for {solid.kind}")
    vertices = placement.position + np.asarray(mesh.vertices) @ placement.rotation.T
    return cpt.Mesh(vertices=vertices, faces=mesh.faces)


def panel_added_mass(meshes, density):
    """M_A of all meshes moving as one body, about the origin, shape (6, 6)."""
    mesh = meshes[0]
    for other in meshes[1:]:
        mesh = mesh.join_meshes(other)
    body = cpt.FloatingBody(mesh=mesh, dofs=cpt.rigid_body_dofs(rotation_center=(0, 0, 0)))
    solver, names = cpt.BEMSolver(method="direct"), list(body.dofs)
    columns = []
    for name in names:
        problem = cpt.RadiationProblem(
            body=body, radiating_dof=name, free_surface=np.inf, water_depth=np.inf, omega=1.0, rho=density
        )
        result = solver.solve(problem)
        columns.append([result.added_mass[other] for other in names])
    return np.array(columns).T


def main():
    """Print both."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vehicle", nargs="?", default="double_blueye")
    parser.add_argument("--panel", type=float, default=0.03, help="size of the panels [m]")
    parser.add_argument("--boxes", action="store_true", help="the boxes of the fit instead")
    args = parser.parse_args()
    cpt.set_logging("ERROR")
    np.set_printoptions(precision=4, suppress=True, linewidth=120)
    if args.boxes:
        for size in BOXES:
            solid = Solid("box", np.array(size, dtype=float), np.ones(3), HERE)
            panels = panel_added_mass([mesh_of(solid, HERE, min(0.08, min(size) / 4) * max(size))], 1.0).diagonal()
            formula = added_mass(solid, 1.0).diagonal()
            print(size, "panels", panels, "formula / panels", formula / panels)
        return
    vehicle = load_vehicle(args.vehicle)
    found = list(solids(vehicle.file))
    density = vehicle.assembly.density
    together = panel_added_mass([mesh_of(s, p, args.panel) for s, p in found], density)
    alone = sum(added_mass(Solid(s.kind, s.size, s.drag_coefficient, p), density) for s, p in found)
    print(f"{len(found)} shapes of {[name for name, body in bodies(vehicle.file, vehicle.name) if body.shape]}")
    print("panels, all together:\n", together)
    print("sum of the parts by formula:\n", alone)


if __name__ == "__main__":
    main()
