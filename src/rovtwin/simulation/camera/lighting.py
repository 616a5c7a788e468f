"""The numbers that both renderers shade with: light at the surface, in the water, of the lamps; exposure."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rovtwin.imaging.spectra.water import BACK
from rovtwin.simulation.camera.water import Optics
from rovtwin.simulation.scene.scene import Scene

MIRROR = 0.661  # cosine of the critical angle of water: rays steeper than this look out of the water
STEPS = 6  # of the integral of what the water scatters back of a lamp
SUN = (-0.33, -0.19, -0.925)  # towards the light in the water, n: aslant, so that walls and relief differ
_WHITE = 1.1  # of full scale: a white plate that faces up beside the camera; upright ones get two thirds
_OFF = 2.5  # [m]
_BALANCE, _MOST_GAIN = 0.6, 2.5
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # ITU-R BT.709


@dataclass(frozen=True)
class Lighting:
    """Of one picture; bands red, green, blue.

    Attributes:
        surface: Light at the surface, after exposure.
        below: Share of it on a face that looks down.
        caustics: Strength of the bright net.
        beam: c [1/m].
        diffuse: K [1/m].
        veil: Brightness of endless water about the camera.
        lamps: Per lamp position in n [m], direction in n, exponent of its beam, power.
        glow: What of a lamp's light is scattered back [1/m].
        gain: Of the camera in each band: its white balance.
        tank: Whether the surface mirrors what is below it.
        eye: Centre of the camera, n [m].
    """

    surface: Float[np.ndarray, "3"]
    below: float
    caustics: float
    beam: Float[np.ndarray, "3"]
    diffuse: Float[np.ndarray, "3"]
    veil: Float[np.ndarray, "3"]
    lamps: Float[np.ndarray, "n 8"]
    glow: Float[np.ndarray, "3"]
    gain: Float[np.ndarray, "3"]
    tank: bool
    eye: Float[np.ndarray, "3"]


def lighting(
    scene: Scene, position: Float[np.ndarray, "3"], R_nb: Float[np.ndarray, "3 3"], eye: Float[np.ndarray, "3"]
) -> Lighting:
    """For a vehicle at `position` and a camera at `eye`, both n [m]."""
    light, optics = scene.file.light, Optics.of(scene.file.water)
    day = light.surface * np.exp(-optics.diffuse * max(eye[2], 0.0))
    # A camera exposes for what it sees: daylight where it is, and its lamps on what is some way off.
    near = sum(lamp.power for lamp in light.lamps) / _OFF**2 * np.exp(-2.0 * _OFF * optics.beam)
    exposure = _WHITE / max(float(_LUMINANCE @ (day + near)), 1e-4)
    # Its white balance goes part of the way from the colour of a white thing there to grey.
    white = np.maximum(day * np.exp(-_OFF * optics.beam) + near, 1e-6)
    gain = np.clip((white[1] / white) ** _BALANCE, 1.0 / _MOST_GAIN, _MOST_GAIN)
    return Lighting(
        np.full(3, exposure * light.surface),
        light.below,
        light.caustics,
        optics.beam,
        optics.diffuse,
        exposure * day * optics.veil,
        _lamps(scene, position, R_nb, exposure),
        0.5 * BACK * optics.scattering,
        gain,
        scene.file.tank is not None,
        eye,
    )


def _lamps(
    scene: Scene, position: Float[np.ndarray, "3"], R_nb: Float[np.ndarray, "3 3"], exposure: float
) -> Float[np.ndarray, "n 8"]:
    """A lamp's light falls off from its axis as cos^m, half at half its beam."""
    found = np.zeros((len(scene.file.light.lamps), 8))
    for i, lamp in enumerate(scene.file.light.lamps):
        axis = R_nb @ np.array(lamp.direction)
        exponent = np.log(0.5) / np.log(np.cos(np.radians(min(0.5 * lamp.beam_deg, 89.0))))
        place = position + R_nb @ np.array(lamp.position)
        found[i] = [*place, *(axis / np.linalg.norm(axis)), exponent, exposure * lamp.power]
    return found
