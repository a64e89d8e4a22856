uniform vec3 base_color, other_color;
uniform float checks, roughness, other_roughness, specular, metallic, intensity, azimuth, elevation;

const float DISTANCE = 4.0;  // of the eye from the centre of the unit sphere
const float PI = 3.14159265;

// Narkowicz's fit of the ACES film curve (2016), then gamma.
vec3 displayed(vec3 x) {
    return pow(min(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1.0), vec3(1.0 / 2.2));
}

// Where a normal is on the sphere before it is turned.
vec3 unturned(vec3 n) {
    vec2 turn = -2.2 * (view.xy + 0.5 * size * view.zw), c = cos(turn), s = sin(turn);
    vec3 upright = vec3(n.x, c.y * n.y + s.y * n.z, c.y * n.z - s.y * n.y);
    return vec3(c.x * upright.x - s.x * upright.z, upright.y, c.x * upright.z + s.x * upright.x);
}

vec3 shaded(vec3 normal, vec3 to_eye, vec3 light, vec3 base, float rough) {
    vec3 middle = normalize(light + to_eye);
    float nl = dot(normal, light);
    float x[5], y[4];
    x[0] = nl;
    x[1] = max(dot(normal, to_eye), 0.0);
    x[2] = clamp(dot(normal, middle), 0.0, 1.0);
    x[3] = clamp(dot(light, middle), 0.0, 1.0);
    x[4] = rough;
    evaluate(x, y);
    vec3 f0 = mix(vec3(0.08 * specular), base, metallic), fresnel = f0 + (1.0 - f0) * y[2];
    return displayed(intensity * nl * max(base * (y[0] * (1.0 - metallic)) + fresnel * y[1] + y[3], 0.0));
}

void main() {
    vec2 at = (gl_FragCoord.xy - 0.5 * size) * vec2(view.z, -view.w) * 2.2 / sqrt(DISTANCE * DISTANCE - 1.0);
    vec3 ray = normalize(vec3(at, -1.0)), eye = vec3(0.0, 0.0, DISTANCE);
    float along = -dot(eye, ray), inside = along * along - DISTANCE * DISTANCE + 1.0;
    vec3 normal = normalize(eye + ray * (along - sqrt(max(inside, 0.0)))), on = unturned(normal);
    vec2 check = floor(vec2(atan(on.x, on.z), asin(clamp(on.y, -1.0, 1.0))) * 6.0 / PI);
    bool other = checks > 0.5 && mod(check.x + check.y, 2.0) > 0.5;
    vec2 around = radians(vec2(azimuth, elevation));
    vec3 light = vec3(cos(around.x) * cos(around.y), sin(around.x) * cos(around.y), sin(around.y));
    color = vec4(inside > 0.0 ? vec3(0.0) : vec3(0.17, 0.18, 0.2), 1.0);  // a dark side that stands out
    if (inside > 0.0 && dot(normal, light) > 0.0) {
        vec3 base = to_linear(other ? other_color : base_color);
        color.rgb = shaded(normal, -ray, light, base, other ? other_roughness : roughness);
    }
}
