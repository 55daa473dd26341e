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

// Share of a light that reaches a place past what is in an atlas: a light in a direction, one over its distance `near`.
float reaching(sampler2DShadow atlas, int i, vec3 direction, float near, vec3 right, vec3 above, vec3 centre,
               float radius, vec3 place, vec3 normal) {
    float slope = 1.0 - abs(dot(normal, towards(i, place).xyz));
    vec3 from = place + normal * radius * (0.012 + 0.035 * slope) - centre;
    float along = dot(direction, from), widening = 1.0 - along * near;
    if (widening < 0.05) return 1.0;  // behind the light
    vec2 at = vec2(dot(right, from), dot(above, from)) / widening;
    if (max(abs(at.x), abs(at.y)) > 0.97) return 1.0;
    float depth = 0.5 - 0.5 * along / widening / (2.0 * radius);
    if (depth < 0.0) return 1.0;
    vec2 tile = vec2(i % TILES, i / TILES);
    return texture(atlas, vec3((tile + 0.5 + 0.5 * at) / TILES, min(depth - 0.004, 1.0)));
}

// Share of light i that reaches a place past the object itself (0 in shadow, 1 lit).
float lit(int i, vec3 place, vec3 normal) {
    return reaching(shadow_atlas, i, light_direction[i], light_near[i], light_right[i], light_up[i], caster_centre,
                    caster_radius, place, normal);
}

#ifdef OTHERS
uniform vec3 other_direction[N_LIGHTS];  // the same lights as seen from the other objects
uniform float other_near[N_LIGHTS];
uniform vec3 other_right[N_LIGHTS];
uniform vec3 other_up[N_LIGHTS];
uniform vec3 other_centre;
uniform float other_radius;
uniform sampler2DShadow other_atlas;
#endif

// Share of light i that the other inserted objects let through.
float past_others(int i, vec3 place, vec3 normal) {
#ifdef OTHERS
    return reaching(other_atlas, i, other_direction[i], other_near[i], other_right[i], other_up[i], other_centre,
                    other_radius, place, normal);
#else
    return 1.0;
#endif
}

#ifdef SUNLIT
uniform sampler3D sunlit;  // share of the sun that the scene lets through, on a grid about the object
uniform vec3 sunlit_low;   // lower corner of the grid, and its size
uniform vec3 sunlit_size;
#endif

// Share of light i that the scene itself lets through.
float past_scene(int i, vec3 place) {
#ifdef SUNLIT
    if (light_near[i] > 0.0) return texture(sunlit, (place - sunlit_low) / sunlit_size).r;
#endif
    return 1.0;
}
