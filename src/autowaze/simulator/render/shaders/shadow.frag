in vec2 uv;
uniform sampler2D surface;
uniform float cutout;

void main() {
    if (cutout > 0.5 && texture(surface, uv).a < 0.5) discard;
}
