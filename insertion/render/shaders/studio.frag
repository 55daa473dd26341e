#version 330
// Soft light from above, a main light over the viewer's shoulder and a weak highlight: a catalogue's picture.
uniform vec3 towards_eye;
uniform vec4 base_color;
uniform vec3 emissive;
uniform float metallic;
uniform float roughness;
uniform float alpha_cutoff;    // below 0: none
uniform bool clear;            // whether alpha blends
uniform bool has_base, has_emissive;
uniform sampler2D base_texture, emissive_texture;
in vec3 v_normal;
in vec2 v_uv;
in vec4 v_tint;
out vec4 colour;               // sRGB, premultiplied

vec3 linear_of(vec3 srgb) {
    return mix(srgb / 12.92, pow((srgb + 0.055) / 1.055, vec3(2.4)), step(vec3(0.04045), srgb));
}

vec3 srgb_of(vec3 light) {
    return mix(light * 12.92, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, step(vec3(0.0031308), light));
}

void main() {
    vec4 base = base_color * v_tint;
    if (has_base) {
        vec4 texel = texture(base_texture, v_uv);
        base *= vec4(linear_of(texel.rgb), texel.a);
    }
    if (alpha_cutoff >= 0.0 && base.a < alpha_cutoff) discard;
    vec3 normal = normalize(v_normal);
    if (dot(normal, towards_eye) < 0.0) normal = -normal;  // the back of a thin sheet
    vec3 side = normalize(cross(vec3(0.0, 1.0, 0.0), towards_eye));
    vec3 key = normalize(towards_eye + vec3(0.0, 0.9, 0.0) - 0.5 * side);
    float diffuse = 0.75 * max(dot(normal, key), 0.0);
    float sky = 0.30 + 0.20 * normal.y;
    float shine = pow(max(dot(normal, normalize(key + towards_eye)), 0.0), mix(80.0, 4.0, roughness));
    vec3 light = base.rgb * (diffuse + sky) * mix(1.0, 0.7, metallic);
    light += mix(vec3(0.04), base.rgb, metallic) * shine * mix(2.0, 0.2, roughness);
    light += has_emissive ? emissive * linear_of(texture(emissive_texture, v_uv).rgb) : emissive;
    float alpha = clear ? clamp(base.a, 0.0, 1.0) : 1.0;
    colour = vec4(srgb_of(clamp(light, 0.0, 1.0)) * alpha, alpha);
}
