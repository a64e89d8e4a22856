"""A material resident in memory, by storage: `python -m perf.texture_storage --material FOLDER`.

Textures of `compress` for sampling and for engines, beside block formats of all maps: the bits a texel that a GPU holds
while it reads them (mip 0, networks apart), those of the files after zstd, PSNR of all channels in 8
bits, FLIP of each map and in the mean over them, and of a lit sphere. RTXNTC stands at its nominal bits of latents.

`pip install -e '.[peers]'` brings the encoders of blocks and zstd.
"""

from dataclasses import dataclass
from pathlib import Path

from perf import recorded
from perf.measure import Bench
from perf.texture_codecs import MaterialConfig, check_same
from perf.texture_peers import Coded, block_formats, check_installed
from perf.texture_points import Judge, codes_of
from warp_neural.cli import progress, run
from warp_neural.texture import Texture, compress, load
from warp_neural.texture.engine import EngineTexture
from warp_neural.texture.maps import TextureSet

SAMPLE = 1.0625, 1.625, 3.75, 5.0, 6.4375, 10.0
ENGINE = 5.0, 10.0
RTXNTC = {1.0625: 1.11, 1.625: 1.67, 3.75: 3.75, 6.4375: 6.67}
"""its nominal bits beside ours, in the order of its recorded figures"""
LEVEL = 19  # of zstd


@dataclass(frozen=True, kw_only=True)
class StorageConfig(MaterialConfig):
    kept: Path = Path("out/texture_storage")
    """folder for folders of files that are made"""


def main(config: StorageConfig) -> dict:
    check_installed("zstandard")
    name, texture_set = config.load()
    bench = Bench(f"texture_storage_{name}", config)
    made_on = config.made_on if config.files else bench.device.name
    size = " x ".join(map(str, reversed(texture_set.size)))
    bench.result.settings = {"our files": f"made on {made_on}", "texels": size, "zstd": str(LEVEL)}
    judge = Judge(texture_set, bench.device)
    paths = config.files or make(config, texture_set, bench)
    for path in progress(sorted(paths), config, desc="ours"):
        texture = load(path, bench.device)
        check_same(path, texture, texture_set)
        add_ours(bench, judge, path, texture, name)
    for coded in progress(block_formats(judge.maps), config, desc="blocks"):
        column = coded.setting
        add_figures(bench, judge, coded, column)
        bench.add("bits in memory", column, 8 * coded.size / judge.texels, "")
    return bench.finish(curves)


def make(config: StorageConfig, texture_set: TextureSet, bench: Bench) -> list[Path]:
    folder, paths = config.kept / texture_set.name, []
    options = {"preview": config.quick, "device": bench.device, "seed": config.seed, "quiet": config.json}
    for storage, rates, suffix in (("sample", SAMPLE, "wntc"), ("engine", ENGINE, "safetensors")):
        for bits in rates[:1] if config.quick else rates:
            paths.append(folder / f"{storage}_{bits:g}.{suffix}")
            compress(texture_set, bpp=bits, storage=storage, **options).save(paths[-1])
    return paths


def add_ours(bench: Bench, judge: Judge, path: Path, texture: Texture, material: str) -> None:
    import zstandard

    engine, bits = isinstance(texture, EngineTexture), texture.state.spec.resident_bits
    column = f"{'engine' if engine else 'sample'} {bits:.2f}"
    files = [path, *sorted(path.parent.glob(f"{path.stem}_latent_*"))] if engine else [path]
    packed = sum(len(zstandard.compress(each.read_bytes(), LEVEL)) for each in files)
    coded = Coded("Warp Neural", column, packed, codes_of(texture.decode(), tuple(judge.described.values())))
    found = add_figures(bench, judge, coded, column)
    bench.add("bits in memory", column, bits, "")
    bench.add("bits in files", column, 8 * packed / judge.texels, "")
    if not engine and bits in RTXNTC and material in recorded.RTXNTC:
        _, its = recorded.RTXNTC[material][list(RTXNTC).index(bits)]
        bench.recorded("PSNR, RTXNTC", column, its, "dB")
        bench.add("ahead: PSNR", column, found - its, "dB", f"of RTXNTC at {RTXNTC[bits]}")


def add_figures(bench: Bench, judge: Judge, coded: Coded, column: str) -> float:
    """Returns the PSNR."""
    figures = judge.point(coded).figures
    flips = {name: value for name, value in figures.items() if name.endswith(" FLIP")}
    of_maps = [value for name, value in flips.items() if name != "sphere FLIP"]
    bench.add("PSNR", column, figures["PSNR"], "dB")
    bench.add("FLIP", column, sum(of_maps) / len(of_maps), "", "mean of the maps")
    for name, value in flips.items():
        bench.add(name, column, value, "")
    return figures["PSNR"]


def curves(result):
    """PSNR and FLIP over the bits in memory."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.5), layout="constrained")
    values = {(each.row, each.column): each.value for each in result.figures}
    columns = [column for row, column in values if row == "bits in memory"]
    for axis, row in zip(figure.subplots(1, 2), ("PSNR", "FLIP"), strict=True):
        for kind, color in (("sample", "C0"), ("engine", "C2"), ("BC", "C3")):
            mine = sorted((values["bits in memory", c], values[row, c]) for c in columns if c.startswith(kind))
            label = {"BC": "BC1 to BC7 of all maps"}.get(kind, f"for {kind}")
            axis.plot(*zip(*mine, strict=True), "s" if kind == "BC" else "o-", color=color, label=label)
        axis.set(title=row, xscale="log", xlabel="bits a texel in memory")
        axis.grid(alpha=0.3)
        axis.legend()
    return figure


if __name__ == "__main__":
    run(main, StorageConfig)
