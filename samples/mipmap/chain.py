"""`--levels N`: a whole mip chain, each level learned."""

from dataclasses import replace

from warp_neural import cli
from warp_neural.errors import InputError
from warp_neural.imaging.exr_mips import save_exr_mips
from warp_neural.samples.mipmap.classical import box_filter, toksvig
from warp_neural.samples.mipmap.figures import CHANNELS, save_maps, stacked
from warp_neural.samples.mipmap.judge import judge
from warp_neural.samples.mipmap.learn import Learner, Recipe, run
from warp_neural.samples.mipmap.maps import Maps, MaterialConfig, pack


def learn_chain(config: MaterialConfig, source: Maps, recipe: Recipe, steps: int) -> list[dict[str, float]]:
    """Learn levels 1 to `config.levels`, 1x1 at most; write `chain/level_K/` and `chain/chain.exr`. Errors of each.

    Level 1 learns from the source's 2 x 2 texels, each further one from the 4 x 4 texels of the level two above it,
    learned ones from level 3 on: a texel always averages few, and the cost falls from level to level. Every level is
    judged against all of the source's texels below it. The EXR is complete: Toksvig's maps fill levels not learned.
    """
    size = source.shape[0]
    if source.shape != (size, size) or size & (size - 1):
        raise InputError(
            f"--levels: {source.shape[1]} x {source.shape[0]} has no side that is a power of two, or is no square; "
            f"use --crop {1 << min(source.shape).bit_length() - 1}"
        )
    device = cli.resolve_device(config.device)
    chain = [source]
    rows = []
    for level in cli.progress(range(1, size.bit_length()), config, desc="levels"):
        classical = toksvig(source, 2**level)
        if level > config.levels:
            chain.append(classical)
            continue
        above, factor = (chain[0], 2) if level == 1 else (chain[level - 2], 4)
        here = replace(recipe, start=toksvig(above, factor))
        packed = pack(above, factor, device)
        learner = Learner(packed, here, steps=steps, pairs=config.pairs, seed=4 * config.seed + 1)
        run(learner, range(steps), every=steps, watch=lambda step: None)
        chain.append(learner.maps())
        candidates = {"box": box_filter(source, 2**level), "toksvig": classical, "adam": chain[level]}
        pairs = max(config.judge_pairs // 4, 1)
        errors = judge(pack(source, 2**level, device), list(candidates.values()), pairs=pairs, seed=4 * config.seed + 3)
        row = {"level": level, "size": size >> level}
        row |= {f"linear_{name}": float(errors.linear[i]) for i, name in enumerate(candidates)}
        rows.append(row | {f"display_{name}": float(errors.displayed[i]) for i, name in enumerate(candidates)})
    for level, maps in enumerate(chain):
        save_maps(config.out / "chain" / f"level_{level}", maps)
    save_exr_mips(config.out / "chain" / "chain.exr", [stacked(maps) for maps in chain], CHANNELS)
    return rows
