in vec3 in_position;
in vec2 in_uv;
uniform mat4 thing_to_map;
uniform mat4 map_to_clip;
out vec2 uv;

void main() {
    uv = in_uv;
    gl_Position = map_to_clip * (thing_to_map * vec4(in_position, 1.0));
}
