"""Networks in our own files: they return bit for bit, and every damaged or foreign file is refused by field."""

import dataclasses
import json

import numpy as np
import pytest
import warp as wp
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from warp_neural import MLP, InputError
from warp_neural.io.tensors import load_tensors, save_tensors
from warp_neural.kernels.nn import activations, encodings
from warp_neural.kernels.nn.spec import FORMATS, INT8, NetworkSpec
from warp_neural.nn.kind import IMPLEMENTATIONS
from warp_neural.nn.network_file import load_network, make_network, read_state, save_network, write_state
from warp_neural.nn.state import NetworkState

quiet = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


def network(spec, count=1, seed=0, extra=None, encoding=None, n_in=None, implementation="cooperative"):
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.1, 1, (count, len(spec.layers), 2)) if spec.format is INT8 else None
    own = rng.normal(size=count * encoding.n_parameters(n_in)) if encoding else None
    parameters = rng.normal(size=(count, spec.n_parameters))
    return NetworkState(spec, parameters, count, implementation, steps, encoding, n_in, own, extra or {})


def arrays(state):
    return [state.parameters, state.encoding_parameters, *([] if state.steps is None else [state.steps])]


def same(a, b):
    assert (a.kind, a.extra) == (b.kind, b.extra)
    for x, y in zip(arrays(a), arrays(b), strict=True):
        assert x.dtype == y.dtype == np.float32 and x.shape == y.shape and x.tobytes() == y.tobytes()


specs = st.builds(
    NetworkSpec,
    sizes=st.lists(st.integers(1, 20), min_size=2, max_size=10).map(tuple),
    activation=st.sampled_from(activations.ALL),
    output_activation=st.sampled_from(activations.ALL),
    format=st.sampled_from(list(FORMATS.values())),
    dtype=st.sampled_from([wp.float32, wp.float16]),
)


@quiet
@given(
    specs,
    st.integers(1, 3),
    st.integers(0, 99),
    st.dictionaries(st.text(), st.text() | st.integers(), max_size=2),
    st.sampled_from(IMPLEMENTATIONS),
)
def test_networks_return_bit_for_bit(tmp_path, spec, count, seed, extra, implementation):
    data = network(spec, count, seed, extra, implementation=implementation)
    write_state(tmp_path / "a.safetensors", data)
    same(read_state(tmp_path / "a.safetensors"), data)


LATENT = encodings.LatentTexture(3, 2, channels=2, initial=(-1.0, 1.0))
ENCODINGS = [
    (encodings.Frequency(3), 5),
    (LATENT, 2),
    (encodings.Scaled(LATENT, 2.0, -1.0), 2),
    (encodings.HashGrid(levels=2, log2_size=4, base_resolution=2, growth=1.5), 3),
    (encodings.Concatenate((encodings.Identity(), LATENT), ((0, 2), (1, 2))), 3),
]


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize(("encoding", "n_in"), ENCODINGS)
def test_encodings_return(tmp_path, encoding, n_in, count):
    data = network(NetworkSpec((encoding.n_out(n_in), 4, 1)), count, encoding=encoding, n_in=n_in)
    write_state(tmp_path / "a.safetensors", data)
    same(read_state(tmp_path / "a.safetensors"), data)


@pytest.mark.parametrize(
    "options",
    [
        {"depth": 0, "output_activation": activations.exponential},
        {"count": 3, "dtype": wp.float16, "accumulation": "float16", "activation": activations.leaky_relu},
        {"precision": "int8", "count": 2},
        {"encoding": encodings.Concatenate((encodings.Identity(), LATENT), ((2,), (0, 1))), "count": 3},
    ],
)
def test_an_mlp_returns_with_the_buffers_that_kernels_read(tmp_path, device, options):
    net = MLP(3, 2, width=8, **{"depth": 2, **options}, seed=4, device=device)
    net.biases = [np.full_like(biases, 0.25) for biases in net.biases]
    if net.spec.format is INT8:
        net.calibrate(np.full((5, 3), 2.0))
    path = tmp_path / "net.safetensors"
    save_network(path, net)
    loaded = load_network(path, device=device)
    assert (loaded.spec, loaded.count, loaded.encoding) == (net.spec, net.count, net.encoding)
    for name in ("master", "packed", "steps"):
        assert (getattr(loaded, name).numpy() == getattr(net, name).numpy()).all(), name


