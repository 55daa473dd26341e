#version 330
//!lights
uniform vec3 eye;              // camera centre
uniform vec3 plane_up;         // the support plane passes through the origin
uniform vec3 plane_one;        // horizontal axes
uniform vec3 plane_two;
uniform float map_radius;      // half the side of the map of light on the plane
uniform sampler2D plane_map;   // share of light that reaches the plane
uniform sampler2D environment; // equirectangular radiance, blurred more in higher levels
uniform float sharpest_level;
uniform float blurriest_level;
uniform vec4 base_color;
uniform vec3 emissive;
uniform float metallic;
uniform float roughness;
uniform float alpha_cutoff;    // below 0: none
uniform bool flat_only;         // coverage alone
uniform bool has_base, has_surface, has_normal, has_emissive;
uniform sampler2D base_texture, surface_texture, normal_texture, emissive_texture;
in vec3 v_place;
in vec3 v_normal;
in vec2 v_uv;
in vec4 v_tint;
in float v_depth;
layout(location = 0) out vec4 colour;   // linear, premultiplied
layout(location = 1) out vec4 seen;     // depth times alpha, alpha

const float PI = 3.14159265;

vec3 linear_of(vec3 srgb) {
    return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), srgb));
}

// The normal map without stored tangents: the frame of the texture on the surface, from derivatives.
vec3 bumped(vec3 normal) {
    vec3 bump = texture(normal_texture, v_uv).xyz * 2.0 - 1.0;
    vec3 dx = dFdx(v_place), dy = dFdy(v_place);
    vec2 ux = dFdx(v_uv), uy = dFdy(v_uv);
    vec3 across_y = cross(dy, normal), across_x = cross(normal, dx);
    vec3 tangent = across_y * ux.x + across_x * uy.x;
    vec3 bitangent = across_y * ux.y + across_x * uy.y;
    float longest = max(dot(tangent, tangent), dot(bitangent, bitangent));
    if (!(longest > 0.0)) return normal;
    float scale = inversesqrt(longest);
    // glTF's v runs down the texture and its green up
    return normalize(tangent * scale * bump.x - bitangent * scale * bump.y + normal * bump.z);
}

// Radiance of the environment in a direction.
vec3 radiance(vec3 direction, float level) {
    float height = clamp(dot(direction, plane_up), -1.0, 1.0);
    float turn = atan(dot(direction, plane_two), dot(direction, plane_one));
    return textureLod(environment, vec2(turn / (2.0 * PI) + 0.5, acos(height) / PI), level).rgb;
}

// Light that comes from below has left the support plane, where the object's own shadow dims it.
vec3 from_plane(vec3 direction) {
    float down = dot(direction, plane_up);
    if (down > -0.02) return vec3(1.0);
    vec3 hit = v_place - direction * max(dot(v_place, plane_up), 0.0) / down;
    vec2 at = vec2(dot(hit, plane_one), dot(hit, plane_two)) / map_radius;
    if (max(abs(at.x), abs(at.y)) > 0.99) return vec3(1.0);
    return texture(plane_map, at * 0.5 + 0.5).rgb;
}

// Karis's fit of the environment term of a rough reflection (Lazarov; "Physically Based Shading on Mobile", 2014).
vec3 reflected_share(vec3 f0, float rough, float cosine) {
    vec4 r = rough * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
    float a = min(r.x * r.x, exp2(-9.28 * cosine)) * r.x + r.y;
    vec2 ab = vec2(-1.04, 1.04) * a + r.zw;
    return f0 * ab.x + ab.y;
}

void main() {
    vec4 base = base_color * v_tint;
    if (has_base) {
        vec4 texel = texture(base_texture, v_uv);
        base *= vec4(linear_of(texel.rgb), texel.a);
    }
    if (alpha_cutoff >= 0.0) {
        if (base.a < alpha_cutoff) discard;
        base.a = 1.0;
    }
    if (flat_only) {
        colour = seen = vec4(base.a);
        return;
    }
    float metal = metallic, rough = roughness;
    if (has_surface) {
        vec4 texel = texture(surface_texture, v_uv);
        rough *= texel.g;
        metal *= texel.b;
    }
    rough = clamp(rough, 0.04, 1.0);
    vec3 to_eye = normalize(eye - v_place);
    vec3 normal = normalize(v_normal);
    vec3 face = normalize(cross(dFdx(v_place), dFdy(v_place)));
    if (dot(face, to_eye) < 0.0) face = -face;
    if (dot(normal, face) < 0.0) normal = -normal;  // seen from behind: both sides of a sheet are drawn
    vec3 geometric = normal;
    if (has_normal) normal = bumped(normal);
    float cosine = max(dot(normal, to_eye), 0.02);

    vec3 diffuse = vec3(0.0), open_light = vec3(1e-6), reached = vec3(0.0);
    vec3 mirror = reflect(-to_eye, normal);
    for (int i = 0; i < N_LIGHTS; i++) {
        vec3 direction = light_direction[i];
        float facing = dot(normal, direction);
        float lobe = max(dot(mirror, direction), 0.0);
        if (facing <= 0.0 && lobe <= 0.0) continue;
        vec3 share = dot(geometric, direction) > 0.0 ? lit(i, v_place, geometric) * from_plane(direction) : vec3(0.0);
        diffuse += max(facing, 0.0) * light_power[i] * share;
        open_light += lobe * lobe * light_power[i];
        reached += lobe * lobe * light_power[i] * share;
    }
    vec3 f0 = mix(vec3(0.04), base.rgb, metal);
    vec3 share = reflected_share(f0, rough, cosine);
    float level = mix(sharpest_level, blurriest_level, sqrt(rough));
    vec3 glossy = radiance(mirror, level) * share * (reached / open_light);
    vec3 matte = base.rgb * (1.0 - metal) * (1.0 - share) * diffuse / PI;
    vec3 glow = emissive;
    if (has_emissive) glow *= linear_of(texture(emissive_texture, v_uv).rgb);
    colour = vec4(matte * base.a + glossy + glow * base.a, base.a);
    seen = vec4(v_depth * base.a, base.a, 0.0, base.a);
}
