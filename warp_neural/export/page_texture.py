"""Pages of neural textures for engines: latents filtered by hardware, one evaluation of the network, maps and light."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from warp_neural.export.gles import Gles
from warp_neural.export.page_parts import TEXT, Kind, choice, coded, light_sliders, network_facts, slider, switch
from warp_neural.export.program import Program
from warp_neural.export.statements import number
from warp_neural.export.textures import latent_inputs, stored
from warp_neural.texture.block_state import BlockState
from warp_neural.texture.state import Map

LIT = "lit"
USUAL = {"roughness": "0.6", "metalness": "0.0", "ao": "1.0"}  # where there is no such map


@dataclass(frozen=True)
class View:
    """One of the choices. result: GLSL of `y`, a vec3 as it is shown."""

    label: str
    result: str


def texture_kind(program: Program, state: BlockState) -> Kind:
    spec, views = state.spec, tuple(views_of(state.maps))
    names = ", ".join(each.name for each in state.maps)
    latents, count = [latent(state, g) for g in range(len(spec.scales))], len(spec.scales)
    size = sum(8 * len(level) for levels in state.blocks for level in levels)
    facts = (*network_facts(program), (f"{count} latent textures, BC1", f"{size:,} bytes"))
    if isinstance(psnr := state.extra.get("psnr"), float):
        facts += (("Against the maps it learned", f"{psnr:.1f} dB"),)
    about = (
        f"A neural texture of {spec.width} x {spec.height} texels and {spec.mips} mip levels with {names}: the driver "
        f"filters {count} latent textures, and one network makes all maps of them at every pixel."
    )
    data = {"aspect": spec.width / spec.height, "latents": latents, "closest": 64}
    return Kind(main_of(program, state, views), about, controls_of(views, spec.mips), facts, data)


def latent(state: BlockState, g: int) -> dict:
    rows, columns = state.spec.latents(0, g)
    return {"width": columns, "height": rows, "levels": [coded(x.astype("<u4").tobytes()) for x in state.blocks[g]]}


def main_of(program: Program, state: BlockState, views: Sequence[View]) -> str:
    spec, shader = state.spec, Gles()
    latents = range(len(spec.scales))
    lines = [f"uniform sampler2D latent_{g};" for g in latents]
    lines += [
        f"const vec2 texels = vec2({spec.width}.0, {spec.height}.0);",
        f"const float last_level = {spec.mips - 1}.0;",
        "void sample_texture(vec2 uv, float lod, out float y[{n_out}]) {",
        "    float x[{n_in}];",
        *(f"    vec3 c{g} = textureLod(latent_{g}, uv, lod).rgb;" for g in latents),
        shader.lines(tuple(latent_inputs(program, state))) + "    evaluate(x, y);",
        shader.lines(tuple(stored(state.maps))) + "}",
    ]
    cases = [f"    if (shown == {i}.0) return {view.result};" for i, view in enumerate(views[1:], 1)]
    shown = ["vec3 shown_color(float y[{n_out}]) {", *cases, f"    return {views[0].result};", "}", ""]
    return "\n".join(lines) + "\n" + (TEXT / "texture.frag").read_text().replace("@SHOWN@", "\n".join(shown))


def views_of(maps: Sequence[Map]) -> Iterator[View]:
    channels = list(channels_of(maps))
    named = {each.name: values for each, values in zip(maps, channels, strict=True)}
    if all(len(named.get(name, ())) == 3 for name in ("albedo", "normal")):
        rest = [named.get(name, (usual,))[0] for name, usual in USUAL.items()]
        surface = f"to_linear({vector(named['albedo'])}), normalize(2.0 * {vector(named['normal'])} - 1.0)"
        yield View(LIT, f"to_srgb(lit_surface({', '.join([surface, *rest])}))")
    for each, values in zip(maps, channels, strict=True):
        if each.channels <= 3:
            yield View(each.name, shown_of(each, values))
        else:
            yield View(f"{each.name}, channels 0 to 2", shown_of(each, values[:3]))
            for c in range(3, each.channels):
                yield View(f"{each.name}, channel {c}", shown_of(each, values[c : c + 1]))


def channels_of(maps: Sequence[Map]) -> Iterator[tuple[str, ...]]:
    """Of each map its channels as stored, expressions of `y`."""
    i = 0
    for each in maps:
        values = []
        for c in range(each.channels):
            values.append(f"y[{i}]" if c in each.trained else number(each.low[c]))
            i += c in each.trained
        yield tuple(values)


def vector(values: Sequence[str]) -> str:
    padded = (values[0],) * 3 if len(values) == 1 else (*values, "0.0")[:3]
    return f"vec3({', '.join(padded)})"


def shown_of(each: Map, values: Sequence[str]) -> str:
    """Codes as they are stored; beyond [0, 1] scaled to that; hdr compressed, as x / (1 + x)."""
    if each.kind == "hdr":
        return f"to_srgb({vector(values)} / (1.0 + {vector(values)}))"
    low, high = min(each.span[0], 0.0), max(each.span[1], 1.0)
    return vector(values) if (low, high) == (0, 1) else f"({vector(values)} - {number(low)}) / {number(high - low)}"


def controls_of(views: Sequence[View], mips: int) -> str:
    rows = [choice("shown", "Shown", [view.label for view in views])]
    if mips > 1:
        rows.append(switch("automatic", "Mip level by distance", on=True))
        rows.append(slider("level", "Mip level", 0, mips - 1, 0.01, 0, 'data-clears="automatic"'))
    rows.append(slider("tilt", "Tilt", 0, 1.9, 0.01, 0))
    return "".join([*rows, light_sliders(135, 40) if views[0].label == LIT else ""])
