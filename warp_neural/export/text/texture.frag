uniform float shown, automatic, level, tilt, azimuth, elevation;

const float PI = 3.14159265;

// A distant light on GGX over a Lambertian base, seen from above, in linear light.
vec3 lit_surface(vec3 albedo, vec3 normal, float roughness, float metalness, float occlusion) {
    vec2 around = radians(vec2(azimuth, elevation));
    vec3 light = vec3(cos(around.x) * cos(around.y), sin(around.x) * cos(around.y), sin(around.y));
    vec3 to_eye = vec3(0.0, 0.0, 1.0), middle = normalize(light + to_eye);
    float nl = max(dot(normal, light), 0.0), nv = max(dot(normal, to_eye), 0.05), nh = max(dot(normal, middle), 0.0);
    float a = max(roughness * roughness, 0.02), a2 = a * a, k = 0.5 * a, d = nh * nh * (a2 - 1.0) + 1.0;
    float visible = 0.25 / ((nl * (1.0 - k) + k) * (nv * (1.0 - k) + k));
    vec3 f0 = mix(vec3(0.04), albedo, metalness);
    vec3 fresnel = f0 + (1.0 - f0) * pow(1.0 - max(dot(light, middle), 0.0), 5.0);
    vec3 reflected = albedo * (1.0 - metalness) / PI + fresnel * (a2 / (PI * d * d)) * visible;
    return 4.0 * reflected * nl + 0.12 * occlusion * mix(albedo, f0, 0.5 * metalness);
}

@SHOWN@
void main() {
    vec2 offset = gl_FragCoord.xy - 0.5 * size;
    float depth = 1.0 - tilt * offset.y / size.y;  // of a plane, tilted about the canvas' middle; 0 is its horizon
    vec2 uv = view.xy + 0.5 * size * view.zw + offset * view.zw / max(depth, 0.001);
    vec2 dx = dFdx(uv) * texels, dy = dFdy(uv) * texels;
    float lod = automatic > 0.5 ? 0.5 * log2(max(dot(dx, dx), dot(dy, dy))) : level;
    float y[{n_out}];
    sample_texture(uv, clamp(lod, 0.0, last_level), y);
    color = vec4(mix(vec3(0.08, 0.09, 0.11), shown_color(y), smoothstep(0.02, 0.1, depth)), 1.0);
}
