"""`wn.texture.compress`: goals, what stops a run and where it goes on; searches on a stand-in for a trainer."""

from math import exp, log

import numpy as np
import pytest

import warp_neural as wn
from warp_neural.texture import compression
from warp_neural.texture.compression import BITS_TO_COME
from warp_neural.texture.presets import Effort
from warp_neural.texture.search import Goal, meet
from warp_neural.texture.trainer import TextureTrainer


class Stand:
    """A run whose result follows a curve of log(lambda), of the weights that it had, mostly of the early ones; and
    falls while it runs, by `fall` altogether."""

    steps = 1000

    def __init__(self, rate_weight, fall=1.3):
        self.rate_weight, self.fall, self.index, self.level, self.ran = rate_weight, fall, 0, log(rate_weight), 0

    def run(self, end=1000, **options):
        follows = 1 - exp(-4 * ((1 - self.index / 1000) ** 2 - (1 - end / 1000) ** 2))
        self.level += follows * (log(self.rate_weight) - self.level)
        self.ran += end - self.index
        self.index = end

    def result(self):
        return -0.7 * self.level - 0.02 * self.level**2 + self.fall * max(0.7 - self.index / 1000, 0) ** 2

    def snapshot(self):
        return {"index": self.index, "level": self.level}

    def restore(self, saved):
        vars(self).update(saved)


def goal(wanted):
    return Goal(Stand.result, wanted, -0.7, 0.02, BITS_TO_COME)


@pytest.mark.parametrize("wanted", [3.2, 4.0, 4.6])
@pytest.mark.parametrize("fall", [0.0, 0.7, 1.3, 2.0])
def test_searches_meet_their_goal(wanted, fall):
    """fall: 1.3 about as expected. The last part is run again a few times at most."""
    trainer = Stand(1e-2, fall)
    assert meet(trainer, goal(wanted), [])
    assert abs(trainer.result() - wanted) <= 0.02 and trainer.index == 1000 and trainer.ran < 3000


def test_a_goal_out_of_reach_ends():
    trainer = Stand(1e-3)
    assert not meet(trainer, goal(1e3), [])
    assert 1e-8 <= trainer.rate_weight < 1e-3 and trainer.index == 1000


@pytest.mark.parametrize("index", [300, 640, 990])
def test_searches_go_on(index):
    """From a checkpoint; where its weight was far off, from the first step."""
    trainer = Stand(1e-2)
    first = trainer.snapshot()
    trainer.run(index)
    assert meet(trainer, goal(4.0), [first])
    assert abs(trainer.result() - 4.0) <= 0.02


def pictures(side=32):
    y, x = np.mgrid[:side, :side] / side
    albedo = np.stack([0.5 + 0.4 * np.sin(20 * x), 0.5 + 0.4 * np.cos(9 * y), x * y], -1)
    return {"albedo": np.float32(albedo), "ao": np.full((side, side, 1), 0.25, np.float32)}


@pytest.fixture
def short_runs(monkeypatch):
    monkeypatch.setattr(compression, "effort_of", lambda device, preview, texels: Effort(300, 1))


def test_a_texture_from_arrays(short_runs, tmp_path):
    """Compressed, saved, loaded: the same numbers, and those that were measured."""
    texture = wn.texture.compress(pictures(), quality="high", mips=3, device="cpu", quiet=True)
    texture.save(tmp_path / "a.wntc")
    loaded = wn.texture.load(tmp_path / "a.wntc", "cpu")
    for mip in range(3):
        for name, values in texture.decode(mip).items():
            np.testing.assert_array_equal(values, loaded.decode(mip)[name])
    assert (loaded.decode()["ao"] == 0.25).all()  # constant, so exact
    codes = (np.rint(255 * values) / 255 for values in (pictures()["albedo"], loaded.decode()["albedo"]))
    measured = -10 * np.log10(np.square(np.subtract(*codes)).mean())
    assert abs(measured - texture.metrics["psnr"]) < 0.01 and measured > 20


def test_a_stopped_run_goes_on(short_runs, tmp_path, monkeypatch):
    """To the same file, bit for bit."""
    whole = wn.texture.compress(pictures(), quality="low", device="cpu", quiet=True)
    file, stops = tmp_path / "run.safetensors", [64]

    def step(self, alone, before=TextureTrainer._launch):
        def launch(trainer, count, alone):
            if stops and trainer.index >= stops[0]:
                stops.clear()
                raise KeyboardInterrupt
            before(trainer, count, alone)

        return launch(self, *alone)

    monkeypatch.setattr(TextureTrainer, "_launch", lambda self, *counts: step(self, counts))
    options = {"quality": "low", "device": "cpu", "quiet": True, "checkpoint": file}
    with pytest.raises(KeyboardInterrupt):
        wn.texture.compress(pictures(), **options)
    with pytest.raises(wn.InputError, match=r"run\.safetensors: of other pictures or options"):
        wn.texture.compress(pictures(), **options | {"seed": 1})
    again = wn.texture.compress(pictures(), **options)
    for a, b in zip(whole.state.latents[0], again.state.latents[0], strict=True):
        np.testing.assert_array_equal(a, b)
    for name, tensor in whole.state.tensors.items():
        np.testing.assert_array_equal(tensor.integers, again.state.tensors[name].integers)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bpp": 2, "psnr": 30}, "bpp and psnr: each chooses"),
        ({"bpp": 0}, "bpp=0: .*positive"),
        ({"psnr": float("nan")}, "psnr=nan"),
        ({"quality": "best"}, "quality=best|quality='best'"),
        ({"size": 400}, "size 400: the network takes .* kB; give at least .* bytes"),
        ({"weights": {"normal": 2}}, "names of maps, albedo, ao"),
        ({"losses": {"normal": "angle"}}, "names of maps, albedo, ao"),
        ({"losses": {"albedo": "angle"}}, "l2 for what is no normal"),
        ({"losses": {"ao": "l1"}}, "one of l2, angle, luminance"),
        ({"losses": {"ao": "luminance"}}, "no three channels of colour"),
        ({"mips": 9}, "have 1 to 6"),
        ({"steps": 10}, "steps=10: expected a whole number >= 100"),
    ],
)
def test_bad_goals(options, words):
    with pytest.raises(wn.InputError, match=words):
        wn.texture.compress(pictures(), device="cpu", quiet=True, **options)
