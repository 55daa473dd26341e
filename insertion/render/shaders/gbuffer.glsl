// What a fragment of the model is made of, before any light.
struct Facts {
    vec3 place;
    vec3 normal;     // with the normal map, on the eye's side
    vec3 geometric;  // without it
    vec4 base;       // linear
    vec3 glow;
    float metal;
    float rough;
};
