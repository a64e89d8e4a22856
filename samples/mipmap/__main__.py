"""The main job: mip maps that keep a wet material's look, learned by gradient descent through the shader.

    python -m samples.mipmap [--material FOLDER] [--levels 8] [--sweep]

The reference shades in full resolution and averages 4 x 4 results. Four sets of maps, a quarter as wide, try to match
it: box-filtered, Toksvig's, learned with SGD, learned with Adam. They are judged on uniform pairs of light and view
that training never draws, by the squared error of radiance (linear) and of displayed values (display).

Each classical answer pays in one measure for the other: the box filter glares (linear), Toksvig's blurs (display).
SGD gets what the course begins with: uniform pairs, squared error of radiance. A wet surface is dark nearly everywhere
and very bright in a few directions, most of all at grazing ones: such gradients are nearly all noise, and a rate that
learns from the dark blows up at the next highlight. Learning wins in both measures, on every material tried, by this:

- Pairs where highlights are. 30 % stay uniform, the rest go through the lobes of facets, half of those the learned
  texel's own, views half drawn towards grazing; the balance heuristic keeps the gradient unbiased. With uniform pairs
  Adam ends at 1.3 (bricks) to 14 (Metal053C) times Toksvig's linear error. The own lobe matters: without it a texel
  may grow a spike where no pair looks.
- Both errors in the loss, each divided by the best classical one, one part of linear to three of display. Either alone
  ends worse than a classical answer in the other measure, on all but the mildest material.
- All maps that the shader takes, specular and metalness too: a dimmer highlight is one more way to fit.
- Adam from Toksvig's maps, rate 0.01, on a cosine to 0. Averaging the weights then brings nothing. One pair a step
  instead of 8 needs a third of the rate and 8 times the launches, and ends the same.

SGD's best rate on the course's gradients is 1e-6 to 3e-6; beyond, it is a lottery (1e-4: linear error 1.9 on some
pairs, 190 on others), and Adam fares no better on them. On the quiet gradients SGD comes within 6 % of Adam on bricks
and PavingStones070, but no one rate serves all materials: Leather034C wants a tenth of theirs, Metal053C less still.
"""

import json
import time
from dataclasses import asdict, dataclass
from functools import partial
from typing import Annotated

import numpy as np
import warp as wp

from warp_neural import cli
from warp_neural.imaging.image import displayed_psnr
from warp_neural.io.files import atomic_path
from warp_neural.samples.mipmap.chain import learn_chain
from warp_neural.samples.mipmap.classical import box_filter, toksvig
from warp_neural.samples.mipmap.figures import save_comparison, save_curves, save_maps
from warp_neural.samples.mipmap.judge import Errors, flip, judge, random_directions, render
from warp_neural.samples.mipmap.learn import Learner, Recipe, run
from warp_neural.samples.mipmap.maps import Maps, MaterialConfig, pack, source_maps
from warp_neural.samples.mipmap.sweep import sweep
from warp_neural.samples.mipmap.threads import threads
from warp_neural.train.optim import SGD, Adam

BALANCE = (0.25, 0.75)  # of linear and displayed error in the loss


@dataclass(frozen=True, kw_only=True)
class Config(MaterialConfig):
    steps: cli.Count | None = None
    """gradient steps of each optimizer; none: 800 on the CPU, 4000 on CUDA"""
    pairs: Annotated[int, cli.Between(1, 4096)] = 8
    """pairs of light and view a texel and step"""
    rate: cli.Positive = 0.01
    """Adam's learning rate at the start"""
    sgd_rate: cli.Positive = 3e-6
    """SGD's learning rate at the start"""
    judge_pairs: Annotated[int, cli.Between(1, 2**24)] = 4096
    """held-out pairs a texel"""
    pictures: Annotated[int, cli.Between(1, 4096)] = 64
    """pictures for PSNR and FLIP"""
    levels: Annotated[int, cli.Between(0, 30)] = 0
    """also learn a chain of this many mip levels, to 1x1 at most"""
    sweep: bool = False
    """only repeat the search for the learning rates"""


