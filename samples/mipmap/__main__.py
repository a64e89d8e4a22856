"""The main job: mip maps that keep a wet material's look, learned by gradient descent through the shader.

    python -m samples.mipmap [--material FOLDER] [--levels 9] [--sweep]

The reference shades in full resolution and averages 4 x 4 results. Four sets of maps at a quarter of the size try to
match it: box-filtered, Toksvig's, learned with SGD and learned with Adam. Each is judged on uniform pairs of light and
view that training never draws from, by the squared error of radiance (linear) and of displayed values (display).

Each classical answer pays in one measure for the other: the box filter glares (linear), Toksvig's blurs (display).
SGD gets what the course's first attempt has: uniform pairs, the squared error of radiance. A wet surface is black
nearly everywhere and very bright in a few directions, at grazing ones most of all, so those gradients are nearly all
noise: a rate that learns from the dark blows up at the first highlight. What makes learning win in both measures:

- Pairs are drawn where highlights are: 30 % uniform, the rest through the lobes of the facets, the learned texel's own
  among them, with views drawn towards grazing. Weighted by the balance heuristic the gradient stays unbiased. Without
  the own lobe a texel may hide a spike between the pairs that it sees.
- The loss is a sum of both errors, each divided by the best that a classical method reaches, one part of the
  linear to three of the displayed one. One alone ends worse than a classical method in the other measure.
- 8 pairs a step, not one: at the same number of pairs in all, linear error falls by a quarter and Metal053C converges.
- All maps that the shader takes are learned, specular and metalness too: dimmer highlights are one more way out.
- Adam starts from Toksvig's maps, rate 0.01, on a cosine to 0. Averaged weights then bring nothing more.

Given the same gradients SGD comes within 6 % of Adam, at a rate of its own for each material; on the course's
gradients Adam fares no better than SGD (`--sweep`). What fails under noise is any optimizer; what wins is less noise.
"""

import json
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass

import numpy as np
import warp as wp

from samples.mipmap.chain import learn_chain
from samples.mipmap.classical import box_filter, toksvig
from samples.mipmap.figures import save_comparison, save_curves, save_maps
from samples.mipmap.judge import Errors, flip, judge, psnr, random_directions, render
from samples.mipmap.learn import Learner, Recipe, run
from samples.mipmap.maps import Maps, MaterialConfig, pack, source_maps
from samples.mipmap.sweep import sweep
from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.files import atomic_path
from warp_neural.optim import SGD, Adam

BALANCE = (0.25, 0.75)  # of linear and displayed error in the loss


@dataclass(frozen=True, kw_only=True)
class Config(MaterialConfig):
    steps: int | None = None
    """gradient steps of each optimizer; none: 800 on the CPU, 4000 on CUDA"""
    pairs: int = 8
    """pairs of light and view a texel and step"""
    rate: float = 0.01
    """Adam's learning rate at the start"""
    sgd_rate: float = 1e-4
    """SGD's learning rate at the start"""
    judge_pairs: int = 4096
    """held-out pairs a texel"""
    pictures: int = 64
    """pictures for PSNR and FLIP"""
    levels: int = 0
    """also learn a chain of this many mip levels, to 1x1 at most"""
    sweep: bool = False
    """only repeat the search for the learning rates"""


def main(config: Config) -> dict:
    began = time.perf_counter()
    check(config)
    device = cli.resolve_device(config.device)
    name, maps = source_maps(config, device)
    source = pack(maps, config.factor, device)
    with atomic_path(config.out / "config.json") as path:  # a folder that cannot be written fails now
        path.write_text(json.dumps(asdict(config), indent=2, default=str) + "\n")

    answers = {"box": box_filter(maps, config.factor), "toksvig": toksvig(maps, config.factor)}
    classical = judge(source, list(answers.values()), pairs=256, seed=4 * config.seed)
    recipes = {
        "sgd": Recipe(SGD, config.sgd_rate, uniform_share=1.0, weights=(1.0, 0.0)),
        "adam": Recipe(Adam, config.rate, uniform_share=0.3, weights=balanced(classical)),
    }
    starts = {"sgd": answers["box"], "adam": answers["toksvig"]}
    steps = config.steps or (4000 if device.is_cuda else 800)
    if config.sweep:
        return sweep(config, source, starts, recipes, steps)

    def learn(optimizer: str) -> tuple[Maps, np.ndarray, float]:
        start, recipe = starts[optimizer], recipes[optimizer]
        learner = Learner(source, start, recipe, steps=steps, pairs=config.pairs, seed=4 * config.seed + 1)
        curve = []

        def watch(step: int) -> None:
            errors = judge(source, [learner.maps()], pairs=32, seed=4 * config.seed + 2)
            curve.append((step, errors.linear[0], errors.displayed[0]))

        bar = cli.progress(range(steps), config, desc=f"{optimizer:4}", position=list(recipes).index(optimizer))
        seconds = run(learner, bar, every=max(steps // 20, 1), watch=watch)
        watch(steps)
        return learner.maps(), np.array(curve), seconds

    wp.load_module(Learner.__module__, device=device)  # before the threads, or each compiles it
    with ThreadPoolExecutor(1 if device.is_cuda else 2) as pool:  # a CPU launch runs on the thread that makes it
        learned = dict(zip(recipes, pool.map(learn, recipes), strict=True))
    answers |= {optimizer: result[0] for optimizer, result in learned.items()}

    errors = judge(source, list(answers.values()), pairs=config.judge_pairs, seed=4 * config.seed + 3)
    metrics = measured(errors, list(answers))
    metrics |= compare_pictures(config, source, answers, metrics)
    curves = {optimizer: result[1] for optimizer, result in learned.items()}
    levels = judge(source, [answers["box"], answers["toksvig"]], pairs=32, seed=4 * config.seed + 2)
    classical_levels = {n: (levels.linear[i], levels.displayed[i]) for i, n in enumerate(("box", "toksvig"))}
    save_curves(config.out / "curves.png", curves, classical_levels)
    save_maps(config.out / "learned", answers["adam"])
    if config.levels:
        metrics["levels"] = learn_chain(config, maps, recipes["adam"], steps)
    metrics |= {
        "material": name,
        "iterations": steps,
        "pairs": config.pairs,
        "judge_pairs": config.judge_pairs,
        "seconds_train": learned["adam"][2],
        "seconds_total": time.perf_counter() - began,
        "device": device.name if device.is_cuda else "cpu",
        "resolution": list(answers["adam"].shape),
        "source_resolution": list(maps.shape),
    }
    with atomic_path(config.out / "metrics.json") as path:
        path.write_text(json.dumps(metrics, indent=2) + "\n")
    return metrics


def check(config: Config) -> None:
    for option in ("pairs", "judge_pairs", "pictures", "rate", "sgd_rate"):
        if getattr(config, option) <= 0:
            raise InputError(f"--{option.replace('_', '-')} {getattr(config, option)}: give a positive number")
    if config.steps is not None and config.steps < 1:
        raise InputError(f"--steps {config.steps}: give at least 1")
    if config.levels < 0:
        raise InputError(f"--levels {config.levels}: give 0 for none, or how many to learn")


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
    for name, picture in zip(answers, pictures, strict=True):
        quality[f"psnr_{name}"] = psnr(truth[1:], picture[1:])
        quality[f"flip_{name}"] = flip(truth[1:], picture[1:])
    return quality


if __name__ == "__main__":
    cli.run(main, Config)
