"""The sample in PyTorch at toy size, by a configuration file of tiny-cuda-nn."""

import json
import sys

import numpy as np
import pytest
from torch_modules import torch

from warp_neural.errors import InputError
from warp_neural.imaging.image import load_image, save_image
from warp_neural.samples.torch_image import __main__ as sample
from warp_neural.samples.torch_image.learn import colours

CONFIG = {
    "loss": {"otype": "L2"},
    "optimizer": {"otype": "EMA", "nested": {"otype": "Adam", "learning_rate": 2e-2, "l2_reg": 1e-6}},
    "encoding": {"otype": "HashGrid", "n_levels": 4, "log2_hashmap_size": 8, "base_resolution": 4},
    "network": {"otype": "FullyFusedMLP", "n_neurons": 16, "n_hidden_layers": 1},
}


@pytest.fixture
def image(tmp_path):
    """A red ramp and a green one, with a blue square."""
    y, x = np.mgrid[:24, :32] / 31
    picture = np.stack([x, y, (x > 0.5) * (y > 0.3)], axis=-1).astype(np.float32)
    save_image(tmp_path / "image.png", picture, color_space="srgb")
    return tmp_path / "image.png"


def test_a_picture_is_learned(device, image, tmp_path):
    (tmp_path / "config.json").write_text(json.dumps(CONFIG))
    common = {"device": device.alias, "out": tmp_path, "image": image, "config": tmp_path / "config.json", "json": True}
    few, many = (sample.main(sample.Config(**common, steps=steps, batch=512)) for steps in (1, 150))
    assert few["psnr"] < 15 and many["psnr"] > 21
    assert load_image(tmp_path / "picture.png").shape == (24, 64, 3)
    assert sample.main(sample.Config(**common, steps=1, batch=512))["psnr"] == pytest.approx(few["psnr"], abs=1e-3)


def test_colours_are_bilinear():
    """Of four pixels; beyond their centres, the nearest."""
    image = torch.arange(12.0).reshape(2, 2, 3)
    uv = torch.tensor([[0.25, 0.25], [0.5, 0.25], [0.5, 0.5], [0.0, 1.0], [0.375, 0.75]])
    assert colours(image, uv)[:, 0].tolist() == [0.0, 1.5, 4.5, 6.0, 6.75]


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"loss": {"otype": "L3"}}, "loss otype 'L3': this sample has L2, RelativeL2"),
        ({"optimizer": {"otype": "Shampoo"}}, "optimizer otype 'Shampoo': this sample has Adam"),
        ({"network": {"otype": "FullyFusedMLP", "n_neuron": 1}}, "did you mean 'n_neurons'?"),
    ],
)
def test_what_is_not_understood_is_named(image, tmp_path, change, text):
    (tmp_path / "config.json").write_text(json.dumps(CONFIG | change))
    with pytest.raises(InputError) as error:
        sample.main(sample.Config(device="cpu", out=tmp_path, image=image, config=tmp_path / "config.json"))
    assert text in str(error.value)


@pytest.mark.parametrize("text", ["[]", "{", '{"loss": {}}'])
def test_files_that_are_no_configuration(image, tmp_path, text):
    (tmp_path / "config.json").write_text(text)
    with pytest.raises(InputError, match="give a JSON file of tiny-cuda-nn"):
        sample.main(sample.Config(device="cpu", out=tmp_path, image=image, config=tmp_path / "config.json"))


def test_without_pytorch_it_says_what_to_install(image, tmp_path, monkeypatch):
    for name in [name for name in sys.modules if "torch" in name and name.startswith("warp_neural")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(InputError, match=r"pip install 'warp-neural\[torch\]'"):
        sample.main(sample.Config(device="cpu", out=tmp_path, image=image))
