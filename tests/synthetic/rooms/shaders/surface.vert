#version 330
// Places, grain coordinates and normals of the made world; see render.py for the layout of a row.
uniform mat4 clip;
uniform vec4 eye;  // third row of world to camera: depth along the optical axis
in vec3 place;
in vec3 grain;
in vec3 normal;
in vec3 first;
in vec3 second;
in vec3 style;
in float number;
out vec3 v_grain;
flat out vec3 v_normal;
flat out vec3 v_first;
flat out vec3 v_second;
flat out vec3 v_style;
flat out float v_number;
out float v_depth;

void main() {
    gl_Position = clip * vec4(place, 1.0);
    v_grain = grain;
    v_normal = normal;
    v_first = first;
    v_second = second;
    v_style = style;
    v_number = number;
    v_depth = dot(eye.xyz, place) + eye.w;
}
