#version 330
// What the plane loses of one light where the object stands between the light and the plane.
uniform float alpha_cutoff;
uniform bool has_base;
uniform sampler2D base_texture;
uniform vec3 removed;    // fraction of the light; 1 but for glass
uniform float depth;     // of the light, so that overlapping triangles count once
uniform sampler2D reaching;  // share of the light that the scene lets through
uniform vec3 direction;  // towards the light, along the plane's axes, from the object's foot
uniform float near;      // one over the light's distance
uniform float reach;     // half the side of the map
uniform vec3 power;      // irradiance across the light at the foot
uniform vec3 returned;   // what the object sends instead, over the cosine
in vec2 v_uv;
uniform bool is_other;   // an object whose shadow is already in the image
layout(location = 0) out vec4 lost;
layout(location = 1) out vec4 before;

void main() {
    if (has_base && alpha_cutoff >= 0.0 && texture(base_texture, v_uv).a < alpha_cutoff) discard;
    gl_FragDepth = depth;
    vec2 at = gl_FragCoord.xy / float(SIDE);
    vec3 away = direction - vec3((at * 2.0 - 1.0) * reach, 0.0) * near;
    float far = length(away);
    vec3 weight = power * texture(reaching, at).r * direction.z / (far * far * far);
    vec4 loss = vec4((weight - min(returned * direction.z, weight)) * removed, 1.0);
    lost = is_other ? vec4(0.0) : loss;
    before = is_other ? loss : vec4(0.0);
}
