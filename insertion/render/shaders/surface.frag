#version 330
//!lights
//!gbuffer
//!material
//!shading
uniform float transmission;      // of glass, whose light from behind is added when the layers are joined
layout(location = 0) out vec4 colour;   // linear, premultiplied
layout(location = 1) out vec4 seen;     // depth times alpha, alpha

void main() {
    vec4 base = base_here();
    float cover = base.a;  // a pane has a depth, too
    base.a = transmission > 0.0 ? 1.0 - transmission : base.a;
    colour = shaded(facts_here(base, eye));
    seen = vec4(v_depth * cover, cover, 0.0, cover);
}
