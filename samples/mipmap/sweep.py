"""`--sweep`: the search behind the default learning rates, for both kinds of gradients and both optimizers."""

import json
from dataclasses import replace

import warp as wp

from warp_neural import cli
from warp_neural.io.files import atomic_path
from warp_neural.samples.mipmap.judge import judge
from warp_neural.samples.mipmap.learn import Learner, Recipe, run
from warp_neural.samples.mipmap.maps import MaterialConfig
from warp_neural.samples.mipmap.threads import threads
from warp_neural.train.optim import SGD, Adam

RATES = {SGD: [1e-7, 3e-7, 1e-6, 3e-6, 1e-5, 3e-5, 1e-4, 3e-4, 1e-3], Adam: [1e-3, 3e-3, 1e-2, 2e-2, 3e-2]}


def sweep(config: MaterialConfig, source: wp.array, recipes: dict[str, Recipe], steps: int) -> dict[str, float]:
    """Errors after every rate, `sweep.json`, and each combination's best rate, by linear error and twice its spread.

    "course" are the course's gradients from the box-filtered maps, "ours" the recipe's from Toksvig's.
    """
    gradients = {"course": recipes["sgd"], "ours": recipes["adam"]}
    jobs = [(kind, optimizer, rate) for kind in gradients for optimizer in RATES for rate in RATES[optimizer]]

    def attempt(job: tuple) -> dict[str, float | str]:
        kind, optimizer, rate = job
        recipe = replace(gradients[kind], optimizer=optimizer, rate=rate)
        learner = Learner(source, recipe, steps=steps, pairs=config.pairs, seed=4 * config.seed + 1)
        run(learner, going(range(steps)), every=steps, watch=lambda step: None)
        errors = judge(source, [learner.maps()], pairs=config.judge_pairs, seed=4 * config.seed + 2)
        row = {"gradients": kind, "optimizer": optimizer.__name__, "rate": rate}
        return row | {
            "linear": float(errors.linear[0]),
            "spread": float(errors.linear_spread[0]),
            "display": float(errors.displayed[0]),
        }

    for module in (Learner.__module__, judge.__module__, "warp_neural.kernels.nn.optimizers"):
        wp.load_module(module, device=source.device)  # before the threads, or each compiles it
    with threads(source.device) as (pool, going):
        rows = list(cli.progress(pool.map(attempt, jobs), config, desc="sweep", total=len(jobs)))
    with atomic_path(config.out / "sweep.json") as path:
        path.write_text(json.dumps(rows, indent=2) + "\n")
    best = {}
    for kind in gradients:
        for optimizer in RATES:
            of_this = [row for row in rows if (row["gradients"], row["optimizer"]) == (kind, optimizer.__name__)]
            winner = min(of_this, key=lambda row: row["linear"] + 2 * row["spread"])
            for key in ("rate", "linear", "display"):
                best[f"{key}_{kind}_{optimizer.__name__.lower()}"] = winner[key]
    return best
