"""`shading` and `raycast`'s look at what was hit, in GLSL: the same names, the same numbers."""

from rovtwin.simulation.camera.lighting import MIRROR, STEPS, SUN
from rovtwin.simulation.camera.raycast import ACROSS, DARK, DARKNESS
from rovtwin.simulation.camera.shading import GLOW_REACH, NET, OCTAVES

VERTEX = """
#version 330 core
uniform mat4 clip;      // n, seen from the eye, to clip space
uniform vec3 eye;
uniform float flip;     // -1: as the surface mirrors it
uniform float cut;      // 1: only below the surface, and what is mirrored above it
uniform float ahead;    // prints come before the face that carries them
in vec3 at; in vec3 out_; in vec2 texture_; in vec2 local_; in vec4 face_; in vec2 look_;
out vec3 point; out vec3 normal; out vec2 uv; out vec2 local;
flat out vec4 face;     // size, shut edges, both sides
flat out vec2 look;     // material, layer of the print or -1
void main() {
    vec3 mirror = vec3(1.0, 1.0, flip);
    point = at * mirror; normal = out_ * mirror;
    uv = texture_; local = local_; face = face_; look = look_;
    gl_Position = clip * vec4(point - eye, 1.0);
    gl_Position.z -= look_.y >= 0.0 ? ahead : 0.0;
    gl_ClipDistance[0] = cut > 0.0 ? flip * point.z : 1.0;
}
"""

_CONSTANTS = f"""
#version 330 core
const float MIRROR = {MIRROR}, NET = {NET}, DARK = {DARK}, DARKNESS = {DARKNESS}, REACH = {GLOW_REACH};
const vec3 SUN = vec3({SUN[0]}, {SUN[1]}, {SUN[2]});
const int STEPS = {STEPS}, OCTAVES = {OCTAVES}, ACROSS = {ACROSS};
"""

_COMMON = (
    _CONSTANTS
    + """
uniform vec3 eye, beam, gain;
uniform int lamps;
uniform vec4 lamp[8]; // position and exponent, direction and power
vec3 haze(vec3 sees, float way) {
    vec3 total = vec3(0.0);
    float reach = min(way, REACH);
    for (int k = 0; k < lamps; ++k)
        for (int j = 0; j < STEPS; ++j) {
            float share = (float(j) + 0.5) / float(STEPS), s = reach * share * share;
            float ds = reach * float(2 * j + 1) / float(STEPS * STEPS);
            vec3 to = eye + s * sees - lamp[2 * k].xyz;
            float far2 = max(dot(to, to), 1e-2);
            float along = clamp(dot(to, lamp[2 * k + 1].xyz) / sqrt(far2), 1e-4, 1.0);
            total += ds * lamp[2 * k + 1].w * pow(along, lamp[2 * k].w) / far2 * exp(-2.0 * beam * s);
        }
    return total;
}
"""
)

