// N_LIGHTS directional lights and their shadow maps, tiles of one atlas of TILES x TILES.
uniform vec3 light_direction[N_LIGHTS];   // towards the light
uniform vec3 light_power[N_LIGHTS];       // radiance times solid angle
uniform vec3 light_right[N_LIGHTS];       // the two axes of its shadow map, divided by the radius of what casts
uniform vec3 light_up[N_LIGHTS];
uniform vec3 caster_centre;
uniform float caster_radius;
uniform sampler2DShadow shadow_atlas;

// Share of light i that reaches a place (0 in shadow, 1 lit).
float lit(int i, vec3 place, vec3 normal) {
    float slope = 1.0 - abs(dot(normal, light_direction[i]));
    vec3 from = place + normal * caster_radius * (0.012 + 0.035 * slope) - caster_centre;
    vec2 at = vec2(dot(light_right[i], from), dot(light_up[i], from));
    if (max(abs(at.x), abs(at.y)) > 0.97) return 1.0;
    float depth = 0.5 - 0.5 * dot(light_direction[i], from) / (2.0 * caster_radius);
    if (depth < 0.0) return 1.0;
    vec2 tile = vec2(i % TILES, i / TILES);
    return texture(shadow_atlas, vec3((tile + 0.5 + 0.5 * at) / TILES, min(depth - 0.004, 1.0)));
}
