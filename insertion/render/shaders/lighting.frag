#version 330
// Lights the samples of each pixel that differ, and takes their mean. Neighbouring triangles of a smooth surface do not.
//!lights
//!gbuffer
//!shading
uniform sampler2DMS place_rough, normal_metal, geometric_depth, base_alpha, glow_covered;
const float SAME_COSINE = 0.996, SAME = 0.02;  // of normals; of place in sizes of the object, colour and roughness
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
        bool is_same = dot(normal.xyz, n.xyz) > SAME_COSINE && dot(geometric.xyz, g.xyz) > SAME_COSINE;
        is_same = is_same && distance(place, p) < SAME && distance(base, b) < SAME && distance(glow, e) < SAME;
        if (!is_same || abs(normal.w - n.w) > SAME) {
            p = place; n = normal; g = geometric; b = base; e = glow;
            light = shaded(Facts(p.xyz, n.xyz, g.xyz, b, e.xyz, n.w, p.w));
        }
        colour += vec4(light.rgb, base.a);
        seen += vec4(geometric.w * base.a, base.a, 0.0, base.a);
    }
    colour /= float(SAMPLES);
    seen /= float(SAMPLES);
}
