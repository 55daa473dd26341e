// The light that a place sends to the eye.
uniform vec3 eye;              // camera centre
uniform vec3 plane_up;         // the support plane passes through the origin
uniform vec3 plane_one;        // horizontal axes
uniform vec3 plane_two;
uniform vec3 map_centre;       // where the environment was estimated
uniform float map_radius;      // half the side of the map of light on the plane
uniform sampler2D catcher_map;   // fraction of the light that reaches the plane
uniform sampler2D environment; // equirectangular radiance, blurred more in higher levels
uniform float blurriest_level;
uniform vec3 light_returned[N_LIGHTS];  // what the object itself sends back from where it hides the light
const float PI = 3.14159265;

// Radiance of the environment in a direction.
vec3 radiance(vec3 direction, float level) {
    float height = clamp(dot(direction, plane_up), -1.0, 1.0);
    float turn = atan(dot(direction, plane_two), dot(direction, plane_one));
    return textureLod(environment, vec2(turn / (2.0 * PI) + 0.5, acos(height) / PI), level).rgb;
}

// Light that comes from below has left the support plane, where the object's own shadow dims it.
vec3 from_plane(vec3 place, vec3 direction) {
    float down = dot(direction, plane_up);
    if (down > -0.02) return vec3(1.0);
    vec3 hit = place - direction * max(dot(place, plane_up), 0.0) / down;
    vec2 at = vec2(dot(hit, plane_one), dot(hit, plane_two)) / map_radius;
    if (max(abs(at.x), abs(at.y)) > 0.99) return vec3(1.0);
    return texture(catcher_map, at * 0.5 + 0.5).rgb;
}

// Direction from the centre of the environment to what a mirrored ray meets on the plane; other surfaces are far away.
vec3 from_centre(vec3 place, vec3 direction) {
    float down = dot(direction, plane_up);
    if (down > -0.02) return direction;
    return normalize(place - direction * max(dot(place, plane_up), 0.0) / down - map_centre);
}

// Karis's fit of the environment term of a rough reflection (Lazarov; "Physically Based Shading on Mobile", 2014).
vec3 reflected_share(vec3 f0, float rough, float cosine) {
    vec4 r = rough * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
    float a = min(r.x * r.x, exp2(-9.28 * cosine)) * r.x + r.y;
    vec2 ab = vec2(-1.04, 1.04) * a + r.zw;
    return f0 * ab.x + ab.y;
}

// What a rough surface mirrors of light from a direction, times the cosine: GGX with the Smith term of glTF 2.0, B.3.2.
vec3 rough_highlight(vec3 normal, vec3 to_eye, vec3 direction, vec3 f0, float rough) {
    vec3 half_way = normalize(direction + to_eye);
    float facing = max(dot(normal, direction), 0.0), seen_at = max(dot(normal, to_eye), 0.02);
    float a2 = rough * rough * rough * rough, spread = dot(normal, half_way);
    spread = spread * spread * (a2 - 1.0) + 1.0;
    float hidden = facing * sqrt(seen_at * seen_at * (1.0 - a2) + a2) + seen_at * sqrt(facing * facing * (1.0 - a2) + a2);
    vec3 fresnel = f0 + (1.0 - f0) * pow(1.0 - max(dot(direction, half_way), 0.0), 5.0);
    return fresnel * a2 / (PI * spread * spread) * 0.5 / max(hidden, 1e-4) * facing;
}

// Linear radiance, premultiplied, and alpha.
vec4 shaded(Facts f) {
    vec3 to_eye = normalize(eye - f.place);
    float cosine = max(dot(f.normal, to_eye), 0.02);
    vec3 f0 = mix(vec3(0.04), f.base.rgb, f.metal);
    vec3 diffuse = vec3(0.0), open_light = vec3(1e-6), reached = vec3(0.0), dull = vec3(0.0);
    float dullness = smoothstep(0.6, 0.8, f.rough);  // a dull lobe is wide enough for single lights, a sharp one is not
    vec3 mirror = reflect(-to_eye, f.normal);
    float sharpness = mix(24.0, 2.0, sqrt(f.rough));  // 24: as wide as the space between the lights
    for (int i = 0; i < N_LIGHTS; i++) {
        vec4 light = towards(i, f.place);
        vec3 direction = light.xyz, power = light_power[i] * light.w;
        float facing = dot(f.normal, direction);
        if (facing <= 0.0) continue;  // behind the surface, which neither reflects nor mirrors it
        float lobe = pow(max(dot(mirror, direction), 0.0), sharpness);
        float open = dot(f.geometric, direction) > 0.0 ? lit(i, f.place, f.geometric) : 0.0;
        vec3 share = open > 0.0 ? open * past_scene(i, f.place) * from_plane(f.place, direction) : vec3(0.0);
        float past = open > 0.0 ? past_others(i, f.place, f.geometric) : 0.0;
        vec3 arriving = power * share * past + light_returned[i] * (1.0 - open * past);
        diffuse += max(facing, 0.0) * arriving;
        if (dullness > 0.0) dull += rough_highlight(f.normal, to_eye, direction, f0, f.rough) * arriving;
        open_light += lobe * power;
        reached += lobe * power * share;
    }
    vec3 share = reflected_share(f0, f.rough, cosine);
    float level = blurriest_level * sqrt(f.rough);
    vec3 glossy = mix(radiance(from_centre(f.place, mirror), level) * share * (reached / open_light), dull, dullness);
    vec3 matte = f.base.rgb * (1.0 - f.metal) * (1.0 - share) * diffuse / PI;
    vec3 light = matte * f.base.a + glossy + f.glow * f.base.a;
    // a triangle seen edge on may have no normal
    return vec4(any(isnan(light)) ? f.glow * f.base.a : light, f.base.a);
}
