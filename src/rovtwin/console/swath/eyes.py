"""What of a vehicle looks down at the floor and sees a swath of it, and what measures how far below the floor is."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.core.errors import ConfigError
from rovtwin.core.numerics import as_array
from rovtwin.imaging.imager import load_imager
from rovtwin.mapping.georeference import LONGEST
from rovtwin.runs.compose.composition import vehicle_of
from rovtwin.runs.compose.sensors import sensors_of, without_own
from rovtwin.scenario.schema import Scenario
from rovtwin.vehicle.description.cameras import lens_of
from rovtwin.vehicle.description.schema import Camera, Sensor
from rovtwin.vehicle.description.totals.assembly import Mounted
from rovtwin.vehicle.physics.camera import R_DEVICE_C, seen_ray

DOWN = np.cos(np.radians(45.0))  # what looks down has its line of sight nearer to the vertical of b than this
REACH = LONGEST  # how far is seen through the water where the vehicle's file does not say: as far as a map goes [m]
ACROSS, ALONG = 33, 9  # rays across a swath, and along a camera's picture

Bundle = tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]  # where rays enter the water, their unit directions


@dataclass(frozen=True, eq=False)
class Eye:
    """Something that sees a swath of the floor.

    Attributes:
        name: Of the vehicle's sensor or camera.
        kind: `imager`, `camera` or `sonar`.
        origin: Where its rays enter the water, b [m].
        direction: Of these rays, unit vectors, b.
        reach: Longest way through the water to what is still seen [m].
        imager: Which one, name or file; "" of what is no imager.
    """

    name: str
    kind: str
    origin: Float[np.ndarray, "k 3"]
    direction: Float[np.ndarray, "k 3"]
    reach: float
    imager: str = ""


@dataclass(frozen=True, eq=False)
class Sounder:
    """An altimeter: its name, its place in b [m], and the direction of its beam, b."""

    name: str
    position: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "3"]


def eyes_of(scenario: Scenario) -> tuple[list[Eye], list[str]]:
    """What of a scenario's vehicle sees a swath, imagers first; and why something that looks down is not among it."""
    vehicle = vehicle_of(scenario)
    found: list[Eye] = []
    notes: list[str] = []
    for kind, mounted in ((k, one) for k in _BUNDLES for one in (*vehicle.sensors, *vehicle.cameras) if _is(k, one)):
        if _looks_down(mounted):
            try:
                found.append(_eye(kind, mounted))
            except ConfigError as error:
                notes.append(f"{mounted.name}: its swath is not known: {error}")
    return found, notes


def looks_down(scenario: Scenario) -> bool:
    """Whether something of a scenario's vehicle does, whose swath may be known: what `eyes_of` compiles lenses for."""
    vehicle = vehicle_of(scenario)
    return any(_is(k, one) and _looks_down(one) for k in _BUNDLES for one in (*vehicle.sensors, *vehicle.cameras))


def sounders_of(scenario: Scenario) -> list[Sounder]:
    """The altimeters that fly."""
    fitted = sensors_of(without_own(scenario), vehicle_of(scenario))
    return [
        Sounder(name, np.asarray(one.lever, float), np.asarray(one.rotation, float)[:, 0])
        for name, one in fitted.items()
        if one.kind == "altimeter"
    ]


def _looks_down(mounted: Mounted) -> bool:
    """Whether the line of sight of a sensor or a camera, its x axis, is within 45 deg of the vehicle's vertical."""
    return not mounted.spare and float(np.asarray(mounted.rotation)[2, 0]) > DOWN


def _is(kind: str, mounted: Mounted) -> bool:
    return isinstance(mounted.item, Camera) if kind == "camera" else getattr(mounted.item, "kind", "") == kind


def _eye(kind: str, mounted: Mounted) -> Eye:
    item, position, R_bs = mounted.item, np.asarray(mounted.position, float), np.asarray(mounted.rotation, float)
    assert isinstance(item, Sensor | Camera)
    point, direction = _BUNDLES[kind](item)
    reach = getattr(item, "max_range", None) or REACH
    which = getattr(item, "imager", None) or ""
    return Eye(mounted.name, kind, position + point @ R_bs.T, direction @ R_bs.T, reach, which)


def _of_imager(item: Sensor) -> Bundle:
    if item.imager is None:
        raise ConfigError("say which imager it is, such as 'imager: uhi', in the vehicle's file")
    point, direction = load_imager(item.imager).rays()
    few = np.unique(np.linspace(0, len(point) - 1, ACROSS).round().astype(int))
    return point[few], direction[few]


def _of_camera(item: Camera) -> Bundle:
    lens = lens_of(item)
    width, height = lens.size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, ACROSS), np.linspace(-0.5, height - 0.5, ALONG))
    found = seen_ray(lens, as_array(np.stack([u.ravel(), v.ravel()], axis=-1)))
    point, direction = (np.asarray(x) @ R_DEVICE_C.T for x in found)
    seen = np.isfinite(direction).all(axis=1)
    if not seen.any():
        raise ConfigError("its distortion leads no ray to its pixels; calibrate again")
    return point[seen], direction[seen]


def _of_sonar(item: Sensor) -> Bundle:
    if item.swath_deg is None:
        raise ConfigError("say how wide its fan is, such as 'swath_deg: 90', in the vehicle's file")
    angle = np.radians(np.linspace(-0.5, 0.5, ACROSS) * item.swath_deg)
    direction = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    return np.zeros_like(direction), direction


_BUNDLES: dict[str, Callable[..., Bundle]] = {"imager": _of_imager, "camera": _of_camera, "sonar": _of_sonar}
