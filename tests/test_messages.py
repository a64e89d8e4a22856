"""What a newcomer writes in place of what is meant: one line that says what to write."""

import numpy as np
import pytest
import warp as wp

import warp_neural as wn

FILE = r"\(.*test_messages.py:{}\)"


@wp.func
def right(index: int, random: wn.random.Stream):
    return wp.vec2(), wp.vec3()


@wp.func
def one_argument(index: int):
    return wp.vec2(), wp.vec3()


@wp.func
def swapped(random: wn.random.Stream, index: int):
    return wp.vec2(), wp.vec3()


@wp.func
def wrong_input(index: int, random: wn.random.Stream):
    return wp.vec3(), wp.vec3()


@wp.func
def wrong_target(index: int, random: wn.random.Stream):
    return wp.vec2(), 1.0


@wp.func
def one_result(index: int, random: wn.random.Stream):
    return wp.vec2()


@wp.func
def wrong_inside(index: int, random: wn.random.Stream):
    return wp.vec2(wp.sin(index)), wp.vec3()


def make_net(**options):
    return wn.MLP(**{"n_in": 2, "n_out": 3, "width": 16, "depth": 1, "precision": "float32", "device": "cpu"} | options)


OBJECTS = [
    ({"activation": "relu"}, "activation='relu': .*; write wn.activations.relu$"),
    ({"output_activation": "LeakyReLU"}, "write wn.activations.leaky_relu$"),
    ({"activation": wp.tanh}, "activation=tanh: .*; write wn.activations.tanh$"),
    ({"activation": None}, "activation=None: expected one of wn.activations, .*: .*relu"),
    ({"encoding": "Frequency"}, r"write wn.encodings.Frequency\(\)$"),
    ({"encoding": wn.encodings.HashGrid}, r"encoding=HashGrid: .*; write wn.encodings.HashGrid\(\)$"),
]
FUNCTIONS = [
    (one_argument, "takes .*; expected a @wp.func of .index: int, random: wn.random.Stream"),
    (swapped, "takes .*; expected a @wp.func of .index: int, random: wn.random.Stream"),
    (wrong_input, "expected to return .x: a vector of 2 float32, target: a vector of 3 float32. .*vec3f"),
    (wrong_target, "expected to return .x: a vector of 2 float32, target: a vector of 3 float32. .*float32"),
    (one_result, "expected to return .x: a vector of 2 float32, target: a vector of 3 float32"),
    (wrong_inside, "test_messages.py:[0-9]+: Couldn't find function overload for 'sin'"),
]


def refused(message, make):
    with pytest.raises(wn.InputError, match=message) as error:
        make()
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("options", "message"), OBJECTS, ids=range(len(OBJECTS)))
def test_objects_of_a_network_by_name(options, message):
    refused(message, lambda: make_net(**options))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"loss": "l2"}, "loss='l2': .*; write wn.losses.l2$"),
        ({"loss": wn.losses.huber}, r"loss=huber: .*; write wn.losses.huber\(\)$"),
        ({"loss": "mse"}, "expected one of wn.losses, or a Loss of your own: .*l2"),
        ({"optimizer": "adam"}, r"optimizer='adam': .*; write wn.optim.Adam\(\)$"),
        ({"optimizer": wn.optim.SGD}, r"optimizer=SGD: .*; write wn.optim.SGD\(\)$"),
    ],
)
def test_objects_of_a_trainer_by_name(options, message):
    refused(message, lambda: wn.Trainer(make_net(), sample=right, **options))


@pytest.mark.parametrize(("sample", "message"), FUNCTIONS, ids=lambda value: getattr(value, "key", ""))
@pytest.mark.parametrize("fused", [None, False])
def test_a_sample_function_is_named_with_its_line(sample, message, fused):
    place = FILE.format(sample.func.__code__.co_firstlineno)
    refused(f"sample={sample.key} {place}: .*{message}", lambda: wn.Trainer(make_net(), sample=sample, fused=fused))


def test_whole_numbers_of_numpy_are_whole_numbers(tmp_path):
    two = np.int64(2)
    net = make_net(n_in=two, n_out=np.int32(3), width=np.int16(16), depth=np.uint8(1))
    assert net.spec == make_net().spec
    trainer = wn.Trainer(net, sample=right, batch=np.int64(16), batches=np.int8(1), seed=np.uint32(3))
    trainer.save(tmp_path / "checkpoint.safetensors")
    wn.save_network(tmp_path / "net.safetensors", net)


def test_a_bad_checkpoint_fails_before_the_work(tmp_path):
    trainer = wn.Trainer(make_net(), sample=right, batch=16)
    (tmp_path / "file").write_text("in the way")
    refused("cannot write here", lambda: trainer.run(1, checkpoint=tmp_path / "file" / "a.safetensors"))
    refused("a folder or device", lambda: trainer.run(1, checkpoint=tmp_path))
    assert trainer.index == 0 and not trainer.progress.counters.numpy().any()
