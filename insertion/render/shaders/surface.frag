#version 330
//!lights
//!gbuffer
//!material
//!shading
uniform bool flat_only;         // coverage alone
layout(location = 0) out vec4 colour;   // linear, premultiplied
layout(location = 1) out vec4 seen;     // depth times alpha, alpha

void main() {
    vec4 base = base_here();
    if (flat_only) {
        colour = seen = vec4(base.a);
        return;
    }
    colour = shaded(facts_here(base, eye));
    seen = vec4(v_depth * base.a, base.a, 0.0, base.a);
}
