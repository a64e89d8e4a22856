"""The programs of docs/textures.md run as they stand; threads sorted by material read what unsorted ones read."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
import warp as wp
from test_texture_filtering import random_state

import warp_neural as wn
from warp_neural.kernels.texture.spec import Grid, TextureSpec
from warp_neural.texture.file import save_state

DOCS = Path(__file__).resolve().parent.parent / "docs" / "textures.md"
PAVING = TextureSpec(16, 16, 7, 5, (Grid(2, 4, "bilinear"), Grid(4, 3, "bilinear")), (16,))
WOOD = TextureSpec(12, 8, 5, 2, (Grid(4, 6, "bilinear"),), (8, 8))


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    """The program after it has run."""
    folder = tmp_path_factory.mktemp("docs")
    save_state(folder / "paving.wntc", random_state(PAVING))
    save_state(folder / "wood.wntc", random_state(WOOD))
    path = folder / "textures_program.py"
    path.write_text("\n".join(re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.DOTALL)))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        spec = importlib.util.spec_from_file_location("textures_program", path)  # Warp tells modules apart by name
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    return module


def test_the_program_shades(module):
    image = module.image.numpy().copy()
    assert np.isfinite(image).all() and image.min() >= 0 and image.max() <= 1 and image.std() > 0.1
    wp.launch(module.shade, image.shape[:2], inputs=[module.texture.params, 0, 1], outputs=[module.image])
    assert (module.image.numpy() != image).mean() > 0.1  # a new frame, new texels


def test_several_materials_in_one_launch(module):
    """Every thread gets a texel of its own material, sorted or not."""
    sorted_colors, (textures, specs) = module.color.numpy().copy(), ((module.texture, module.other), (PAVING, WOOD))
    material, order = module.material.numpy(), wp.array(np.arange(256), dtype=int)
    assert (np.diff(material[wn.sort_by_network(module.material).numpy()]) >= 0).all()
    module.color.zero_()
    wp.launch(module.albedo, 256, inputs=[*module.inputs[:3], order, module.uv], outputs=[module.color])
    np.testing.assert_allclose(module.color.numpy(), sorted_colors, atol=1e-3 if order.device.is_cuda else 0)
    for number, (texture, spec) in enumerate(zip(textures, specs, strict=True)):
        texels = np.concatenate(list(texture.decode().values()), -1).reshape(-1, spec.channels)[:, :3]
        own = sorted_colors[material == number]
        assert np.abs(own[:, None] - texels).max(-1).min(1).max() < 2e-3


def test_feedback_comes_to_rest(module):
    assert module.update.wanted > 0 == module.update.misses and module.virtual.bytes <= 1 << 20
