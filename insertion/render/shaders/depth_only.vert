#version 330
uniform mat4 clip;
in vec3 place;
in vec2 uv;
out vec2 v_uv;

void main() {
    gl_Position = clip * vec4(place, 1.0);
    v_uv = uv;
}
