#version 330
// Adds one light's share where the object stands between it and the plane.
uniform sampler2D blocked;
uniform vec3 weight;
in vec2 v_at;
out vec4 sum;

void main() {
    sum = vec4(weight * texture(blocked, v_at).r, 1.0);
}
