// Anti-aliasing (FXAA, Lottes 2009) or motion blur, then the lens. Rows come out top first, channels blue first.
in vec2 at;
uniform sampler2D picture;
uniform sampler2D depth;
uniform sampler2D dirt;
uniform vec2 texel;
uniform mat4 clip_to_exposure_start;
uniform float blur_on;
uniform float vignetting;
uniform float dirt_amount;
layout(location = 0) out vec4 out_colour;

vec3 antialiased(vec2 q) {
    ivec2 here = ivec2(q / texel);
    ivec2 last = textureSize(picture, 0) - 1;
    vec3 middle = texelFetch(picture, here, 0).rgb;
    ivec2 low_corner = max(here - 1, ivec2(0)), high_corner = min(here + 1, last);
    // green stands for the luma
    float a = texelFetch(picture, low_corner, 0).g;
    float b = texelFetch(picture, ivec2(high_corner.x, low_corner.y), 0).g;
    float c = texelFetch(picture, ivec2(low_corner.x, high_corner.y), 0).g;
    float d = texelFetch(picture, high_corner, 0).g;
    float m = middle.g;
    float low = min(m, min(min(a, b), min(c, d)));
    float high = max(m, max(max(a, b), max(c, d)));
    if (high - low < 0.045) return middle;
    vec2 along = vec2(-((a + b) - (c + d)), (a + c) - (b + d));
    float soften = max((a + b + c + d) * 0.03125, 0.0078);
    along = clamp(along / (min(abs(along.x), abs(along.y)) + soften), -8.0, 8.0) * texel;
    vec3 narrow = 0.5 * (textureLod(picture, q - along / 6.0, 0.0).rgb + textureLod(picture, q + along / 6.0, 0.0).rgb);
    vec3 wide = textureLod(picture, q - along * 0.5, 0.0).rgb + textureLod(picture, q + along * 0.5, 0.0).rgb;
    wide = 0.5 * narrow + 0.25 * wide;
    return (wide.g < low || wide.g > high) ? narrow : wide;
}

void main() {
    vec2 q = vec2(at.x, 1.0 - at.y);
    vec2 shift = vec2(0.0);
    if (blur_on > 0.5) {
        vec4 before = clip_to_exposure_start * vec4(vec3(q, texelFetch(depth, ivec2(q / texel), 0).r) * 2.0 - 1.0, 1.0);
        shift = clamp((before.xy / before.w * 0.5 + 0.5) - q, -0.03, 0.03);
    }
    vec3 colour;
    if (dot(shift / texel, shift / texel) > 1.5) {
        colour = vec3(0.0);
        for (int i = 0; i < 5; i++) colour += textureLod(picture, q + shift * (float(i) / 4.0 - 0.5), 0.0).rgb;
        colour /= 5.0;
    } else {
        colour = antialiased(q);
    }
    vec2 off = (q - 0.5) * vec2(1.0, texel.x / texel.y);
    colour *= 1.0 - vignetting * dot(off, off) * 2.0;
    if (dirt_amount > 0.0) {
        float film = texture(dirt, q).r * dirt_amount;
        colour = mix(colour, vec3(0.55, 0.54, 0.50), 0.45 * film);
    }
    out_colour = vec4(colour.bgr, 1.0);
}
