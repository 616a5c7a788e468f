"""The panel method against closed forms, against capytaine's own solver, and against itself put together otherwise."""

import time

import numpy as np
import pytest

from rovtwin.core.errors import IdentificationError
from rovtwin.identification.priors import panel
from rovtwin.identification.priors.mesh_file import mesher_of
from rovtwin.identification.priors.panel import panel_added_mass
from rovtwin.identification.priors.surface import solids, surface_of
from rovtwin.vehicle import load_vehicle, vehicle_from_dict
from rovtwin.vehicle.description.totals.added_mass import added_mass

pytest.importorskip("capytaine", reason="needs the extra 'panel'")

RHO = 1000.0


def vehicle_of(*shapes):
    parts = [{"name": f"p{i}", "mass": 1.0, "shape": shape} for i, shape in enumerate(shapes)]
    return vehicle_from_dict({"name": "v", "description": "", "parts": parts})


def diagonal(*shapes, **options):
    return np.diag(panel_added_mass(mesher_of(vehicle_of(*shapes)), **options).matrix)


def exact(shape):
    (solid,) = solids(vehicle_of(shape))
    return np.diag(added_mass(solid, RHO))


@pytest.mark.system
@pytest.mark.parametrize("shape", [{"sphere": 0.5}, {"ellipsoid": [1.0, 0.2, 0.2]}, {"ellipsoid": [0.3, 0.2, 0.1]}])
def test_ellipsoids_within_one_percent_of_lamb_in_ten_seconds(shape):
    started = time.perf_counter()
    found = panel_added_mass(mesher_of(vehicle_of(shape)))
    assert time.perf_counter() - started < 10
    np.testing.assert_allclose(np.diag(found.matrix), exact(shape), rtol=0.01, atol=1e-6)
    np.testing.assert_array_equal(found.matrix, found.matrix.T)


def test_the_box_around_the_double_blueye():
    started = time.perf_counter()
    found = panel_added_mass(mesher_of(vehicle_of({"box": [0.64, 0.95, 0.354]})), 1000.0)
    assert time.perf_counter() - started < 10
    np.testing.assert_allclose(np.diag(found.matrix)[:3], [114, 70, 279], rtol=0.02)
    assert found.error.max() < 0.02 and not found.notes


def test_the_error_reported_covers_the_error_made():
    """Coarse meshes of a spheroid: what is left of the error is no more than was said."""
    shape = {"ellipsoid": [0.5, 0.2, 0.2]}
    for size in (0.04, 0.06, 0.1):
        found = panel_added_mass(mesher_of(vehicle_of(shape)), panel_size=size)
        true = exact(shape)
        moving = true > 0
        off = np.abs(np.diag(found.matrix)[moving] / true[moving] - 1)
        assert (off < found.error[moving]).all()


def test_the_same_as_capytaines_own_direct_solver():
    import capytaine as cpt

    surface = surface_of(solids(vehicle_of({"box": [0.5, 0.4, 0.3], "center": [0.1, 0.2, -0.1]})), 0.1)
    body = cpt.FloatingBody(
        mesh=cpt.Mesh(vertices=surface.vertices, faces=surface.faces),
        dofs=cpt.rigid_body_dofs(rotation_center=(0, 0, 0)),
    )
    green = cpt.Delhommeau(tabulation_nr=10, tabulation_nz=10, tabulation_cache_dir=None)
    solver, names = cpt.BEMSolver(method="direct", green_function=green), list(body.dofs)
    theirs = np.empty((6, 6))
    for j, name in enumerate(names):
        problem = cpt.RadiationProblem(
            body=body, radiating_dof=name, free_surface=np.inf, water_depth=np.inf, omega=1.0, rho=RHO
        )
        result = solver.solve(problem)
        theirs[:, j] = [result.added_mass[other] for other in names]
    ours, pressure = panel._solve(surface, RHO, panel._Walls("unbounded"), lambda: None)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9 * np.abs(theirs).max())
    # Pressure carries the matrix.
    np.testing.assert_allclose(pressure[:, 0] @ surface.area_vectors[:, 1], ours[1, 0], atol=1e-9)


@pytest.mark.parametrize("wall", [{"floor": 1.0}, {"depth": 1.0}])
def test_a_sphere_near_a_wall(wall):
    """Lamb (1932), art. 99, 137: 1 + 3/16 (a/h)^3 along a wall, 1 + 3/8 (a/h)^3 towards it, to (a/h)^3."""
    a, h = 0.4, 1.0
    alone = 2 / 3 * np.pi * a**3 * RHO
    series = alone * (1 + np.array([3 / 16, 3 / 16, 3 / 8]) * (a / h) ** 3)
    np.testing.assert_allclose(diagonal({"sphere": a}, panel_size=0.06, **wall)[:3], series, rtol=2e-3)


def test_surface_and_floor_together():
    """Far apart each wall adds its own; between them the sum over all images counts, more than the two alone."""
    a = 0.4
    alone = 2 / 3 * np.pi * a**3 * RHO
    both = diagonal({"sphere": a}, panel_size=0.08, depth=1.0, floor=1.0)[:3] / alone
    # Along the walls all images move alike, at 2 n h on either side: each adds 3/16 (a/h)^3 / n^3, in sum zeta(3).
    zeta = sum(n**-3 for n in range(1, 1000))
    assert both[0] == pytest.approx(1 + 3 / 16 * (a / 1.0) ** 3 * 2 * zeta, rel=5e-3)
    near = diagonal({"sphere": a}, panel_size=0.08, depth=1.0)[:3] / alone
    far = diagonal({"sphere": a}, panel_size=0.08, depth=1.0, floor=20.0)[:3] / alone
    np.testing.assert_allclose(far, near, rtol=1e-3)


