"""The slant layers: by how much a thing that stands higher than the floor lies farther out on the map."""

from types import SimpleNamespace

import numpy as np
import pytest
from tests.mapping.helper import imager, mount, moving

from rovtwin.core.datum import Datum
from rovtwin.imaging.floor import Plane
from rovtwin.mapping.cells.mosaic import Job
from rovtwin.mapping.georeference import Georeference
from rovtwin.mapping.projection import Projection, crs_of


@pytest.mark.parametrize("euler", [(0.0, 0.0, 0.0), (0.15, -0.1, 0.7), (-0.2, 0.1, -2.5)])
def test_a_pixel_on_what_stands_higher_lies_nearer_by_height_times_slant(euler):
    """Pixels laid on a floor 0.2 m higher come to lie nearer on the map by what the slants say, to 3 %: rays do not
    start in one point behind a flat port."""
    t, height = np.array([0.5, 2.0]), 0.2
    high, low = (
        Georeference(imager(), mount(), moving(euler), Plane(depth)).locate(t) for depth in (5.0 - height, 5.0)
    )
    box = [f(low.point[..., :2].reshape(-1, 2), axis=0) for f in (np.min, np.max)]
    projection = Projection.of(Datum(latitude=63.45, longitude=10.36), crs_of("EPSG:32632", "t"), box[0], box[1], 5.0)
    slant = np.stack(Job._slants(SimpleNamespace(projection=projection), low), axis=-1)  # pyright: ignore
    nearer = projection.to_map(low.point[..., :2]) - projection.to_map(high.point[..., :2])
    assert np.abs(nearer - height * slant).max() < 0.03 * height * np.abs(slant).max()
    assert np.abs(slant).max() > 0.2


def test_rays_that_are_level_or_rise_have_no_slant():
    """Of a wall that a mesh has: a higher thing does not lie farther out there."""
    point = np.array([[[1.0, 0.0, 5.0], [1.0, 0.0, 3.0], [1.0, 0.0, 2.0]]])
    located = SimpleNamespace(point=point, position=np.array([[0.0, 0.0, 3.0]]))
    place = np.zeros((1, 2))
    projection = Projection.of(
        Datum(latitude=63.45, longitude=10.36), crs_of("EPSG:32632", "t"), place[0], place[0], 5.0
    )
    slant = np.stack(Job._slants(SimpleNamespace(projection=projection), located), axis=-1)[0]  # pyright: ignore
    assert np.linalg.norm(slant[0]) == pytest.approx(0.5, rel=1e-3) and np.isnan(slant[1:]).all()
