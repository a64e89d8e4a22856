"""RTXNS's JSON: round trips bit for bit with its other keys; files that contradict themselves are refused by field."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_np
from rtxns_files import check, network, quiet, same

from warp_neural.errors import InputError
from warp_neural.io.rtxns import RtxnsNetwork
from warp_neural.io.rtxns_json import read_json, write_json


@quiet
@given(
    st_np.arrays(
        np.float32,
        st.tuples(*[st.integers(1, 9)] * 2),
        elements=st.floats(width=32, allow_infinity=False, allow_nan=False),
    ),
    st.dictionaries(st.text().filter("layers".__ne__), st.integers() | st.text() | st.lists(st.booleans()), max_size=3),
)
def test_json_returns_bit_for_bit_with_its_other_keys(tmp_path, weights, extra):
    net = RtxnsNetwork([weights, weights.T.copy()], [weights[:, 0], weights[0]], extra)
    write_json(tmp_path / "a.json", net)
    same(read_json(tmp_path / "a.json"), net)


def test_json_rounds_to_float32_and_takes_integers(tmp_path):
    layer = {"num_inputs": 2, "num_outputs": 1, "weights": [1, 0.1], "biases": [-2]}
    (tmp_path / "a.json").write_text(json.dumps({"channels": [2, 1], "layers": [layer]}))
    net = read_json(tmp_path / "a.json")
    assert net.extra == {"channels": [2, 1]}
    assert net.weights[0].tolist() == [[1, np.float32(0.1)]] and net.biases[0].tolist() == [-2]


def one_layer(**changes):
    layer = {"num_inputs": 2, "num_outputs": 1, "weights": [1.0, 2.0], "biases": [0.5], **changes}
    return json.dumps({"layers": [layer]}).encode()


REFUSED_JSON = {
    "empty": (b"", "not JSON"),
    "not text": (b"\xff\xfe\xfd", "not JSON"),
    "bomb": (b"[" * 1_000_000, "not JSON"),
    "deep object": (b'{"layers":' * 100_000, "not JSON"),
    "huge integer": (one_layer(biases=[0]).replace(b"[0]", b"[" + b"9" * 5000 + b"]"), "not JSON"),
    "list": (b"[]", "layers: missing"),
    "no layers": (b'{"layers": []}', "layers: missing"),
    "older form": (b'{"layers": {"layer_0_w": []}}', "layers: missing or no list"),
    "layer": (b'{"layers": [3]}', r"layers\[0\]: no object"),
    "no size": (one_layer(num_inputs=None), r"layers\[0\].num_inputs: 'None', not a positive"),
    "zero": (one_layer(num_outputs=0), r"layers\[0\].num_outputs"),
    "true": (one_layer(num_outputs=True), r"layers\[0\].num_outputs: 'True'"),
    "fraction": (one_layer(num_outputs=1.0), r"layers\[0\].num_outputs"),
    "absurd": (one_layer(num_outputs=10**30), r"layers\[0\].num_outputs"),
    "large": (one_layer(num_outputs=2**31 - 1), r"layers\[0\].weights: 2 values, where the sizes need 4294967294"),
    "weights": (one_layer(weights=[1.0]), r"layers\[0\].weights: 1 values, where the sizes need 2"),
    "nested": (one_layer(weights=[[1.0], [2.0]]), r"layers\[0\].weights: holds something other than numbers"),
    "text": (one_layer(weights="12"), r"layers\[0\].weights: no list"),
    "biases": (one_layer(biases=[]), r"layers\[0\].biases: 0 values, where the sizes need 1"),
    "NaN": (one_layer(biases=[float("nan")]), "NaN is not a number of JSON"),
    "infinite": (one_layer(biases=[float("inf")]), "Infinity is not a number of JSON"),
    "overflow": (one_layer().replace(b"0.5", b"1e999"), r"layers\[0\].biases: holds values beyond float32"),
    "beyond float32": (one_layer(biases=[1e39]), r"layers\[0\].biases: holds values beyond float32"),
    "long integer": (one_layer(biases=[10**400]), r"layers\[0\].biases: holds values beyond float32"),
    "boolean": (one_layer(biases=[True]), r"layers\[0\].biases: holds something other than numbers"),
    "chain": (
        json.dumps({"layers": [json.loads(one_layer())["layers"][0]] * 2}).encode(),
        r"layers\[1\].num_inputs: 2, where the layer before has 1 outputs",
    ),
}


@pytest.mark.parametrize("case", REFUSED_JSON)
def test_refused_json_files_name_the_field(tmp_path, case):
    data, message = REFUSED_JSON[case]
    path = tmp_path / "a.json"
    path.write_bytes(data)
    with pytest.raises(InputError, match=message) as error:
        read_json(path)
    assert str(error.value).startswith(f"{path}: ") and "\n" not in str(error.value) and len(str(error.value)) < 600


def test_what_is_not_finite_is_not_written(tmp_path):
    infinite = network((2, 1))
    infinite.biases[0][:] = np.inf
    for net in (infinite, network(extra={"a": float("nan")})):
        with pytest.raises(InputError, match="cannot be written as JSON"):
            write_json(tmp_path / "a.json", net)
    assert not list(tmp_path.iterdir())


@quiet
@given(st.lists(st.tuples(st.integers(min_value=0), st.integers(0, 255)), min_size=1, max_size=4))
def test_damaged_bytes_give_a_network_or_an_input_error(tmp_path, changes):
    write_json(tmp_path / "a", network((2, 3, 1)))
    content = bytearray((tmp_path / "a").read_bytes())
    for place, value in changes:
        content[place % len(content)] = value
    check(read_json, tmp_path / "a", content)
