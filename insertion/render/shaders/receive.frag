#version 330
//!lights
// Share of the light that still reaches other things: their places and normals come as textures.
uniform sampler2D places;   // xyz local, w 0 where nothing is known
uniform sampler2D normals;
uniform float light_angle[N_LIGHTS];  // solid angle that each light stands for
in vec2 v_at;
out vec4 share;

void main() {
    vec4 place = texture(places, v_at);
    share = vec4(1.0);
    if (place.w < 0.5) return;
    vec3 normal = texture(normals, v_at).xyz;
    vec3 apart = (place.xyz - caster_centre) / caster_radius;
    float hides = 3.14159265 / max(dot(apart, apart), 1.0);
    vec3 all = vec3(1e-6), got = vec3(1e-6);
    for (int i = 0; i < N_LIGHTS; i++) {
        // normals from depth are rough: a floor under the cosine keeps them from deciding alone
        vec4 light = towards(i, place.xyz);
        vec3 power = light_power[i] * past_scene(i, place.xyz) * light.w * (0.05 + max(dot(normal, light.xyz), 0.0));
        all += power;
        // far off, the object hides only a part of a light that stands for much of the sky
        got += power * (1.0 - hides / max(hides, light_angle[i]) * (1.0 - lit(i, place.xyz, normal)));
    }
    share = vec4(got / all, 1.0);
}
