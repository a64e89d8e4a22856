"""A material by codecs of textures and pictures: `python -m perf.texture_codecs --material FOLDER`.

Size against error of its maps in our files, BC1 to BC7, JPEG, WebP, AVIF, smaller sizes, and what RTXNTC was recorded
at. Bits a texel count every file, network and header. All codecs get and are compared in 8 bits a channel, hdr as
logarithms. PSNR pools all channels; each map has its own, SSIM and FLIP, normals their angle, hdr its relative error;
and FLIP of a lit sphere says what of the error is seen.

Our files are those given, or made at 1, 2, 4 bits a texel and RTXNTC's sizes, of mip 0 alone; with --quick by
`preview`. Beside the result, sheets/MATERIAL has codecs.md and codecs.json with all figures and where we lose,
crops.png and sphere.png. `pip install -e '.[peers]'` brings the encoders of blocks.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import warp as wp

from perf import recorded
from perf.measure import Bench, Config
from perf.texture_page import losses_section, page
from perf.texture_peers import Coded, all_coded, check_installed
from perf.texture_pictures import crops, curves, side_by_side, spheres
from perf.texture_points import OURS, RTXNTC, Judge, Point, codes_of, load_material, recorded_points
from perf.texture_rivals import Rival, best_at_equal_bits, losses, rivals
from warp_neural.cli import Between, progress, run
from warp_neural.errors import InputError
from warp_neural.imaging.image import save_image
from warp_neural.io.files import atomic_path
from warp_neural.texture import compress, load
from warp_neural.texture.maps import TextureSet
from warp_neural.texture.measure import psnr

RATES = (1.0, 2.0, 4.0)  # bits a texel
OTHER_PICTURES = 1.0  # dB between a file's own PSNR and that against the material: of another one


@dataclass(frozen=True, kw_only=True)
class MaterialConfig(Config):
    material: Path
    """folder with maps, as ambientCG and Poly Haven name them, or a picture"""
    files: tuple[Path, ...] = ()
    """our files of the material; none: they are made"""
    made_on: str = "another machine"
    """where --files were made, for the record"""
    crop: Annotated[int | None, Between(16, 8192)] = None
    """side of the square that is cut out of the middle; none: the whole material"""

    def load(self) -> tuple[str, TextureSet]:
        """Its name, with --crop, and its maps."""
        texture_set = load_material(self.material, self.crop)
        return texture_set.name + (f"_{self.crop}" if self.crop else ""), texture_set


@dataclass(frozen=True, kw_only=True)
class CodecsConfig(MaterialConfig):
    bpp: Annotated[tuple[float, ...], Between(0, 64, above=True)] = ()
    """bits a texel of files that are made; none: 1, 2, 4 and where RTXNTC was recorded"""
    sheets: Path = Path("out/texture_codecs")
    """folder for folders of pictures and of all figures"""


def main(config: CodecsConfig) -> dict:
    check_installed()
    name, texture_set = config.load()
    bench = Bench(f"texture_codecs_{name}", config)
    judge, folder = Judge(texture_set, bench.device), config.sheets / name
    coded = [*ours(config, texture_set, bench.device, folder), *all_coded(judge.maps)]
    measured = [(each, judge.point(each)) for each in progress(coded, config, desc="codecs")]
    points = [point for _, point in measured] + recorded_points(name)
    found = rivals(points)
    lost, chosen = losses(found), side_by_side(measured)
    made_on = config.made_on if config.files else bench.device.name
    settings = {"our files": f"made on {made_on}", "texels": " x ".join(map(str, reversed(texture_set.size)))}
    bench.result.settings = settings
    add_figures(bench, points, found)
    save(folder / "codecs.json", json.dumps(record(name, settings, points, lost), indent=1))
    save(folder / "codecs.md", page(name, made_on, points, lost))
    save_image(folder / "crops.png", crops(judge.maps, chosen) / 255, color_space="linear")
    if judge.sphere is not None:
        with atomic_path(folder / "sphere.png") as temporary:
            spheres(judge, chosen).savefig(temporary, dpi=90, bbox_inches="tight")
    print("\n".join(losses_section([each for each in lost if each.its_bits == each.bits])))
    return bench.finish(lambda result: curves(points, name)) | {"losses": len(lost), "sheets": str(folder)}


def ours(config: CodecsConfig, texture_set: TextureSet, device: wp.Device, folder: Path) -> list[Coded]:
    """Files that are there, or new ones in `folder`, decoded; bytes of the whole file, whatever levels are in it."""
    coded = []
    for path in config.files or made(config, texture_set, device, folder):
        texture = load(path, device)
        check_same(path, texture, texture_set)
        mips = texture.state.spec.mips
        setting = path.name + (f", with {mips} mip levels" if mips > 1 else "")
        coded.append(Coded(OURS, setting, path.stat().st_size, codes_of(texture.decode(), texture_set.maps)))
    return coded


def check_same(path: Path, texture, texture_set: TextureSet) -> None:
    """Raises `InputError` for a file of other maps, another size, or other pictures than it says it has learned."""
    spec, names = texture.state.spec, [(each.name, each.channels) for each in texture.state.maps]
    same = (spec.height, spec.width) == texture_set.size
    same &= names == [(each.name, each.channels) for each in texture_set.maps]
    if same and spec.channels == texture_set.channels and "psnr" in texture.metrics:
        here = psnr(texture_set.values, texture.decoder.decode())
        same = abs(here - texture.metrics["psnr"]) < OTHER_PICTURES
    if not same:
        raise InputError(f"{path}: not a file of {texture_set.name}; compress it again, with --crop if it is cut")


def made(config: CodecsConfig, texture_set: TextureSet, device: wp.Device, folder: Path) -> list[Path]:
    paths = []
    wanted = config.bpp or sorted({*RATES, *(bits for bits, _ in recorded.RTXNTC.get(texture_set.name, []))})
    for bits in wanted:
        options = {"preview": config.quick, "device": device, "seed": config.seed, "quiet": config.json}
        paths.append(folder / f"{bits:g}.wntc")
        compress(texture_set, bpp=bits, **options).save(paths[-1])
    return paths


def add_figures(bench: Bench, points: list[Point], found: list[Rival]) -> None:
    """PSNR of all maps by codec, and of every measure how far ahead of the best other codec we are at equal bits."""
    for point in sorted((point for point in points if point.codec == OURS), key=lambda point: point.bits):
        bench.add("PSNR", column(point.bits), point.figures["PSNR"], "dB")
    for each in (each for each in found if each.measure == "PSNR"):
        where = column(each.bits) if each.its_bits == each.bits else "own size"
        bench.add(f"PSNR, {each.codec}", where, each.its, "dB", "" if where != "own size" else column(each.its_bits))
    if above := [-each.behind for each in found if (each.measure, each.codec) == ("PSNR", RTXNTC)]:
        bench.add("ahead: PSNR", f"least of {RTXNTC}", min(above), "dB")
    for measure, best in best_at_equal_bits(found).items():
        unit = {"PSNR": "dB", "degrees": "degrees"}.get(measure.split()[-1], "")
        for each in best:
            bench.add(f"ahead: {measure}", column(each.bits), -each.behind, unit, f"of {each.codec}")


def column(bits: float) -> str:
    return f"{bits:.2f} bits"


def record(name: str, settings: dict[str, str], points: list[Point], lost: list[Rival]) -> dict:
    rows = [asdict(each) | {"behind": each.behind} for each in lost]
    return {"material": name, "settings": settings, "points": [asdict(point) for point in points], "losses": rows}


def save(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    run(main, CodecsConfig)