def test_an_mlp_has_hidden_layers_of_one_width(tmp_path):
    data = network(NetworkSpec((2, 3, 4, 1)))
    with pytest.raises(InputError, match=r"a.safetensors: hidden layers of sizes \(3, 4\); an MLP has one width"):
        make_network(tmp_path / "a.safetensors", data, "cpu")


def test_what_cannot_be_kept_is_not_written(tmp_path):
    own = dataclasses.replace(activations.relu, name="mine", value="z")
    with pytest.raises(InputError, match="activation 'mine' is your own"):
        write_state(tmp_path / "a", network(NetworkSpec((2, 1), output_activation=own)))
    data = network(NetworkSpec((10, 1)), encoding=encodings.Frequency(octaves=True), n_in=5)
    with pytest.raises(InputError, match=r"Frequency.octaves is not of type int; files hold those of wn.encodings"):
        write_state(tmp_path / "a", data)
    data = network(NetworkSpec((2, 1))).with_layers(biases=[np.full(1, np.nan)])
    with pytest.raises(InputError, match="NaN or infinite"):
        write_state(tmp_path / "a", data)
    data = dataclasses.replace(network(NetworkSpec((2, 1), format=INT8)), steps=None)
    with pytest.raises(InputError, match="an int8 network without steps; make an MLP"):
        write_state(tmp_path / "a", data)
    assert not list(tmp_path.iterdir())


