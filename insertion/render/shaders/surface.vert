#version 330
// Places are in the object's local frame: scene axes, origin at the bottom centre, unit the object's largest extent.
uniform mat4 clip;
uniform vec4 depth_row;  // third row of local to camera: depth along the optical axis
in vec3 place;
in vec3 normal;
in vec2 uv;
in vec4 tint;
centroid out vec3 v_place;  // of the covered part of a pixel: its centre may be beyond the edge, in shadow
centroid out vec3 v_normal;
centroid out vec2 v_uv;
centroid out vec4 v_tint;
out float v_depth;
out vec3 v_extended;  // the place at the pixel's centre, on the triangle's plane: its derivatives say how that faces

void main() {
    gl_Position = clip * vec4(place, 1.0);
    v_place = v_extended = place;
    v_normal = normal;
    v_uv = uv;
    v_tint = tint;
    v_depth = dot(depth_row.xyz, place) + depth_row.w;
}
