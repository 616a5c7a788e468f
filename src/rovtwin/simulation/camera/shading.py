"""How bright a point looks: texture, light on it, water before it. `shaders` says the same in GLSL.

Noise is value noise on an integer hash, so that both give the same texture. Reference: Perlin (2002), Improving noise,
for the idea of a hashed lattice; the hash mixes as in Appleby's MurmurHash3 (2008).
"""

from typing import Any

from jaxtyping import Float, Int

from rovtwin.core.numerics import Array, jnp
from rovtwin.simulation.camera.lighting import MIRROR, STEPS, SUN

OCTAVES = 3
NET = 0.42  # mesh of the caustics [m]
GLOW_REACH = 6.0  # to which a lamp's glow counts [m]


def _hash(x: Int[Array, "*n"], y: Int[Array, "*n"], seed: int) -> Float[Array, "*n"]:
    """In [0, 1) of a lattice point, float32."""
    h = x.astype(jnp.uint32) * jnp.uint32(0x9E3779B1) ^ y.astype(jnp.uint32) * jnp.uint32(0x85EBCA77)
    h = h ^ jnp.uint32(seed * 0x27D4EB2F & 0xFFFFFFFF)
    h = (h ^ (h >> 16)) * jnp.uint32(0x85EBCA6B)
    h = (h ^ (h >> 13)) * jnp.uint32(0xC2B2AE35)
    h = h ^ (h >> 16)
    return (h >> 8).astype(jnp.float32) * jnp.float32(1.0 / 16777216.0)


def noise(u: Float[Array, "*n"], v: Float[Array, "*n"], seed: int) -> Float[Array, "*n"]:
    """Smooth, between -1 and 1, with features of length 1."""
    fu, fv = jnp.floor(u), jnp.floor(v)
    i, j, a, b = fu.astype(jnp.int32), fv.astype(jnp.int32), u - fu, v - fv
    a, b = a * a * (3 - 2 * a), b * b * (3 - 2 * b)
    low = _hash(i, j, seed) * (1 - a) + _hash(i + 1, j, seed) * a
    high = _hash(i, j + 1, seed) * (1 - a) + _hash(i + 1, j + 1, seed) * a
    return 2 * (low * (1 - b) + high * b) - 1


def fade(wide: Float[Array, "*n"], length: Float[Array, "*n"] | float) -> Float[Array, "*n"]:
    """1 for features much longer than a pixel is wide, 0 for shorter ones."""
    return jnp.clip(1.5 - 2.0 * wide / length, 0.0, 1.0)


