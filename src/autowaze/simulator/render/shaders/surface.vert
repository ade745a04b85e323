in vec3 in_position;
in vec3 in_normal;
in vec2 in_uv;
in vec4 in_tint;

uniform mat4 thing_to_map;
uniform mat4 map_to_clip;
uniform mat4 map_to_sun;
uniform mat4 map_to_moving_sun;
uniform vec3 thing_tint;

out vec3 position;
out vec3 normal;
out vec2 uv;
out vec4 tint;
out vec3 sun_position;
out vec3 moving_sun_position;

void main() {
    vec4 p = thing_to_map * vec4(in_position, 1.0);
    position = p.xyz;
    normal = mat3(thing_to_map) * in_normal;
    uv = in_uv;
    tint = vec4(in_tint.rgb * thing_tint, in_tint.a);
    sun_position = (map_to_sun * p).xyz * 0.5 + 0.5;
    moving_sun_position = (map_to_moving_sun * p).xyz * 0.5 + 0.5;
    gl_Position = map_to_clip * p;
}