def test_off_centre_bodies_couple_and_keep_their_energy():
    shape = {"box": [0.4, 0.3, 0.2]}
    centred = panel_added_mass(mesher_of(vehicle_of(shape)), panel_size=0.06).matrix
    moved = panel_added_mass(mesher_of(vehicle_of({**shape, "center": [0.3, -0.2, 0.1]})), panel_size=0.06).matrix
    from rovtwin.vehicle.description.totals.added_mass import move_matrix
    from rovtwin.vehicle.solids.placement import Placement

    np.testing.assert_allclose(moved, move_matrix(centred, Placement.of([0.3, -0.2, 0.1])), rtol=1e-6, atol=1e-6)


@pytest.mark.system
@pytest.mark.parametrize(
    "halves",
    [
        (
            {"box": [0.64, 0.475, 0.354], "center": [0, -0.2375, 0]},
            {"box": [0.64, 0.475, 0.354], "center": [0, 0.2375, 0]},
        ),
        ({"box": [0.64, 0.5, 0.354], "center": [0, -0.225, 0]}, {"box": [0.64, 0.55, 0.354], "center": [0, 0.2, 0]}),
    ],
    ids=["touching", "overlapping"],
)
def test_a_box_in_two_pieces_is_the_box(halves):
    found = panel_added_mass(mesher_of(vehicle_of(*halves)))
    np.testing.assert_allclose(np.diag(found.matrix)[:3], diagonal({"box": [0.64, 0.95, 0.354]})[:3], rtol=2e-3)
    assert any("overlap or touch" in note for note in found.notes)


@pytest.mark.system
@pytest.mark.parametrize(
    ("pieces", "whole"),
    [
        (({"sphere": 0.5}, {"sphere": 0.3}), {"sphere": 0.5}),
        (({"box": [0.6, 0.4, 0.3]}, {"box": [0.3, 0.3, 0.2], "attitude_deg": [0, 0, 30]}), {"box": [0.6, 0.4, 0.3]}),
        (
            (
                {"cylinder": {"radius": 0.1, "length": 0.5}, "center": [-0.2, 0, 0]},
                {"cylinder": {"radius": 0.1, "length": 0.5}, "center": [0.15, 0, 0]},
            ),
            {"cylinder": {"radius": 0.1, "length": 0.85}},
        ),
    ],
    ids=["sphere in sphere", "turned box in box", "cylinder in cylinder"],
)
def test_parts_that_run_into_each_other_within_their_error(pieces, whole):
    found = panel_added_mass(mesher_of(vehicle_of(*pieces)))
    np.testing.assert_allclose(np.diag(found.matrix)[:3], diagonal(whole)[:3], rtol=0.06)
    assert found.error[:3].min() >= 0.05


def test_the_double_blueye_together_is_not_the_sum_of_its_parts():
    """Each hull shields the other in sway; in surge and heave they hardly meet."""
    vehicle = load_vehicle("double_blueye")
    together = np.diag(panel_added_mass(mesher_of(vehicle)).matrix)
    apart = np.diag(sum(added_mass(solid, RHO) for solid in solids(vehicle)))
    assert together[1] < 0.85 * apart[1]
    np.testing.assert_allclose(together[[0, 2]], apart[[0, 2]], rtol=0.05)
    # The file's values, made with uniform panels of 30 mm, are 2 to 4 % above the limit.
    np.testing.assert_allclose(together[[0, 1, 2, 5]], [31.3, 57.2, 44.6, 2.53], rtol=0.04)


def test_progress_counts_to_the_end():
    steps = []
    panel_added_mass(
        mesher_of(vehicle_of({"sphere": 0.2})),
        panel_size=0.1,
        depth=1.0,
        progress=lambda done, of: steps.append((done, of)),
    )
    assert [done for done, _ in steps] == list(range(1, steps[-1][1] + 1))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"depth": 0.1}, "out of the water"),
        ({"floor": 0.1}, "cuts the body"),
        ({"depth": float("nan")}, "out of the water"),
        ({"panel_size": 0.001}, "expected at most 6000"),
        ({"panel_size": -1.0}, "expected more than 0"),
    ],
)
def test_what_cannot_be_is_refused(options, message):
    with pytest.raises(IdentificationError, match=message):
        diagonal({"sphere": 0.2}, **options)


def test_the_same_part_twice_counts_once():
    shape = {"box": [0.3, 0.2, 0.2]}
    np.testing.assert_allclose(diagonal(shape, shape), diagonal(shape), rtol=1e-9, atol=1e-9)


def test_without_capytaine_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "capytaine", None)
    with pytest.raises(IdentificationError, match=r"pip install 'rovtwin\[panel\]'"):
        diagonal({"sphere": 0.2}, panel_size=0.1)


def test_the_priors_are_the_diagonal():
    found = panel_added_mass(mesher_of(vehicle_of({"sphere": 0.2})), panel_size=0.06)
    priors = found.priors()
    assert set(priors) == {"added_mass.surge", "added_mass.sway", "added_mass.heave"}
    assert priors["added_mass.surge"].median == found.matrix[0, 0]