def mottled(
    u: Float[Array, "*n"], v: Float[Array, "*n"], wide: Float[Array, "*n"], grain: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Noise of three octaves from the length `grain` [m] down, features finer than a pixel left out."""
    total = jnp.zeros_like(u)
    for octave in range(OCTAVES):
        length = grain / 3.0**octave
        total = total + 0.5**octave * fade(wide, length) * noise(u / length, v / length, octave)
    return total


def joints(
    x: Float[Array, "*n"], wide: Float[Array, "*n"], tile: Float[Array, "*n"], joint: Float[Array, "*n"]
) -> Float[Array, "*n"]:
    """Share of a pixel that joints cover along one axis: exact for a pixel `wide` across."""
    wide = jnp.maximum(wide, 1e-6)

    def covered(at: Float[Array, "*n"]) -> Float[Array, "*n"]:  # length of joint before `at`
        whole = jnp.floor(at / tile)
        return whole * joint + jnp.minimum(at - whole * tile, joint)

    start = x + 0.5 * joint - 0.5 * wide
    return (covered(start + wide) - covered(start)) / wide


def albedo(
    m: Any, u: Float[Array, "*n"], v: Float[Array, "*n"], wide: Float[Array, "*n"], rough: Float[Array, "*n"]
) -> list[Float[Array, "*n"]]:
    """Reflectance in three bands of a material (11 numbers, arrays) at texture coordinates [m].

    `rough` is its `mottled`.
    """
    tile = jnp.maximum(m[8], 1e-3)
    lines = jnp.where(m[8] > 0, joints(u, wide, tile, m[9]), 0.0), jnp.where(m[8] > 0, joints(v, wide, tile, m[9]), 0.0)
    grout = lines[0] + lines[1] - lines[0] * lines[1]
    each = _hash(jnp.floor(u / tile).astype(jnp.int32), jnp.floor(v / tile).astype(jnp.int32), 7) - 0.5
    each = jnp.where(m[8] > 0, 0.12 * each * fade(wide, tile), 0.0)
    second = jnp.clip(grout + m[10] * jnp.clip(rough, 0.0, 1.0), 0.0, 1.0)
    gain = 1 + m[6] * rough + each
    return [(m[i] * (1 - second) + m[3 + i] * second) * gain for i in range(3)]


def bend(point: Any) -> Float[Array, "*n"]:
    """What bends the lines of the net of light, from points in n [m]."""
    u, v = _on_net(point)
    return noise(0.7 * u + 5.0, 0.7 * v, 11)


def net(point: Any, bent: Float[Array, "*n"], wide: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """The net of light below a moving surface: mean about 0, bright lines up to about 3."""
    u, v = _on_net(point)
    one, two = noise(u + bent, v, 12), noise(1.3 * u, 1.3 * v + bent, 13)
    ridge = (1 - jnp.abs(one)) * (1 - jnp.abs(two))
    ridge = ridge * ridge
    return fade(wide, NET) * jnp.exp(-jnp.abs(point[2]) / 3.0) * (4.0 * ridge * ridge - 0.4)


def _on_net(point: Any) -> tuple[Float[Array, "*n"], Float[Array, "*n"]]:
    z = jnp.abs(point[2])  # light comes in aslant
    return (point[0] + SUN[0] / SUN[2] * -z) / NET, (point[1] + SUN[1] / SUN[2] * -z) / NET


def ripple(light: Any, point: Any, sees: Any, wide: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """What ripples do to what the surface mirrors, about -1 to 1, for points above the surface (mirrored ones)."""
    share = _share(light, point)
    x, y = (light.eye[i] + share * (point[i] - light.eye[i]) for i in range(2))
    both = noise(3.0 * x, 3.0 * y, 21) + 0.6 * noise(9.0 * x, 9.0 * y, 22)
    # Seen at a grazing angle, a ripple covers few pixels along the view.
    return both * fade(share * wide / jnp.maximum(jnp.abs(sees[2]), 0.02), 0.5)


def _share(light: Any, point: Any) -> Float[Array, "*n"]:
    """Of the way to a mirrored point that lies before the surface."""
    return jnp.where(point[2] < 0, light.eye[2] / jnp.maximum(light.eye[2] - point[2], 1e-6), 1.0)


def shade(light: Any, hit: Any) -> list[Float[Array, "*n"]]:
    """Brightness in three bands, of which 1 is full scale.

    Args:
        light: Of `Lighting`, fields as arrays.
        hit: Arrays, lists of three for vectors in n: `way` from the camera [m], `direction`, `normal`, `point` (above
            the surface where that mirrors it), `albedo`, `corner` (share of light that comes there), `none` (nothing
            was hit), and `net` and `ripple` there.
    """
    mirrored = hit["point"][2] < 0
    z, n = jnp.abs(hit["point"][2]), hit["normal"]
    up = SUN[0] * n[0] + SUN[1] * n[1] + SUN[2] * jnp.where(mirrored, -n[2], n[2])
    day = (light.below + (1 - light.below) * 0.5 * (1 + up)) * hit["corner"]
    day = day * (1 + light.caustics * (0.5 + 0.5 * up) * hit["net"])
    shine, glow = _lamplight(light, hit), _glow(light, hit)
    sees = hit["direction"]
    sky = mirrored & (sees[2] < -MIRROR)
    mirror = jnp.where(mirrored, 0.88 + 0.14 * hit["ripple"], 1.0)
    way = jnp.where(sky, _share(light, hit["point"]), 1.0) * hit["way"]
    upward = jnp.clip(-sees[2], 0.0, 1.0)
    result = []
    for i in range(3):
        lit = light.surface[i] * jnp.exp(-light.diffuse[i] * z) * day + shine * jnp.exp(-light.beam[i] * hit["way"])
        seen = jnp.where(sky, light.surface[i] * (1.0 + 0.1 * hit["ripple"]), hit["albedo"][i] * lit * mirror)
        through = jnp.where(hit["none"], 0.0, jnp.exp(-light.beam[i] * way))
        veil = light.veil[i] * (1 + 3 * upward * upward)
        result.append(light.gain[i] * (seen * through + veil * (1 - through) + light.glow[i] * glow[i]))
    return result


def _lamplight(light: Any, hit: Any) -> Float[Array, "*n"]:
    """Light of the lamps on a surface; what the water takes on the lamp's way is taken as on the camera's."""
    total = jnp.zeros_like(hit["way"])
    for k in range(light.lamps.shape[0]):
        lamp = light.lamps[k]
        to = [hit["point"][i] - lamp[i] for i in range(3)]
        far2 = jnp.maximum(to[0] ** 2 + to[1] ** 2 + to[2] ** 2, 1e-2)
        far = jnp.sqrt(far2)
        along = jnp.clip(sum(to[i] * lamp[3 + i] for i in range(3)) / far, 1e-4, 1.0)
        facing = jnp.clip(-sum(to[i] * hit["normal"][i] for i in range(3)) / far, 0.0, 1.0)
        total = total + lamp[7] * along ** lamp[6] * facing / far2
    return total


def _glow(light: Any, hit: Any) -> list[Float[Array, "*n"]]:
    """What the water scatters back of the lamps along a ray, over the coefficient: a sum over a few steps."""
    reach = jnp.where(hit["none"], GLOW_REACH, jnp.minimum(hit["way"], GLOW_REACH))
    total = [jnp.zeros_like(reach) for _ in range(3)]
    for k in range(light.lamps.shape[0]):
        lamp = light.lamps[k]
        for j in range(STEPS):
            s = reach * ((j + 0.5) / STEPS) ** 2  # closer together near the camera
            ds = reach * (2 * j + 1) / STEPS**2
            to = [light.eye[i] + s * hit["direction"][i] - lamp[i] for i in range(3)]
            far2 = jnp.maximum(to[0] ** 2 + to[1] ** 2 + to[2] ** 2, 1e-2)
            along = jnp.clip(sum(to[i] * lamp[3 + i] for i in range(3)) / jnp.sqrt(far2), 1e-4, 1.0)
            shine = ds * lamp[7] * along ** lamp[6] / far2
            total = [total[i] + shine * jnp.exp(-2 * light.beam[i] * s) for i in range(3)]
    return total
