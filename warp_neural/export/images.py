"""Compute entries that fill an image, a thread a pixel: for networks of (u, v) to linear RGB."""

from warp_neural.export.program import Program
from warp_neural.export.shaders import SHADERS, Shader

SIDE = 8  # threads of a group, in both directions
BINDINGS = f"""// Bindings: 0 weights, float32 of weights.bin; 1 the image, rgba16f: x as (u, v) in [0, 1), v down, y as
// linear RGB, alpha 1. A thread a pixel, groups of {SIDE} x {SIDE}."""
BUFFERS = {
    "glsl": f"""layout(local_size_x = {SIDE}, local_size_y = {SIDE}) in;
layout(std430, binding = 0) readonly buffer Weights {{ float weights[]; }};
layout(binding = 1, rgba16f) uniform writeonly image2D image;""",
    "hlsl": """StructuredBuffer<float> weights : register(t0);
RWTexture2D<float4> image : register(u1);""",
    "slang": """[[vk::binding(0)]] StructuredBuffer<float> weights;
[[vk::binding(1)]] [format("rgba16f")] WTexture2D<float4> image;""",
    "wgsl": """@group(0) @binding(0) var<storage, read> weights: array<f32>;
@group(0) @binding(1) var image: texture_storage_2d<rgba16float, write>;""",
    "msl": "#include <metal_stdlib>\nusing namespace metal;",
}
_HLSL = f"""
[numthreads({SIDE}, {SIDE}, 1)]
void main(uint3 thread : SV_DispatchThreadID) {{
    uint width, height;
    image.GetDimensions(width, height);
    if (thread.x >= width || thread.y >= height) return;
    float x[{{n_in}}], y[{{n_out}}];
    x[0] = (float(thread.x) + 0.5) / float(width);
    x[1] = (float(thread.y) + 0.5) / float(height);
    evaluate(x, y);
    image[thread.xy] = float4(y[0], y[1], y[2], 1.0);
}}"""
ENTRIES = {
    "glsl": """
void main() {
    ivec2 size = imageSize(image), pixel = ivec2(gl_GlobalInvocationID.xy);
    if (pixel.x >= size.x || pixel.y >= size.y) return;
    float x[{n_in}], y[{n_out}];
    x[0] = (float(pixel.x) + 0.5) / float(size.x);
    x[1] = (float(pixel.y) + 0.5) / float(size.y);
    evaluate(x, y);
    imageStore(image, pixel, vec4(y[0], y[1], y[2], 1.0));
}""",
    "hlsl": _HLSL,
    "slang": _HLSL.replace("[numthreads", '[shader("compute")]\n[numthreads').replace(
        "image[thread.xy] = float4(y[0], y[1], y[2], 1.0);", "image.Store(thread.xy, float4(y[0], y[1], y[2], 1.0));"
    ),
    "wgsl": f"""
@compute @workgroup_size({SIDE}, {SIDE})
fn main(@builtin(global_invocation_id) pixel: vec3<u32>) {{
    let size = textureDimensions(image);
    if (pixel.x >= size.x || pixel.y >= size.y) {{ return; }}
    var x: array<f32, {{n_in}}>;
    x[0] = (f32(pixel.x) + 0.5) / f32(size.x);
    x[1] = (f32(pixel.y) + 0.5) / f32(size.y);
    let y = evaluate(x);
    textureStore(image, vec2<i32>(pixel.xy), vec4<f32>(y[0], y[1], y[2], 1.0));
}}""",
    "msl": """
kernel void fill(device const float* weights [[buffer(0)]], texture2d<float, access::write> image [[texture(0)]],
                 uint2 pixel [[thread_position_in_grid]]) {
    if (pixel.x >= image.get_width() || pixel.y >= image.get_height()) return;
    float x[{n_in}], y[{n_out}];
    x[0] = (float(pixel.x) + 0.5f) / float(image.get_width());
    x[1] = (float(pixel.y) + 0.5f) / float(image.get_height());
    evaluate(weights, x, y);
    image.write(float4(y[0], y[1], y[2], 1.0f), pixel);
}""",
}
USE = """

`{file}` has another entry, `{entry}`: it fills an image of 16-bit floats, rgba, with x as (u, v),
from 0 to 1, v down, and y as its colour, linear. A thread a pixel, groups of {side} x {side}. {weights}, 1
the image."""


def shows_image(program: Program) -> bool:
    return (program.n_in, program.n_out) == (2, 3)


def image_shader(target: str, own_half: bool = False) -> Shader:
    shader = SHADERS[target](own_half)
    shader.bindings, shader.buffers, shader.entry = BINDINGS, BUFFERS[target], ENTRIES[target]
    return shader
