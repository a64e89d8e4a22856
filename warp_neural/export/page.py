"""One HTML file that shows a network in a browser, with WebGL2, no server and no request: target html."""

from warp_neural.errors import InputError
from warp_neural.export.page_parts import Kind, page
from warp_neural.export.page_picture import picture_kind
from warp_neural.export.page_sphere import sphere_kind
from warp_neural.export.page_texture import texture_kind
from warp_neural.export.program import Program
from warp_neural.texture.block_state import BlockState

KINDS = {(2, 3): picture_kind, (5, 4): sphere_kind}  # by inputs and results
README = """# {name}

{about}.

`{name}.html` is all: open it in a browser with WebGL2, from the disk too. It asks for nothing over the network. The
weights are constants of its fragment shader, {precision}; it computes in float32.

{shows}
"""


def page_files(program: Program, name: str, about: str, texture: BlockState | None) -> dict[str, bytes]:
    """The page and the README, of an unrolled program. Raises `InputError` for networks that pages cannot show."""
    kind = kind_of(program, texture)
    readme = README.format(name=name, about=about, precision=program.precision, shows=kind.about)
    return {f"{name}.html": page(program, kind, name, about).encode(), "README.md": readme.encode()}


def kind_of(program: Program, texture: BlockState | None) -> Kind:
    if texture:
        return texture_kind(program, texture)
    sizes = program.n_in, program.n_out
    if sizes in KINDS:
        return KINDS[sizes](program)
    raise InputError(
        f"{sizes[0]} inputs and {sizes[1]} results: pages show pictures (2 inputs, 3 results), the terms of "
        "samples.shader_training (5, 4) and textures for engines; give target wgsl for others"
    )
