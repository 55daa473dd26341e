#version 330
// Change of the direction of light at a surface of glass, and the logarithm of the fraction that passes it. Both are
// sums over the surfaces that a ray crosses, in any order.
//!gbuffer
//!material
uniform vec3 eye;
uniform vec3 tint;       // fraction of the light that passes the material
uniform bool is_solid;   // a closed surface; otherwise a sheet without a thickness, which does not refract
layout(location = 0) out vec4 passed;
layout(location = 1) out vec4 bend;  // in the local frame
const float INDEX = 1.5;

void main() {
    base_here();
    vec3 normal = normalize(v_normal);
    float outside = max(abs(dot(normalize(v_place - eye), normal)), 0.02);
    float inside = sqrt(INDEX * INDEX - 1.0 + outside * outside);  // INDEX times the cosine in the glass
    float across = (outside - inside) / (outside + inside);
    float along = (inside - INDEX * INDEX * outside) / (inside + INDEX * INDEX * outside);
    float fresnel = 0.5 * (across * across + along * along);
    float surfaces = is_solid ? 1.0 : 2.0;
    passed = vec4(surfaces * log(max((1.0 - fresnel) * sqrt(tint), vec3(1e-3))), 1.0);
    bend = vec4(is_solid ? (outside - inside) * normal : vec3(0.0), 1.0);
}
