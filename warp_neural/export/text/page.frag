uniform vec4 view;  // (u, v) at the lower left corner, and steps a pixel
uniform vec2 size;  // of the canvas, in pixels
out vec4 color;

vec3 to_srgb(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0);
    vec3 bright = 1.055 * pow(max(x, 0.0031308), vec3(1.0 / 2.4)) - 0.055;
    return mix(x * 12.92, bright, vec3(greaterThan(x, vec3(0.0031308))));
}

vec3 to_linear(vec3 srgb) {
    vec3 bright = pow(max((srgb + 0.055) / 1.055, 0.0), vec3(2.4));
    return mix(srgb / 12.92, bright, vec3(greaterThan(srgb, vec3(0.04045))));
}