FRAGMENT = (
    _COMMON
    + """
uniform vec3 surface, diffuse, veil, glow;
uniform float below, strength, pixel, flip;
uniform sampler2D materials;   // three texels each
uniform sampler2DArray prints; // size of the pattern in the first row of a layer of its own: see cells
uniform sampler2D cells;
in vec3 point; in vec3 normal; in vec2 uv; in vec2 local;
flat in vec4 face; flat in vec2 look;
out vec4 colour;

float hash(ivec2 p, int seed) {
    uint h = uint(p.x) * 0x9E3779B1u ^ uint(p.y) * 0x85EBCA77u;
    h ^= uint(seed) * 0x27D4EB2Fu;
    h = (h ^ (h >> 16)) * 0x85EBCA6Bu;
    h = (h ^ (h >> 13)) * 0xC2B2AE35u;
    h ^= h >> 16;
    return float(h >> 8) / 16777216.0;
}
float noise(vec2 p, int seed) {
    vec2 whole = floor(p), f = p - whole;
    ivec2 i = ivec2(whole);
    f = f * f * (3.0 - 2.0 * f);
    float low = mix(hash(i, seed), hash(i + ivec2(1, 0), seed), f.x);
    float high = mix(hash(i + ivec2(0, 1), seed), hash(i + ivec2(1, 1), seed), f.x);
    return 2.0 * mix(low, high, f.y) - 1.0;
}
float fade(float wide, float size) { return clamp(1.5 - 2.0 * wide / size, 0.0, 1.0); }
float mottled(vec2 p, float wide, float grain) {
    float total = 0.0, size = grain, part = 1.0;
    for (int octave = 0; octave < OCTAVES; ++octave) {
        float seen = fade(wide, size);
        if (seen > 0.0) total += part * seen * noise(p / size, octave);
        size /= 3.0; part *= 0.5;
    }
    return total;
}
float covered(float at, float tile, float joint) {
    float whole = floor(at / tile);
    return whole * joint + min(at - whole * tile, joint);
}
float joints(float x, float wide, float tile, float joint) {
    float start = x + 0.5 * joint - 0.5 * wide;
    return (covered(start + wide, tile, joint) - covered(start, tile, joint)) / wide;
}
vec3 albedo(float wide) {
    int row = int(look.x + 0.5);
    vec4 a = texelFetch(materials, ivec2(0, row), 0), b = texelFetch(materials, ivec2(1, row), 0);
    vec4 c = texelFetch(materials, ivec2(2, row), 0);
    vec3 first = a.rgb, second = vec3(a.a, b.rg);
    float mottle = b.b, grain = b.a, tile = c.r, joint = c.g, patches = c.b;
    float rough = mottled(uv, wide, grain), grout = 0.0, each = 0.0;
    if (tile > 0.0) {
        float w = max(wide, 1e-6), x = joints(uv.x, w, tile, joint), y = joints(uv.y, w, tile, joint);
        grout = x + y - x * y;
        each = 0.12 * (hash(ivec2(floor(uv / tile)), 7) - 0.5) * fade(wide, tile);
    }
    float share = clamp(grout + patches * clamp(rough, 0.0, 1.0), 0.0, 1.0);
    return mix(first, second, share) * (1.0 + mottle * rough + each);
}
vec3 printed(int layer, vec2 dx, vec2 dy) {
    float count = texelFetch(cells, ivec2(layer, 0), 0).r;
    int row = int(look.x + 0.5);
    vec4 a = texelFetch(materials, ivec2(0, row), 0), b = texelFetch(materials, ivec2(1, row), 0);
    float white = 0.0;
    for (int i = 0; i < ACROSS; ++i)
        for (int j = 0; j < ACROSS; ++j) {
            vec2 part = (vec2(i, j) + 0.5) / float(ACROSS) - 0.5, at = local + dx * part.x + dy * part.y;
            vec2 cell = clamp(floor(at / face.xy * count), 0.0, count - 1.0);
            white += texelFetch(prints, ivec3(int(cell.x), int(count - 1.0 - cell.y), layer), 0).r;
        }
    return mix(vec3(a.a, b.rg), a.rgb, white / float(ACROSS * ACROSS));
}
float net(float wide) {
    float seen = fade(wide, NET);
    if (seen <= 0.0) return 0.0;
    float z = abs(point.z);
    vec2 p = (point.xy - SUN.xy / SUN.z * z) / NET;
    float bent = noise(0.7 * p + vec2(5.0, 0.0), 11);
    float one = noise(p + vec2(bent, 0.0), 12), two = noise(1.3 * p + vec2(0.0, bent), 13);
    float ridge = (1.0 - abs(one)) * (1.0 - abs(two));
    ridge *= ridge;
    return seen * exp(-z / 3.0) * (4.0 * ridge * ridge - 0.4);
}
float corner() {
    int shut = int(face.z + 0.5);
    float light = 1.0;
    vec2 low = 1.0 - DARKNESS * exp(-local / DARK), high = 1.0 - DARKNESS * exp((local - face.xy) / DARK);
    if ((shut & 1) > 0) light *= low.x * high.x;
    if ((shut & 2) > 0) light *= low.y;
    if ((shut & 4) > 0) light *= high.y;
    return light;
}
float lamplight(vec3 n) {
    float total = 0.0;
    for (int k = 0; k < lamps; ++k) {
        vec3 to = point - lamp[2 * k].xyz;
        float far2 = max(dot(to, to), 1e-2), far = sqrt(far2);
        float along = clamp(dot(to, lamp[2 * k + 1].xyz) / far, 1e-4, 1.0);
        total += lamp[2 * k + 1].w * pow(along, lamp[2 * k].w) * clamp(-dot(to, n) / far, 0.0, 1.0) / far2;
    }
    return total;
}
void main() {
    vec3 ray = point - eye;
    float way = length(ray);
    vec3 sees = ray / way, n = normalize(normal);
    float towards = dot(n, sees);
    if (towards > 0.0) n = -n;
    float wide = way * pixel / max(abs(towards), 0.02);
    bool front = towards < 0.0;
    bool mirrored = flip < 0.0;
    vec2 dx = dFdx(local), dy = dFdy(local); // outside of the branch: they want the neighbours too
    vec3 look_;
    if (look.y >= 0.0 && front) look_ = printed(int(look.y + 0.5), dx, dy);
    else look_ = albedo(wide);
    float share = mirrored ? eye.z / max(eye.z - point.z, 1e-6) : 1.0;
    float rippled = 0.0;
    if (mirrored) {
        vec2 at = eye.xy + share * (point.xy - eye.xy);
        float seen = fade(share * wide / max(abs(sees.z), 0.02), 0.5);
        if (seen > 0.0) rippled = seen * (noise(3.0 * at, 21) + 0.6 * noise(9.0 * at, 22));
    }
    float up = dot(SUN, mirrored ? vec3(n.xy, -n.z) : n);
    float day = (below + (1.0 - below) * 0.5 * (1.0 + up)) * corner();
    day *= 1.0 + strength * (0.5 + 0.5 * up) * net(wide);
    bool sky = mirrored && sees.z < -MIRROR;
    vec3 lit = surface * exp(-diffuse * abs(point.z)) * day + lamplight(n) * exp(-beam * way);
    vec3 seen = sky ? surface * (1.0 + 0.1 * rippled) : look_ * lit * (mirrored ? 0.88 + 0.14 * rippled : 1.0);
    vec3 through = exp(-beam * way * (sky ? share : 1.0));
    float upward = clamp(-sees.z, 0.0, 1.0);
    vec3 result = seen * through + veil * (1.0 + 3.0 * upward * upward) * (1.0 - through) + glow * haze(sees, way);
    colour = vec4(clamp(gain * result, 0.0, 1.0), way);
}
"""
)

BACKGROUND_VERTEX = """
#version 330 core
in vec2 at;
out vec2 place;
void main() { place = at; gl_Position = vec4(at, 1.0, 1.0); }
"""

# Where nothing is: water without end.
BACKGROUND = (
    _COMMON
    + """
uniform mat3 towards; // ndc to n
uniform vec3 veil, glow;
uniform float endless;
in vec2 place;
out vec4 colour;
void main() {
    vec3 sees = normalize(towards * vec3(place, 1.0));
    float upward = clamp(-sees.z, 0.0, 1.0);
    vec3 result = veil * (1.0 + 3.0 * upward * upward) + glow * haze(sees, REACH);
    colour = vec4(clamp(gain * result, 0.0, 1.0), endless);
}
"""
)
