// The facts of a fragment, from its material.
uniform vec4 base_color;
uniform vec3 emissive;
uniform float metallic;
uniform float roughness;
uniform float alpha_cutoff;    // below 0: none
uniform bool has_base, has_surface, has_normal, has_emissive;
uniform sampler2D base_texture, surface_texture, normal_texture, emissive_texture;
centroid in vec3 v_place;
centroid in vec3 v_normal;
centroid in vec2 v_uv;
centroid in vec4 v_tint;
in float v_depth;
in vec3 v_extended;

vec3 linear_of(vec3 srgb) {
    return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), srgb));
}

// The normal map without stored tangents: the frame of the texture on the surface, from derivatives.
vec3 bumped(vec3 normal) {
    vec3 bump = texture(normal_texture, v_uv).xyz * 2.0 - 1.0;
    vec3 dx = dFdx(v_extended), dy = dFdy(v_extended);
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

vec4 base_here() {
    vec4 base = base_color * v_tint;
    if (has_base) {
        vec4 texel = texture(base_texture, v_uv);
        base *= vec4(linear_of(texel.rgb), texel.a);
    }
    if (alpha_cutoff >= 0.0) {
        if (base.a < alpha_cutoff) discard;
        base.a = 1.0;
    }
    return base;
}

Facts facts_here(vec4 base, vec3 eye_place) {
    Facts f;
    f.place = v_place;
    f.base = base;
    f.metal = metallic;
    f.rough = roughness;
    if (has_surface) {
        vec4 texel = texture(surface_texture, v_uv);
        f.rough *= texel.g;
        f.metal *= texel.b;
    }
    f.rough = clamp(f.rough, 0.04, 1.0);
    vec3 to_eye = normalize(eye_place - v_place);
    vec3 normal = normalize(v_normal);
    vec3 face = normalize(cross(dFdx(v_extended), dFdy(v_extended)));
    if (dot(face, to_eye) < 0.0) face = -face;
    if (dot(normal, face) < 0.0) normal = -normal;  // seen from behind: both sides of a sheet are drawn
    f.geometric = normal;
    if (has_normal) normal = bumped(normal);
    f.normal = normal;
    f.glow = emissive;
    if (has_emissive) f.glow *= linear_of(texture(emissive_texture, v_uv).rgb);
    return f;
}
