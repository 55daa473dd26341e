#version 330
uniform float alpha_cutoff;
uniform bool has_base;
uniform sampler2D base_texture;
in vec2 v_uv;
out vec4 covered;

void main() {
    if (has_base && alpha_cutoff >= 0.0 && texture(base_texture, v_uv).a < alpha_cutoff) discard;
    covered = vec4(1.0);
}
