"""Light and water of a scene for the equations of `imaging.radiance`."""

from rovtwin.imaging.imager import Imager
from rovtwin.imaging.radiance import Radiometry, fine_wavelengths
from rovtwin.simulation.camera.lighting import SUN
from rovtwin.simulation.imager.water import spectral_water
from rovtwin.simulation.scene.schema import SceneFile


def radiometry_of(imager: Imager, scene: SceneFile, longest: float) -> Radiometry:
    """An imager and its lamps in a scene's water and daylight; nothing is seen beyond `longest` [m]."""
    water, light = spectral_water(scene.water, fine_wavelengths(imager)), scene.light
    x, y, z = (float(part) for part in SUN)
    return Radiometry(imager, water, longest, light.surface, light.below, (x, y, z))
