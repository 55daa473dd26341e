#version 330
// Solid noise in several octaves, each faded out before it is finer than a pixel can show, so that features stay where they are.
uniform bool shaded;
uniform float focal;
in vec3 v_grain;
flat in vec3 v_normal;
flat in vec3 v_first;
flat in vec3 v_second;
flat in vec3 v_style;  // contrast, share of patches, coarsest grain in metres
flat in float v_number;
in float v_depth;
layout(location = 0) out vec4 colour;
layout(location = 1) out vec2 seen;  // number of the object, depth

float hash(ivec3 p) {
    uint h = uint(p.x) * 0x8da6b343u ^ uint(p.y) * 0xd8163841u ^ uint(p.z) * 0xcb1ab31fu;
    h ^= h >> 13; h *= 0x5bd1e995u; h ^= h >> 15;
    return float(h & 0xffffu) / 65535.0;
}

float noise(vec3 p) {
    ivec3 i = ivec3(floor(p));
    vec3 f = fract(p);
    f = f * f * (3.0 - 2.0 * f);
    vec4 low = vec4(hash(i), hash(i + ivec3(1, 0, 0)), hash(i + ivec3(0, 1, 0)), hash(i + ivec3(1, 1, 0)));
    vec4 high = vec4(hash(i + ivec3(0, 0, 1)), hash(i + ivec3(1, 0, 1)), hash(i + ivec3(0, 1, 1)), hash(i + ivec3(1, 1, 1)));
    vec4 z = mix(low, high, f.z);
    vec2 y = mix(z.xy, z.zw, f.y);
    return mix(y.x, y.y, f.x);
}

void main() {
    seen = vec2(v_number, v_depth);
    colour = vec4(0.0, 0.0, 0.0, 1.0);
    if (!shaded) return;
    float pixel = v_depth / focal;  // metres a pixel spans
    float grain = 0.0;
    float wave = v_style.z;
    float weight = 0.34;
    for (int octave = 0; octave < 5; octave++) {
        float kept = smoothstep(1.5, 3.5, wave / pixel);
        if (kept > 0.0) grain += kept * weight * (noise(v_grain / wave + 7.3 * float(octave)) * 2.0 - 1.0);
        wave *= 0.5;
        weight *= 0.97;
    }
    float soft = clamp(3.0 * pixel / v_style.z, 0.03, 1.0);
    float patch_ = smoothstep(-soft, soft, noise(v_grain / v_style.z * 1.3 + 91.0) - 0.55) * v_style.y;
    vec3 base = mix(v_first, v_second, patch_) * (1.0 + v_style.x * grain);
    float sun = abs(dot(v_normal, normalize(vec3(0.35, -0.55, 0.75))));
    float light = 0.55 + 0.35 * sun + 0.10 * v_normal.z * v_normal.z;
    colour = vec4(clamp(base * light, 0.0, 1.0), 1.0);
}
