#version 330
uniform mat4 clip;
in vec3 place;
in vec3 normal;
in vec2 uv;
in vec4 tint;
out vec3 v_normal;
out vec2 v_uv;
out vec4 v_tint;

void main() {
    gl_Position = clip * vec4(place, 1.0);
    v_normal = normal;
    v_uv = uv;
    v_tint = tint;
}
