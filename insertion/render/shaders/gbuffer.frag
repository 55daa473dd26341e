#version 330
// Facts without light, to be lit once a pixel instead of once a triangle.
//!gbuffer
//!material
uniform vec3 eye;
layout(location = 0) out vec4 place_rough;
layout(location = 1) out vec4 normal_metal;
layout(location = 2) out vec4 geometric_depth;
layout(location = 3) out vec4 base_alpha;
layout(location = 4) out vec4 glow_covered;

void main() {
    Facts f = facts_here(base_here(), eye);
    place_rough = vec4(f.place, f.rough);
    normal_metal = vec4(f.normal, f.metal);
    geometric_depth = vec4(f.geometric, v_depth);
    base_alpha = f.base;
    glow_covered = vec4(f.glow, 1.0);
}
