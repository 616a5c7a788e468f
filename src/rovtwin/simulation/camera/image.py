"""From brightness to the picture that a camera delivers: motion blur, noise, tone."""

import numpy as np
from jaxtyping import Float, UInt8

from rovtwin.core.vision import opencv

GAMMA = 1.0 / 2.2
_TABLE = np.round(255.0 * (np.arange(4096) / 4095.0) ** GAMMA).astype(np.uint8)


def toned(colour: Float[np.ndarray, "*axes"]) -> UInt8[np.ndarray, "*axes"]:
    """Grey levels of linear brightness, 1 is full scale; uint8 of the same shape."""
    return _TABLE[np.clip(colour * 4095.0 + 0.5, 0.0, 4095.0).astype(np.uint16)]


def noisy(image: UInt8[np.ndarray, "*axes"], std: float, seed: int) -> UInt8[np.ndarray, "*axes"]:
    """With noise of a standard deviation [grey levels] on every pixel and band, the same for the same seed."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(std)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def moved(
    lens_flow: Float[np.ndarray, "H W 2"], colour: Float[np.ndarray, "H W 3"], samples: int
) -> Float[np.ndarray, "H W 3"]:
    """Blurred by motion: the mean of the picture shifted along its flow, half of it before and half after.

    Args:
        lens_flow: How far each pixel's content moves while the shutter is open [px].
        colour: Linear brightness.
        samples: How many shifts.
    """
    cv2 = opencv("motion blur")
    height, width = colour.shape[:2]
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    total = np.zeros_like(colour)
    for share in (np.arange(samples) + 0.5) / samples - 0.5:
        at = x + np.float32(share) * lens_flow[..., 0], y + np.float32(share) * lens_flow[..., 1]
        total += cv2.remap(colour, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return total / samples
