in vec2 at;
uniform sampler2D sky_picture;
uniform mat3 screen_to_map;
uniform float exposure;
layout(location = 0) out vec4 out_colour;
layout(location = 1) out uint out_id;

const float PARABOLOID_REACH = 1.25;

void main() {
    vec3 direction = normalize(screen_to_map * vec3(at, 1.0));
    vec2 paraboloid = direction.xy / (1.0 + max(direction.z, 0.0)) / (2.0 * PARABOLOID_REACH) + 0.5;
    vec3 encoded = texture(sky_picture, paraboloid).rgb;
    vec3 t = 3.0 * exposure * encoded * encoded;
    vec3 shown = sqrt(1.0 - 1.0 / (1.0 + t * (1.0 + t * (0.5 + t / 6.0))));
    out_colour = vec4(mix(shown, shown * shown * (3.0 - 2.0 * shown), 0.45), 1.0);
    out_id = 0u;
}
