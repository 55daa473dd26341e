// The light that a place sends to the eye.
uniform vec3 eye;              // camera centre
uniform vec3 plane_up;         // the support plane passes through the origin
uniform vec3 plane_one;        // horizontal axes
uniform vec3 plane_two;
uniform float map_radius;      // half the side of the map of light on the plane
uniform sampler2D plane_map;   // share of light that reaches the plane
uniform sampler2D environment; // equirectangular radiance, blurred more in higher levels
uniform float sharpest_level;
uniform float blurriest_level;
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
    return texture(plane_map, at * 0.5 + 0.5).rgb;
}

// Karis's fit of the environment term of a rough reflection (Lazarov; "Physically Based Shading on Mobile", 2014).
vec3 reflected_share(vec3 f0, float rough, float cosine) {
    vec4 r = rough * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
    float a = min(r.x * r.x, exp2(-9.28 * cosine)) * r.x + r.y;
    vec2 ab = vec2(-1.04, 1.04) * a + r.zw;
    return f0 * ab.x + ab.y;
}

// Linear radiance, premultiplied, and alpha.
vec4 shaded(Facts f) {
    vec3 to_eye = normalize(eye - f.place);
    float cosine = max(dot(f.normal, to_eye), 0.02);
    vec3 diffuse = vec3(0.0), open_light = vec3(1e-6), reached = vec3(0.0);
    vec3 mirror = reflect(-to_eye, f.normal);
    for (int i = 0; i < N_LIGHTS; i++) {
        vec3 direction = light_direction[i];
        float facing = dot(f.normal, direction);
        float lobe = max(dot(mirror, direction), 0.0);
        if (facing <= 0.0 && lobe <= 0.0) continue;
        vec3 share = vec3(0.0);
        if (dot(f.geometric, direction) > 0.0) share = lit(i, f.place, f.geometric) * from_plane(f.place, direction);
        diffuse += max(facing, 0.0) * light_power[i] * share;
        open_light += lobe * lobe * light_power[i];
        reached += lobe * lobe * light_power[i] * share;
    }
    vec3 f0 = mix(vec3(0.04), f.base.rgb, f.metal);
    vec3 share = reflected_share(f0, f.rough, cosine);
    float level = mix(sharpest_level, blurriest_level, sqrt(f.rough));
    vec3 glossy = radiance(mirror, level) * share * (reached / open_light);
    vec3 matte = f.base.rgb * (1.0 - f.metal) * (1.0 - share) * diffuse / PI;
    return vec4(matte * f.base.a + glossy + f.glow * f.base.a, f.base.a);
}
