// N_LIGHTS directional lights and their shadow maps, tiles of one atlas of TILES x TILES.
uniform vec3 light_direction[N_LIGHTS];   // towards the light
uniform vec3 light_power[N_LIGHTS];       // irradiance across the light, at the centre of what casts
uniform float light_near[N_LIGHTS];       // one over its distance from there, 0 for infinitely far
uniform vec3 light_right[N_LIGHTS];       // the two axes of its shadow map, divided by the radius of what casts
uniform vec3 light_up[N_LIGHTS];
uniform vec3 caster_centre;
uniform float caster_radius;
uniform sampler2DShadow shadow_atlas;

// Direction of light i from a place, and in w its power there over that at the centre.
vec4 towards(int i, vec3 place) {
    vec3 away = light_direction[i] - (place - caster_centre) * light_near[i];
    float squared = max(dot(away, away), 0.02);
    return vec4(away * inversesqrt(squared), 1.0 / squared);
}

// Share of light i that reaches a place (0 in shadow, 1 lit).
float lit(int i, vec3 place, vec3 normal) {
    float slope = 1.0 - abs(dot(normal, towards(i, place).xyz));
    vec3 from = place + normal * caster_radius * (0.012 + 0.035 * slope) - caster_centre;
    float along = dot(light_direction[i], from), widening = 1.0 - along * light_near[i];
    if (widening < 0.05) return 1.0;  // behind the light
    vec2 at = vec2(dot(light_right[i], from), dot(light_up[i], from)) / widening;
    if (max(abs(at.x), abs(at.y)) > 0.97) return 1.0;
    float depth = 0.5 - 0.5 * along / widening / (2.0 * caster_radius);
    if (depth < 0.0) return 1.0;
    vec2 tile = vec2(i % TILES, i / TILES);
    return texture(shadow_atlas, vec3((tile + 0.5 + 0.5 * at) / TILES, min(depth - 0.004, 1.0)));
}
