"""Pages of networks that have learned the Disney BRDF's terms, as those of samples.shader_training: a lit sphere."""

from warp_neural.export.page_parts import TEXT, Kind, color, light_sliders, network_facts, slider, switch
from warp_neural.export.program import Program

ABOUT = (
    "A sphere under a distant light. The network knows four terms of the Disney BRDF, diffuse, specular, Fresnel and "
    "clear coat, of N.L, N.V, N.H, L.H and the roughness, as in samples.shader_training."
)
HELP = "Drag or use the arrow keys to turn the sphere; wheel, pinch, + and &minus; to come closer; 0 to start again."
VIEW = {"start": [0.15, -0.1], "lowest": -0.7, "highest": 0.7, "pans": False, "closest": 8, "farthest": 0.5}


def sphere_kind(program: Program) -> Kind:
    rows = [
        color("base_color", "Colour", "#c4613f"),
        slider("roughness", "Roughness", 0.3, 1, 0.01, 0.35),
        switch("checks", "Checks", on=True),
        color("other_color", "Colour of the others", "#e0cfb0"),
        slider("other_roughness", "Roughness of the others", 0.3, 1, 0.01, 0.6),
        slider("metallic", "Metallic", 0, 1, 0.01, 0.2),
        slider("specular", "Specular", 0, 1, 0.01, 0.5),
        slider("intensity", "Intensity of the light", 0, 10, 0.1, 3),
        light_sliders(45, 35, lowest=-90),
    ]
    facts = network_facts(program)
    return Kind((TEXT / "sphere.frag").read_text(), ABOUT, "".join(rows), facts, VIEW, HELP)
