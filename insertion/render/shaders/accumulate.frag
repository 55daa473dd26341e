#version 330
// Adds what the plane loses of one light where the object stands between the light and the plane.
uniform sampler2D blocked;
uniform sampler2D reaching;  // share of the light that the scene lets through
uniform vec3 direction;  // towards the light, along the plane's axes, from the object's foot
uniform float near;      // one over the light's distance
uniform float reach;     // half the side of the map
uniform vec3 power;      // irradiance across the light at the foot
uniform vec3 returned;   // what the object sends instead, over the cosine
in vec2 v_at;
out vec4 lost;

void main() {
    vec2 at = (v_at * 2.0 - 1.0) * reach;
    vec3 away = direction - vec3(at, 0.0) * near;
    float far = length(away);
    vec3 weight = power * texture(reaching, v_at).r * direction.z / (far * far * far);
    lost = vec4((weight - min(returned * direction.z, weight)) * texture(blocked, v_at).rgb, 1.0);
}
