"""What configurations mean, and what is said of those that are not understood."""

import numpy as np
import pytest
from torch_modules import tcnn, torch

from warp_neural import InputError, encodings

MLP = {"otype": "FullyFusedMLP", "activation": "ReLU", "output_activation": "None", "n_neurons": 16}
MLP |= {"n_hidden_layers": 1}


def encoding_of(config: dict, n_in: int) -> encodings.Encoding:
    return tcnn.Encoding(n_in, config).shape.encoding


def test_defaults_are_tiny_cuda_nns():
    assert encoding_of({"otype": "hashgrid", "log2_hashmap_size": 5}, 3) == encodings.HashGrid(log2_size=5)
    assert encoding_of({"otype": "Grid", "type": "Hash", "n_levels": 2}, 2) == encodings.HashGrid(levels=2)
    assert encoding_of({"otype": "Frequency"}, 2) == encodings.Frequency(12)
    assert encoding_of({"otype": "TriangleWave"}, 2) == encodings.TriangleWave(12)
    assert encoding_of({"otype": "OneBlob"}, 2) == encodings.OneBlob(16)
    assert encoding_of({"otype": "Identity"}, 2) == encodings.Identity()
    model = tcnn.Network(4, 3, {"otype": "CutlassMLP"})
    assert model.shape.spec.sizes == (4, 128, 128, 128, 128, 128, 3)
    assert (model.n_input_dims, model.n_output_dims, model.seed) == (4, 3, 1337)
    assert (model.dtype, model.loss_scale, model.jit_fusion) == (torch.float16, 128.0, False)
    model.jit_fusion = tcnn.supports_jit_fusion()
    assert tcnn.Network(4, 3, MLP, dtype=torch.float32).loss_scale == 1.0


def test_a_dense_grid_never_hashes():
    tables = encoding_of({"otype": "DenseGrid", "n_levels": 3, "base_resolution": 40}, 2).tables(2)
    assert [table.size for table in tables] == [1600, 6400, 25600]


@pytest.mark.parametrize(
    ("config", "text"),
    [
        ({"otype": "HashGrid", "n_levls": 4}, "unknown option 'n_levls'; did you mean 'n_levels'?"),
        ({"otype": "HashGird"}, "unknown otype 'HashGird'; did you mean 'HashGrid'?"),
        ({"n_levels": 4}, "no 'otype'; give one of Identity, Frequency"),
        ({"otype": "OneBlobFrequency"}, "not supported; the nearest is a Composite of TriangleWave, OneBlob"),
        ({"otype": "HashGrid", "hash": "Rng"}, "hash 'Rng' is not supported; the nearest is 'CoherentPrime'"),
        ({"otype": "HashGrid", "stochastic_interpolation": True}, "stochastic_interpolation is not supported"),
        ({"otype": "Frequency", "n_frequencies": 2.5}, "n_frequencies=2.5; expected a whole number >= 1"),
        ({"otype": "DenseGrid"}, "a dense grid of more than 2^28 vertices; take a HashGrid"),
        ({"otype": "Composite"}, "no 'nested'; give a list of encodings"),
        ({"otype": "Composite", "nested": [{"otype": "Idntity"}]}, "nested 0: unknown otype 'Idntity'"),
        (
            {"otype": "Composite", "nested": [{"otype": "Identity", "n_dims_to_encode": 7}]},
            "nested 0: inputs 0 to 6 of 3; give fewer dimensions",
        ),
        ({"otype": "Composite", "nested": [{"otype": "Identity"}], "reduction": "Sum"}, "reduction 'Sum'"),
        ([], "encoding_config: list; expected a dictionary"),
    ],
)
def test_encodings_that_are_not_understood(config, text):
    with pytest.raises(InputError) as error:
        tcnn.Encoding(3, config)
    assert text in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("config", "text"),
    [
        ({"otype": "MegakernelMLP"}, "otype 'MegakernelMLP' is not supported; the nearest is 'FullyFusedMLP'"),
        (MLP | {"activation": "GELU"}, "unknown activation 'GELU'; give one of None, ReLU"),
        (MLP | {"n_neuron": 8}, "unknown option 'n_neuron'; did you mean 'n_neurons'?"),
        (MLP | {"n_hidden_layers": 0}, "n_hidden_layers=0; expected a whole number >= 1"),
        (MLP | {"biases": 1}, "biases=1; expected true or false"),
        (MLP | {"n_neurons": 1000}, "1000"),
    ],
)
def test_networks_that_are_not_understood(config, text):
    with pytest.raises(InputError, match="network") as error:
        tcnn.Network(3, 3, config)
    assert text in str(error.value) and "\n" not in str(error.value)


def test_arguments_that_are_not_understood():
    with pytest.raises(InputError, match=r"dtype=torch.float64: expected torch.float16 or torch.float32"):
        tcnn.Network(3, 3, MLP, dtype=torch.float64)
    with pytest.raises(InputError, match="n_output_dims=0"):
        tcnn.Network(3, 0, MLP)
    model = tcnn.Network(3, 3, MLP)
    with pytest.raises(InputError, match=r"inputs \[5, 4\]: expected a tensor \[n, 3\]"):
        model(torch.zeros(5, 4))
    with pytest.raises(InputError, match="inputs ndarray"):
        model(np.zeros((5, 3)))
    with pytest.raises(InputError, match=r"inputs of torch.int64: expected floating-point numbers"):
        model(torch.zeros(5, 3, dtype=torch.int64))
    with pytest.raises(InputError, match="inputs on meta, parameters on cpu; move one"):
        model(torch.zeros(5, 3, device="meta"))
    with pytest.raises(InputError, match=r"parameters \[7\]: expected \[512\], as tiny-cuda-nn has them"):
        model.load_tcnn_params(torch.zeros(7))