REFUSED = {
    "other format": ({"format": "checkpoint"}, {}, "format 'checkpoint', not a network; see it with warp-neural info"),
    "version": ({"version": 1}, {}, "version '1' is not one of 2; save it again with save_network"),
    "implementation": ({"implementation": "fast"}, {}, "implementation 'fast' is not one of cooperative, per_thread"),
    "newer": ({"skip": True}, {}, "unknown metadata 'skip'; read it with a newer"),
    "sizes": ({"sizes": [2, "3", 1]}, {}, "sizes .* are not integers"),
    "no sizes": ({"sizes": None}, {}, "sizes 'None' is not of type list"),
    "large": ({"sizes": [2, 257, 1]}, {}, "sizes .2, 257, 1.: a network has 1 to 9 layers of sizes 1 to 256"),
    "deep": ({"sizes": [2] * 11}, {}, "1 to 9 layers"),
    "activation": ({"activation": "z; system()"}, {}, "activation 'z; system\\(\\)' is not one of linear, relu"),
    "activation type": ({"output_activation": ["relu"]}, {}, "output_activation .* is not one of linear, relu"),
    "precision": ({"precision": "float12"}, {}, "precision 'float12' is not one of float32, tf32"),
    "accumulation": ({"accumulation": "float8"}, {}, "accumulation='float8': expected one of float32, float16"),
    "combination": ({"precision": "tf32", "accumulation": "float16"}, {}, "tf32 accumulates in float32 only"),
    "dtype": ({"dtype": "float64"}, {}, "dtype 'float64' is not one of float32, float16"),
    "no count": ({"count": 0}, {}, "count 0 is not positive"),
    "count": ({"count": 10**12}, {}, r"tensor 'weights.0' is float32 \[3, 2\], not float32 \[1000000000000, 3, 2\]"),
    "int8": ({"precision": "int8"}, {}, "tensor 'steps' is missing"),
    "extra": ({"extra": []}, {}, r"extra '\[\]' is not of type dict"),
    "n_in": ({"n_in": 3}, {}, r"n_in 3 does not fit the sizes \(2, 3, 1\)"),
    "missing": ({}, {"biases.1": None}, "tensor 'biases.1' is missing"),
    "shape": (
        {},
        {"weights.1": np.zeros((3, 1), np.float32)},
        r"'weights.1' is float32 \[3, 1\], not float32 \[1, 3\]",
    ),
    "half": ({}, {"biases.0": np.zeros(3, np.float16)}, r"tensor 'biases.0' is float16 \[3\], not float32"),
    "NaN": ({}, {"biases.0": np.full(3, np.nan, np.float32)}, "tensor 'biases.0' holds NaN"),
    "more": ({}, {"weights.2": np.zeros(3, np.float32)}, "unknown tensors 'weights.2'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_files_that_contradict_themselves_are_refused_by_field(tmp_path, case):
    changes, replaced, message = REFUSED[case]
    path = tmp_path / "a.safetensors"
    write_state(path, network(NetworkSpec((2, 3, 1))))
    tensors, metadata = load_tensors(path)
    tensors = {name: array for name, array in (tensors | replaced).items() if array is not None}
    save_tensors(path, tensors, metadata | changes)
    with pytest.raises(InputError, match=message) as error:
        read_state(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value)


LATENT_FILE = {"name": "LatentTexture", "width": 3, "height": 2, "channels": 2, "wrap": False, "initial": [0.0, 1.0]}
REFUSED_ENCODINGS = {
    "no object": ([], "no JSON object"),
    "name": ({"name": "os.system"}, "'os.system' is not one of Concatenate, Frequency"),
    "base": ({"name": "Encoding"}, "'Encoding' is not one of"),
    "fields": ({"name": "Frequency", "octaves": 1}, "Frequency has the fields octaves, lowest, not octaves"),
    "text": (LATENT_FILE | {"channels": "1; }"}, "LatentTexture.channels is not of type int"),
    "fraction": (LATENT_FILE | {"width": 2.0}, "LatentTexture.width is not of type int"),
    "flag": (LATENT_FILE | {"wrap": 1}, "LatentTexture.wrap is not of type bool"),
    "range": (LATENT_FILE | {"initial": [0.0]}, "LatentTexture.initial is not of type tuple"),
    "value": (LATENT_FILE | {"width": 0}, "LatentTexture: width=0: expected a whole number"),
    "inputs": ({"name": "SphericalHarmonics", "degree": 2}, "SphericalHarmonics: n_in=2"),
    "outputs": (LATENT_FILE | {"channels": 3}, "3 float32 results of 2 inputs do not fit"),
    "absurd": (
        LATENT_FILE | {"width": 2**28},
        r"tensor 'encoding' is float32 \[12\], not float32 \[1073741824\]",
    ),
    "growth": (
        {"name": "HashGrid", "levels": 2**40, "features": 1, "log2_size": 4, "base_resolution": 2, "growth": 2.0}
        | {"initial": [0.0, 1.0]},
        "encoding: HashGrid: levels=1099511627776",
    ),
    "levels": (
        {"name": "HashGrid", "levels": 2**40, "features": 1, "log2_size": 4, "base_resolution": 2, "growth": 1.0}
        | {"initial": [0.0, 1.0]},
        "encoding: HashGrid: levels=1099511627776",
    ),
}


bomb = {"name": "none"}
for _ in range(300):
    bomb = {"name": "Concatenate", "parts": [bomb], "inputs": None}
REFUSED_ENCODINGS["bomb"] = (bomb, "encoding: ")


@pytest.mark.parametrize("case", REFUSED_ENCODINGS)
def test_encodings_that_are_none_are_refused_by_field(tmp_path, case):
    description, message = REFUSED_ENCODINGS[case]
    path = tmp_path / "a.safetensors"
    write_state(path, network(NetworkSpec((2, 1)), encoding=LATENT, n_in=2))
    tensors, metadata = load_tensors(path)
    save_tensors(path, tensors, metadata | {"encoding": description})
    with pytest.raises(InputError, match=message):
        read_state(path)


@quiet
@given(st.data())
def test_any_json_in_place_of_a_field_is_a_network_or_an_input_error(tmp_path, data):
    path = tmp_path / "a.safetensors"
    write_state(path, network(NetworkSpec((2, 3, 1)), encoding=LATENT, n_in=2))
    tensors, metadata = load_tensors(path)
    value = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.integers(-1, 300))
    place = data.draw(st.sampled_from([metadata, metadata["encoding"]]))
    place[data.draw(st.sampled_from(sorted(place)))] = data.draw(value | st.dictionaries(st.text(), value))
    save_tensors(path, tensors, metadata)
    check(path, path.stat().st_size)


@quiet
@given(st.lists(st.tuples(st.integers(min_value=0), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_bytes_are_a_network_or_an_input_error(tmp_path, changes):
    path = tmp_path / "a.safetensors"
    write_state(path, network(NetworkSpec((2, 3, 1)), encoding=LATENT, n_in=2))
    content = bytearray(path.read_bytes())
    for place, value in changes:
        content[place % len(content)] = value
    path.write_bytes(content)
    check(path, len(content))


def check(path, n_bytes):
    try:
        data = read_state(path)
    except InputError as error:
        assert str(error).startswith(f"{path}: ") and "\n" not in str(error)
        return
    assert sum(array.nbytes for array in arrays(data)) <= n_bytes
    assert json.dumps(data.extra)
