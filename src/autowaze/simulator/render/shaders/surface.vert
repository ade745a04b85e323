in vec3 in_position;
in vec3 in_normal;
in vec2 in_uv;
in vec4 in_tint;

uniform mat4 thing_to_map;
uniform mat4 map_to_clip;
uniform vec3 thing_tint;

out vec3 position;
out vec3 normal;
out vec2 uv;
out vec4 tint;

void main() {
    vec4 p = thing_to_map * vec4(in_position, 1.0);
    position = p.xyz;
    normal = mat3(thing_to_map) * in_normal;
    uv = in_uv;
    tint = vec4(in_tint.rgb * thing_tint, in_tint.a);
    gl_Position = map_to_clip * p;
}
