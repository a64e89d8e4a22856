"""A material by codecs of textures and pictures: `python -m perf.texture_codecs --material FOLDER --out DIR`.

Size against error of its maps in BC1 to BC7, JPEG, WebP, AVIF, smaller sizes, and what RTXNTC was recorded at. Bits a
texel count every file, network and header. PSNR pools 8-bit values as stored, over all channels; each map has its own,
SSIM and FLIP; and FLIP of a lit sphere says what of the error is seen. Leaves curves.png, crops.png, sphere.png,
codecs.md with a section on where we lose, and codecs.json.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from perf.texture_peers import all_coded, check_installed
from perf.texture_pictures import crops, curves, side_by_side, spheres
from perf.texture_points import Judge, Loss, Point, load_maps, losses, recorded_points
from warp_neural.cli import Between, CommonConfig, progress, resolve_device, run
from warp_neural.imaging.image import save_image
from warp_neural.io.files import atomic_path


@dataclass(frozen=True, kw_only=True)
class Config(CommonConfig):
    material: Path
    """folder with maps, as ambientCG and Poly Haven name them"""
    out: Path = Path("out/texture_codecs")
    """folder for pictures, tables and JSON"""
    crop: Annotated[int | None, Between(16, 8192)] = None
    """side of the square that is cut out of the middle; none: the whole material"""


def main(config: Config) -> dict:
    check_installed()
    device = resolve_device(config.device)
    maps = load_maps(config.material, config.crop)
    judge = Judge(maps, device)
    coded = all_coded(maps)
    measured = [(each, judge.point(each)) for each in progress(coded, config, desc="codecs")]
    name = config.material.resolve().name
    points = [point for _, point in measured] + (recorded_points(name) if config.crop is None else [])
    lost = losses(points)
    write(config.out / "codecs.json", json.dumps({"material": name, "points": [asdict(p) for p in points]}, indent=1))
    write(config.out / "codecs.md", page(name, points, lost))
    save_figure(config.out / "curves.png", curves(points, name))
    save_image(config.out / "crops.png", crops(maps, side_by_side(measured)) / 255, color_space="linear")
    save_figure(config.out / "sphere.png", spheres(judge, side_by_side(measured)))
    return {f"{p.codec} {p.setting} / {p.bits:.3f} bits": p.figures["PSNR"] for p in points} | {"losses": len(lost)}


def write(path: Path, text: str) -> None:
    with atomic_path(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def save_figure(path: Path, figure) -> None:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=90, bbox_inches="tight")


def page(material: str, points: list[Point], lost: list[Loss]) -> str:
    measures = list(dict.fromkeys(measure for point in points for measure in point.figures))
    lines = [f"# {material}", "", row(["codec", "setting", "bits", *measures]), row(["---"] * (3 + len(measures)))]
    for point in points:
        figures = [number(point.figures[m]) if m in point.figures else "" for m in measures]
        lines.append(row([point.codec, point.setting, number(point.bits), *figures]))
    lines += ["", "## Where we lose", ""]
    if lost:
        lines += ["At the other's bits, or at those of our largest file.", ""]
        lines += [row(["measure", "codec", "its bits", "its figure", "our bits", "our figure"]), row(["---"] * 6)]
    for loss in sorted(lost, key=lambda loss: (loss.figure, loss.other.codec, loss.other.bits)):
        figures = (loss.other.bits, loss.other.figures[loss.figure], loss.bits, loss.ours)
        lines.append(row([loss.figure, loss.other.codec, *map(number, figures)]))
    return "\n".join(lines)


def row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


def number(value: float) -> str:
    return f"{value:.2f}" if abs(value) >= 1.5 else f"{value:.4f}"


if __name__ == "__main__":
    run(main, Config)
