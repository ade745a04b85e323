in vec3 position;
in vec3 normal;
in vec2 uv;
in vec4 tint;

uniform sampler2D surface;
uniform sampler2DShadow static_shadow;
uniform sampler2DShadow moving_shadow;
uniform sampler2D surroundings;

uniform mat4 map_to_sun;
uniform mat4 map_to_moving_sun;
uniform uint instance_id;
uniform vec3 eye;
uniform vec3 to_sun;
uniform vec3 sun;
uniform vec3 sky;
uniform vec3 ground;
uniform vec3 haze;
uniform float haze_per_m;
uniform float exposure;
uniform float gloss;
uniform float glow;
uniform float wetness;
uniform float sun_on;
uniform float moving_shadow_on;

layout(location = 0) out vec4 out_colour;
layout(location = 1) out uint out_id;

const float PARABOLOID_REACH = 1.25;
const float MIRROR_LOD = 1.0;

vec3 mirrored(vec3 direction, float blur) {
    vec2 at = direction.xy / (1.0 + max(direction.z, -0.15)) / (2.0 * PARABOLOID_REACH) + 0.5;
    vec3 encoded = textureLod(surroundings, at, MIRROR_LOD + blur).rgb;
    return encoded * encoded * 2.0;
}

float sunlit(float facing) {
    // a slope hides more of a texel's depth: lift the sample along it
    vec3 p = (map_to_sun * vec4(position, 1.0)).xyz * 0.5 + 0.5;
    p.z -= 0.0006 + 0.0012 * (1.0 - facing);
    // one tap, which filters two by two
    float lit = textureLod(static_shadow, p, 0.0);
    if (moving_shadow_on > 0.5) {
        vec3 q = (map_to_moving_sun * vec4(position, 1.0)).xyz * 0.5 + 0.5;
        if (all(greaterThan(q.xy, vec2(0.0))) && all(lessThan(q.xy, vec2(1.0))))
            lit *= textureLod(moving_shadow, q - vec3(0.0, 0.0, 0.0025), 0.0);
    }
    return lit;
}

vec3 film(vec3 light) {
    // 1 - exp(-t), by three terms of its series
    vec3 t = 1.5 * exposure * light;
    vec3 shown = sqrt(1.0 - 1.0 / (1.0 + t * (1.0 + t * (0.5 + t / 6.0))));
    return mix(shown, shown * shown * (3.0 - 2.0 * shown), 0.45);
}

void main() {
    vec4 texel = texture(surface, uv, -0.5);
    float coverage = 1.0;
#ifdef CUTOUT
    // sharpen what the mip levels blurred, so that leaves do not thin out with distance
    coverage = (texel.a - 0.5) / max(fwidth(texel.a), 0.0001) + 0.5;
    if (coverage < 0.5) discard;
    coverage = 1.0;
#endif
#ifdef DECAL
    coverage = texel.a;
    if (coverage < 0.004) discard;
#endif
    vec3 n = normalize(normal);
    vec3 view = eye - position;
    float range = length(view);
    view /= range;
#ifdef CUTOUT
    if (dot(n, view) < 0.0) n = -0.6 * n;
#endif
    float facing = max(dot(n, to_sun), 0.0);
    vec3 albedo = texel.rgb * texel.rgb;
#ifdef OPAQUE
    float tinted = smoothstep(0.57, 0.64, texel.a);
    albedo *= mix(vec3(1.0), tint.rgb * tint.rgb, tinted);
    float mirror = max(tinted * gloss, smoothstep(0.46, 0.52, texel.a) * (1.0 - tinted));
#else
    albedo *= tint.rgb * tint.rgb;
    float mirror = 0.0;
#endif
    float wet = wetness * smoothstep(0.7, 0.95, n.z);
    albedo *= 1.0 - 0.45 * wet;
    float lit = 0.0;
    if (sun_on > 0.5 && facing > 0.0) lit = sunlit(facing);
    vec3 ambient = mix(ground, sky, n.z * 0.5 + 0.5) * tint.a;
    vec3 light = albedo * (ambient + sun * (facing * lit));
#ifdef CUTOUT
    light += albedo * sun * (0.22 * max(-dot(n, to_sun), 0.0) + 0.06);
#endif
    if (mirror > 0.01 || wet > 0.01) {
        vec3 bumped = n;
        if (wet > 0.01) bumped = normalize(n + vec3(texel.rg - texel.gb, 0.0) * 0.25 + (texel.r - 0.35) * vec3(0.05, 0.03, 0.0));
        vec3 reflected = reflect(-view, bumped);
        float grazing = 1.0 - max(dot(bumped, view), 0.0);
        float g2 = grazing * grazing;
        float fresnel = 0.06 + 0.94 * g2 * g2;
        float strength = clamp(fresnel * max(mirror, 0.55 * wet) * 1.25, 0.0, 1.0);
        light = mix(light, mirrored(reflected, 4.5 * wet) * (0.35 + 0.65 * tint.a), strength);
        float spark = max(dot(reflected, to_sun), 0.0);
        spark *= spark; spark *= spark; spark *= spark; spark *= spark; spark *= spark; spark *= spark;
        light += sun * (spark * lit * (1.6 * mirror * mirror + 0.6 * wet));
    }
    light += glow * texel.rgb * texel.rgb;
    float clear = 1.0 / (1.0 + haze_per_m * range);
    light = mix(haze, light, clear);
    out_colour = vec4(film(light), coverage);
    out_id = instance_id;
}
