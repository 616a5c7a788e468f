"""The numbers that both renderers shade with: light at the surface, in the water, of the lamps; exposure."""

from dataclasses import dataclass

import numpy as np

from rovtwin.simulation.camera.water import BACK, Optics
from rovtwin.simulation.scene.scene import Scene

MIRROR = 0.661  # cosine of the critical angle of water: rays steeper than this look out of the water
STEPS = 6  # of the integral of what the water scatters back of a lamp
_WHITE = 1.1  # of full scale: a white plate that faces up beside the camera; upright ones get two thirds
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # ITU-R BT.709


@dataclass(frozen=True)
class Lighting:
    """Of one picture; bands red, green, blue.

    Attributes:
        surface: Light at the surface, after exposure, shape (3,).
        below: Share of it on a face that looks down.
        caustics: Strength of the bright net.
        beam: c [1/m], shape (3,).
        diffuse: K [1/m], shape (3,).
        veil: Brightness of endless water about the camera, shape (3,).
        lamps: Per lamp position in n [m], direction in n, exponent of its beam, power: shape (n, 8).
        glow: What of a lamp's light is scattered back [1/m], shape (3,).
        tank: Whether the surface mirrors what is below it.
        eye: Centre of the camera, n [m], shape (3,).
    """

    surface: np.ndarray
    below: float
    caustics: float
    beam: np.ndarray
    diffuse: np.ndarray
    veil: np.ndarray
    lamps: np.ndarray
    glow: np.ndarray
    tank: bool
    eye: np.ndarray


def lighting(scene: Scene, position: np.ndarray, R_nb: np.ndarray, eye: np.ndarray) -> Lighting:
    """For a vehicle at `position` and a camera at `eye`, both n [m], shapes (3,)."""
    light, optics = scene.file.light, Optics.of(scene.file.water)
    day = light.surface * np.exp(-optics.diffuse * max(eye[2], 0.0))
    # A camera exposes for what it sees: daylight where it is, and its lamps on what is 2 m away.
    near = sum(lamp.power for lamp in light.lamps) / 4.0 * np.exp(-4.0 * optics.beam)
    exposure = _WHITE / max(float(_LUMINANCE @ (day + near)), 1e-4)
    return Lighting(
        np.full(3, exposure * light.surface),
        light.below,
        light.caustics,
        optics.beam,
        optics.diffuse,
        exposure * day * optics.veil,
        _lamps(scene, position, R_nb, exposure),
        np.pi * BACK / (2 * np.pi) * optics.scattering,
        scene.file.tank is not None,
        eye,
    )


def _lamps(scene: Scene, position: np.ndarray, R_nb: np.ndarray, exposure: float) -> np.ndarray:
    """A lamp's light falls off from its axis as cos^m, half at half its beam."""
    found = np.zeros((len(scene.file.light.lamps), 8))
    for i, lamp in enumerate(scene.file.light.lamps):
        axis = R_nb @ np.array(lamp.direction)
        exponent = np.log(0.5) / np.log(np.cos(np.radians(min(0.5 * lamp.beam_deg, 89.0))))
        place = position + R_nb @ np.array(lamp.position)
        found[i] = [*place, *(axis / np.linalg.norm(axis)), exponent, exposure * lamp.power]
    return found
