#version 330
// Lights the samples of each pixel that differ, and takes their mean.
//!lights
//!gbuffer
//!shading
uniform sampler2DMS place_rough, normal_metal, geometric_depth, base_alpha, glow_covered;
layout(location = 0) out vec4 colour;   // linear, premultiplied
layout(location = 1) out vec4 seen;     // depth times alpha, alpha

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 p = vec4(0.0), n = vec4(0.0), g = vec4(0.0), b = vec4(0.0), e = vec4(0.0);  // of the sample lit last
    vec4 light = vec4(0.0);
    colour = seen = vec4(0.0);
    for (int s = 0; s < SAMPLES; s++) {
        vec4 glow = texelFetch(glow_covered, at, s);
        if (glow.w < 0.5) continue;
        vec4 place = texelFetch(place_rough, at, s), normal = texelFetch(normal_metal, at, s);
        vec4 geometric = texelFetch(geometric_depth, at, s), base = texelFetch(base_alpha, at, s);
        if (place != p || normal != n || geometric != g || base != b || glow != e) {
            p = place; n = normal; g = geometric; b = base; e = glow;
            light = shaded(Facts(p.xyz, n.xyz, g.xyz, b, e.xyz, n.w, p.w));
        }
        colour += light;
        seen += vec4(g.w * b.a, b.a, 0.0, b.a);
    }
    colour /= float(SAMPLES);
    seen /= float(SAMPLES);
}
