#version 330
//!lights
// Share of the light that still reaches other things: their places and normals come as textures.
uniform sampler2D places;   // xyz local, w 0 where nothing is known
uniform sampler2D normals;
in vec2 v_at;
out vec4 share;

void main() {
    vec4 place = texture(places, v_at);
    share = vec4(1.0);
    if (place.w < 0.5) return;
    vec3 normal = texture(normals, v_at).xyz;
    vec3 all = vec3(1e-6), got = vec3(1e-6);
    for (int i = 0; i < N_LIGHTS; i++) {
        // normals from depth are rough: a floor under the cosine keeps them from deciding alone
        vec3 power = light_power[i] * (0.15 + max(dot(normal, light_direction[i]), 0.0));
        all += power;
        got += power * lit(i, place.xyz, normal);
    }
    share = vec4(got / all, 1.0);
}
