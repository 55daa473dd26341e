#version 330
in vec2 corner;
out vec2 v_at;

void main() {
    gl_Position = vec4(corner, 0.0, 1.0);
    v_at = corner * 0.5 + 0.5;
}