def main(config: Config) -> dict:
    began = time.perf_counter()
    device = cli.resolve_device(config.device)
    name, maps = source_maps(config, device)
    source = pack(maps, config.factor, device)
    with atomic_path(config.out / "config.json") as path:  # a folder that cannot be written fails now
        path.write_text(json.dumps(asdict(config), indent=2, default=str) + "\n")

    answers = {"box": box_filter(maps, config.factor), "toksvig": toksvig(maps, config.factor)}
    classical = judge(source, list(answers.values()), pairs=256, seed=4 * config.seed)
    recipes = {
        "sgd": Recipe(SGD, config.sgd_rate, answers["box"], uniform_share=1.0, weights=(1.0, 0.0)),
        "adam": Recipe(Adam, config.rate, answers["toksvig"], uniform_share=0.3, weights=balanced(classical)),
    }
    steps = config.steps or (4000 if device.is_cuda else 800)
    if config.sweep:
        return sweep(config, source, recipes, steps)
    learned = learn(config, source, recipes, steps)
    answers |= {optimizer: result.maps for optimizer, result in learned.items()}

    bar = partial(cli.progress, config=config, desc="judging")
    errors = judge(source, list(answers.values()), pairs=config.judge_pairs, seed=4 * config.seed + 3, bar=bar)
    metrics = measured(errors, list(answers))
    metrics |= compare_pictures(config, source, answers, metrics)
    metrics["levels"] = learn_chain(config, maps, recipes["adam"], steps) if config.levels else []
    metrics |= {"material": name, "iterations": steps, "pairs": config.pairs, "judge_pairs": config.judge_pairs}
    metrics |= {"resolution": list(answers["adam"].shape), "source_resolution": list(maps.shape)}
    metrics |= {"device": device.name if device.is_cuda else "cpu", "seconds_train": learned["adam"].seconds}
    save_curves(config.out / "curves.png", {optimizer: result.curve for optimizer, result in learned.items()})
    save_maps(config.out / "learned", answers["adam"])
    metrics["seconds_total"] = time.perf_counter() - began
    with atomic_path(config.out / "metrics.json") as path:
        path.write_text(json.dumps(metrics, indent=2) + "\n")
    return metrics


@dataclass(frozen=True)
class Learned:
    """What an optimizer made of its start."""

    maps: Maps
    curve: np.ndarray  # [points, 3]: step, linear and displayed error on few held-out pairs
    seconds: float


def learn(config: Config, source: wp.array, recipes: dict[str, Recipe], steps: int) -> dict[str, Learned]:
    """Follow every recipe, on the CPU two at a time."""
    for module in (Learner.__module__, judge.__module__, "warp_neural.kernels.nn.optimizers"):
        wp.load_module(module, device=source.device)  # before the threads, or each compiles it

    def follow(optimizer: str) -> Learned:
        learner = Learner(source, recipes[optimizer], steps=steps, pairs=config.pairs, seed=4 * config.seed + 1)
        curve = []

        def watch(step: int) -> None:
            errors = judge(source, [learner.maps()], pairs=32, seed=4 * config.seed + 2)
            curve.append((step, errors.linear[0], errors.displayed[0]))

        bar = cli.progress(range(steps), config, desc=f"{optimizer:4}", position=list(recipes).index(optimizer))
        seconds = run(learner, going(bar), every=max(steps // 20, 1), watch=watch)
        watch(steps)
        return Learned(learner.maps(), np.array(curve), seconds)

    with threads(source.device) as (pool, going):
        return dict(zip(recipes, pool.map(follow, recipes), strict=True))


def balanced(classical: Errors) -> tuple[float, float]:
    """Weights that make both errors comparable: what the better classical method leaves, or a third of box's, is 1."""
    linear = min(classical.linear.min(), classical.linear[0] / 3)
    return float(BALANCE[0] / linear), float(BALANCE[1] / classical.displayed.min())


def measured(errors: Errors, names: list[str]) -> dict[str, float]:
    """`linear_box` and so on; `*_spread` is the standard error of that mean."""
    metrics = {}
    for i, name in enumerate(names):
        metrics[f"linear_{name}"] = float(errors.linear[i])
        metrics[f"linear_{name}_spread"] = float(errors.linear_spread[i])
        metrics[f"display_{name}"] = float(errors.displayed[i])
        metrics[f"display_{name}_spread"] = float(errors.displayed_spread[i])
    return metrics


def compare_pictures(config: Config, source: wp.array, answers: dict[str, Maps], metrics: dict) -> dict[str, float]:
    """PSNR and FLIP over random pictures, and comparison.png under the course's light."""
    lights, views = (random_directions(config.pictures, [config.seed, 3, i]) for i in range(2))
    lights = np.concatenate([[np.array([0.2, 0.2, 1]) / np.linalg.norm([0.2, 0.2, 1])], lights])
    views = np.concatenate([[[0, 0, 1]], views])
    truth, *pictures = render(source, list(answers.values()), lights, views)
    shown = {name: picture[0] for name, picture in zip(answers, pictures, strict=True)}
    save_comparison(config.out / "comparison.png", truth[0], shown, metrics)
    quality = {}
    pairs = zip(answers, pictures, strict=True)
    for name, picture in cli.progress(pairs, config, desc="pictures", total=len(answers)):
        quality[f"psnr_{name}"] = displayed_psnr(truth[1:], picture[1:])
        quality[f"flip_{name}"] = flip(truth[1:], picture[1:])
    return quality


if __name__ == "__main__":
    cli.run(main, Config)
