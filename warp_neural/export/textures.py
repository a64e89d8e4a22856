"""Neural textures for engines in shaders: a function that samples the latent textures, filtered by hardware, and
evaluates the network. In the second group or space: 0 a sampler, linear and repeating, then the latent textures."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np
import warp as wp

from warp_neural.errors import InputError
from warp_neural.export.language import INDENT
from warp_neural.export.program import Program
from warp_neural.export.shaders import Shader
from warp_neural.export.statements import Set, number
from warp_neural.kernels.texture.block_latents import SPREAD
from warp_neural.kernels.texture.spec import DETAIL_SCALE
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.engine import EngineTexture
from warp_neural.texture.state import Map

LN2 = number(log(2))


@dataclass(frozen=True)
class TextureText:
    """sampler, texture: declarations. fetch: the three channels of a latent texture at `uv` and `lod`, as `c0`, ...
    head, tail: of the function, around `x`, the call of `evaluate` and `y`. call: how an entry calls it."""

    sampler: str
    texture: str
    fetch: str
    head: str
    evaluate: str
    tail: str
    call: tuple[str, str]


_HLSL = TextureText(
    sampler="SamplerState filtering : register(s0, space1);",
    texture="Texture2D<float4> latent_{g} : register(t{binding}, space1);",
    fetch="float3 c{g} = latent_{g}.SampleLevel(filtering, uv, lod).rgb;",
    head="void sample_texture(float2 uv, float lod, out float y[{n_out}]) {{\n    float x[{n_in}];",
    evaluate="evaluate(x, y);",
    tail="}",
    call=("evaluate(x, y);", "sample_texture(float2(x[0], x[1]), x[2], y);"),
)
TEXTS = {
    "hlsl": _HLSL,
    "slang": TextureText(
        **vars(_HLSL)
        | {
            "sampler": "[[vk::binding(0, 1)]] SamplerState filtering;",
            "texture": "[[vk::binding({binding}, 1)]] Texture2D<float4> latent_{g};",
        }
    ),
    "glsl": TextureText(
        **vars(_HLSL)
        | {
            "sampler": "layout(set = 1, binding = 0) uniform sampler filtering;",
            "texture": "layout(set = 1, binding = {binding}) uniform texture2D latent_{g};",
            "fetch": "vec3 c{g} = textureLod(sampler2D(latent_{g}, filtering), uv, lod).rgb;",
            "head": _HLSL.head.replace("float2", "vec2"),
            "call": ("evaluate(x, y);", "sample_texture(vec2(x[0], x[1]), x[2], y);"),
        }
    ),
    "wgsl": TextureText(
        sampler="@group(1) @binding(0) var filtering: sampler;",
        texture="@group(1) @binding({binding}) var latent_{g}: texture_2d<f32>;",
        fetch="let c{g} = textureSampleLevel(latent_{g}, filtering, uv, lod).rgb;",
        head="fn sample_texture(uv: vec2<f32>, lod: f32) -> array<f32, {n_out}> {{\n    var x: array<f32, {n_in}>;",
        evaluate="var y = evaluate(x);",
        tail="    return y;\n}",
        call=("evaluate(x);", "sample_texture(vec2<f32>(x[0], x[1]), x[2]);"),
    ),
}


def check_target(target: str) -> None:
    if target not in (known := (*TEXTS, "html")):
        raise InputError(f"a texture is not exported to {target}; give one of {', '.join(known)}")


def texture_source(language: str, shader: Shader, program: Program, state: BlockState, about: str) -> str:
    """A shader whose rows are (u, v, level of detail), and whose results are channels as maps store them."""
    text, latents = TEXTS[language], range(len(state.spec.scales))
    declared = [text.sampler, *(text.texture.format(g=g, binding=g + 1) for g in latents)]
    lines = [text.head.format(n_in=program.n_in, n_out=program.n_out)]
    lines += [INDENT + text.fetch.format(g=g) for g in latents]
    lines += [shader.lines(tuple(latent_inputs(program, state))) + INDENT + text.evaluate]
    lines += [shader.lines(tuple(stored(state.maps))) + text.tail]
    return shader.source(program, about, around="\n".join([*declared, *lines]), call=text.call)


def latent_inputs(program: Program, state: BlockState) -> list[Set]:
    """`x` of what was fetched."""
    places = [(g, c) for g in range(len(state.spec.scales)) for c in range(3)]
    inputs = [Set(f"x[{3 * g + c}]", f"{number(SPREAD)} * (c{g}.{'rgb'[c]} - 0.5f)") for g, c in places]
    detail = Set(f"x[{program.n_in - 1}]", f"lod / {number(DETAIL_SCALE)}")
    return [*inputs, detail] if state.spec.mips > 1 else inputs


USE = """The network reads {count} latent textures, which lie beside it as `{first}` and so on: load them as any
texture, linear (not sRGB), with a sampler that filters linearly and repeats. `sample_texture(uv, lod)` reads all of
them at the level of detail `lod` (explicit: their sizes differ), evaluates the network once, and gives channels as maps
store them:

| channels | map | kind |
|---|---|---|
{rows}

Rows of the entry are u, v and the level of detail. In the second group (space, set): 0 the sampler, 1 and on the latent
textures.
"""


def texture_use(state: BlockState, files: Sequence[str]) -> str:
    """Of the README."""
    rows, start = [], 0
    for each in state.maps:
        end = start + len(each.trained)
        where = f"{start}" if end == start + 1 else f"{start} to {end - 1}"
        rows.append(f"| {where} | {each.name} | {each.kind} |" if each.trained else "")
        start = end
    return USE.format(count=len(files), first=files[0], rows="\n".join(filter(None, rows)))


def texture_rows(state: BlockState, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random (u, v, level of detail), and what Python samples there."""
    random = np.random.default_rng(0)
    uv, lod = random.uniform(-0.5, 1.5, (count, 2)), random.uniform(0, state.spec.mips - 1, (count, 1))
    inputs = np.concatenate([uv, lod], axis=1).astype(np.float32)
    return inputs, sampled(state, inputs)


def sampled(state: BlockState, inputs: np.ndarray) -> np.ndarray:
    """What Python samples on the CPU at (u, v, level of detail), float32 [rows, 3]."""
    texture, count = EngineTexture(state, "cpu"), len(inputs)
    sample, params_type, vec = texture.sample, texture.Params, wp.types.vector(state.spec.channels, float)

    @wp.kernel(module="unique", enable_backward=False)
    def samples(params: params_type, points: wp.array[wp.vec3], results: wp.array[vec]):
        at = points[wp.tid()]
        results[wp.tid()] = sample(params, wp.vec2(at[0], at[1]), at[2])

    results = wp.empty(count, dtype=vec, device="cpu")
    wp.launch(samples, count, [texture.params, wp.array(inputs, dtype=wp.vec3, device="cpu"), results], device="cpu")
    return results.numpy()


def stored(maps: Sequence[Map]) -> list[Set]:
    """`y` from what the network gives to what maps store; see `Map`."""
    statements, channels = [], ((each, c) for each in maps for c in each.trained)
    for i, (each, c) in enumerate(channels):
        low, size = each.low[c], each.high[c] - each.low[c]
        value = f"{number(low)} + min(max(y[{i}], 0.0f), 1.0f) * {number(size)}"
        if each.kind == "hdr":
            value = f"max(exp(({value}) * {LN2}) - {number(2.0**low)}, 0.0f)"
        statements.append(Set(f"y[{i}]", value))
    return statements
