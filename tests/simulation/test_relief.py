"""One floor for what sounds it, what stands on it, and what looks at it."""

import numpy as np
import pytest

from rovtwin.core.numerics import jax, jnp
from rovtwin.runs.compose.world import on_world_floor, relief_of, world_of
from rovtwin.scenario.schema import WorldSection
from rovtwin.simulation.relief import Relief
from rovtwin.simulation.scene import load_scene

HILLS = Relief.of(5.0, (0.1, -0.05), [(0.2, 7.0, 0.5)]).with_hills(0.8, 6.0, 3, 30.0)
PLACES = np.random.default_rng(2).uniform(-14.0, 14.0, (50, 2))


def test_slope_is_the_gradient_of_the_depth():
    _, slope = HILLS.depth_and_slope(PLACES)
    for axis in (0, 1):
        step = 1e-5 * np.eye(2)[axis]
        rise = HILLS.depth_and_slope(PLACES + step)[0] - HILLS.depth_and_slope(PLACES - step)[0]
        assert np.allclose(slope[:, axis], rise / 2e-5, atol=1e-8)


def test_numpy_and_jax_have_one_floor():
    depth, slope = HILLS.depth_and_slope(PLACES)
    both = jax.jit(jax.vmap(HILLS.under))(jnp.asarray(PLACES))
    assert np.allclose(depth, both[0], atol=1e-12) and np.allclose(slope, both[1], atol=1e-12)


def test_hills_are_as_high_as_asked_for():
    alone = Relief.of(0.0).with_hills(0.8, 6.0, 3, 30.0)
    axis = np.linspace(-15.0, 15.0, 121)
    depth = alone.depth_and_slope(np.stack(np.meshgrid(axis, axis, indexing="ij"), -1))[0]
    assert np.abs(depth).max() == pytest.approx(0.4, abs=0.012 + 1e-9)


def test_altimeter_collision_camera_and_imager_have_one_floor():
    world = WorldSection.model_validate(
        {
            "floor": 4.5,
            "relief": {"slope": [0.02, 0.0], "hills": {"height": 0.3, "length": 5.0, "seed": 9, "size": 40.0}},
        }
    )
    floor = relief_of(world)
    assert floor is not None
    scene = on_world_floor(load_scene("shoal"), world)
    (bottom,) = [mesh for mesh in scene.meshes if mesh.name == "bottom"]
    seen = bottom.vertices[np.abs(bottom.vertices[:, :2]).max(axis=1) < 5.0][::37]
    assert len(seen) > 20
    around = world_of(world)
    bounds = jax.jit(lambda place: around.bounds_at(place))
    for north, east, down in seen:
        walls, altimeter, _ = bounds(jnp.array([north, east, 3.0]))
        assert float(altimeter) == pytest.approx(down, abs=1e-9)
        assert walls.normals[-1] @ jnp.array([north, east, down]) == pytest.approx(float(walls.offsets[-1]), abs=1e-9)
    assert scene.floor is not None and np.allclose(
        scene.floor.depth_and_slope(PLACES)[0], floor.depth_and_slope(PLACES)[0]
    )


def test_a_scene_alone_keeps_its_own_floor_and_a_level_world_makes_it_level():
    scene = load_scene("shoal")
    assert on_world_floor(scene, WorldSection()) is scene
    level = on_world_floor(scene, WorldSection(floor=6.0))
    assert level.depth == 6.0 and not level.meshes and np.allclose(level.rectangles[0].corners[:, 2], 6.0)
    tank = load_scene("mclab")
    assert on_world_floor(tank, WorldSection(floor=6.0)) is tank and float(tank.floor.depth) == 1.5
