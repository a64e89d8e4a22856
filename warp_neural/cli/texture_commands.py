"""`warp-neural compress` and `decompress`: from a folder of pictures to a neural texture's file, and back."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from warp_neural.cli.options import FOLDER, Between, Options, Seed, resolve_device
from warp_neural.cli.quantities import bytes_of, level_of, losses_of, names_of, rectangle_of, sides_of, weights_of
from warp_neural.cli.texture_info import describe_texture
from warp_neural.errors import InputError
from warp_neural.io.files import check_target
from warp_neural.texture.maps import TextureSet, load_set
from warp_neural.texture.save import encode_maps, save_blocks, save_maps
from warp_neural.texture.state import Map

ENGINE = ".safetensors"

Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]


@dataclass(frozen=True, kw_only=True)
class Compress(Options):
    """Compress a material's maps, or any pictures of one size, into one small neural texture.

    Of --bpp, --psnr, --size and --quality at most one; without any, the quality is medium.
    """

    source: tyro.conf.Positional[Path]
    """folder of pictures, or of folders level_0, level_1, ... that hold the mip levels; or one picture"""
    out: Out
    """file to write, .wntc; for engines .safetensors, with the latents' files beside it"""
    bpp: Annotated[float | None, Between(0, 64, above=True)] = None
    """bits a texel of mip 0 that the file should have, everything counted"""
    psnr: Annotated[float | None, Between(10, 80)] = None
    """dB that mip 0 should reach, all channels together"""
    size: str | None = None
    """of the file, such as 400kB or 400KiB"""
    quality: Literal["low", "medium", "high"] | None = None
    """at whatever size it takes"""
    storage: Annotated[Literal["load", "sample", "engine"], tyro.conf.arg(name="for")] = "load"
    """what is to be small: the file, decoded at load, or the latents in memory that shaders sample, which are packed
    integers (sample) or DDS textures of BC1 blocks that GPUs filter (engine); then --bpp is what these may take"""
    ktx2: bool = False
    """with --for engine, KTX 2.0 in place of DDS"""
    preview: bool = False
    """a fast, rougher result"""
    steps: Annotated[int | None, Between(100, 10_000_000)] = None
    """of training, in place of those that the device, the size and --preview lead to"""
    maps: str | None = None
    """names of those to take, as in albedo,normal; all by default"""
    weights: str | None = None
    """what errors count, by map, as in albedo=2,normal=1; 1 by default"""
    losses: str | None = None
    """what errors cost, by map: angle for normals, luminance for colours (less for chroma), l2 by default"""
    resize: str | None = None
    """scale all pictures, to a size as in 1024x512 or to that of the largest"""
    mips: str | None = None
    """mip levels in the file, or all; by default those that the source has"""
    resume: bool = False
    """go on from the checkpoint that a stopped run has left beside --out"""
    device: str = "auto"
    """auto (CUDA when present), cpu, cuda or cuda:N"""
    seed: Seed = 0
    """of every random draw; the same seed gives the same file on one device"""
    json: bool = False
    """print nothing but one JSON object, as the last line on stdout"""

    @property
    def checkpoints(self) -> Path:
        return self.out.parent / FOLDER

    def main(self) -> dict:
        from warp_neural import texture  # reads much that the other commands do without

        goals = self._goals()
        device = resolve_device(self.device)
        resize = sides_of("--resize", self.resize) if self.resize else None
        self._check_out()
        texture_set = load_set(self.source, maps=names_of(self.maps), resize=resize)
        weights = weights_of("--weights", self.weights, [each.name for each in texture_set.maps])
        losses = losses_of("--losses", self.losses)
        options = {
            "mips": self._mips(texture_set),
            "weights": weights,
            "losses": losses,
            "device": device,
            "seed": self.seed,
        }
        result = texture.compress(
            texture_set,
            **goals,
            storage=self.storage,
            preview=self.preview,
            steps=self.steps,
            checkpoint=self._checkpoint(),
            quiet=self.json,
            **options,
        )
        parts = result.save(self.out, *(["ktx2"] if self.ktx2 else []))
        if not result.metrics.get("goal_met", True):
            print(f"{self.out}: the goal was not met, see bits_per_texel and psnr", file=sys.stderr)
        described = describe_texture(result.state, parts, result.metrics)
        return {"written": str(self.out), **described, "left_out": list(texture_set.unused)}

    def _check_out(self) -> None:
        engine = self.storage == "engine"
        if engine != (self.out.suffix == ENGINE):
            raise InputError(f"{self.out}: name it {ENGINE if engine else '.wntc'} with --for {self.storage}")
        if self.ktx2 and not engine:
            raise InputError("--ktx2: is for latents of --for engine; leave it out, or see decompress --ktx2")
        check_target(self.out)

    def _goals(self) -> dict[str, Any]:
        goals = {name: getattr(self, name) for name in ("bpp", "psnr", "size", "quality")}
        given = [f"--{name}" for name, value in goals.items() if value is not None]
        if len(given) > 1:
            raise InputError(f"{' and '.join(given)}: each chooses how good and how large it is; give one of them")
        return goals | {"size": bytes_of("--size", self.size) if self.size is not None else None}

    def _mips(self, texture_set: TextureSet) -> int:
        most = max(texture_set.size).bit_length()
        if self.mips is None:
            return min(len(texture_set.levels), most)
        if self.mips == "all":
            return most
        if not self.mips.isdecimal() or len(self.mips) > 4 or not 1 <= int(self.mips) <= most:
            height, width = texture_set.size
            raise InputError(f"--mips {self.mips}: {width} x {height} texels have 1 to {most} levels; give that or all")
        return int(self.mips)

    def _checkpoint(self) -> Path:
        path = self.checkpoints / f"{self.out.name}.safetensors"
        if self.resume and not path.is_file():
            raise InputError(f"--resume: there is no {path} of a run that was stopped; leave it out")
        if not self.resume:
            path.unlink(missing_ok=True)  # of an earlier run, which might be taken for this one's
        return path


@dataclass(frozen=True, kw_only=True)
class Decompress(Options):
    """Write a neural texture's maps as pictures: PNG, EXR where values go beyond 0 to 1, DDS or KTX 2.0."""

    file: tyro.conf.Positional[Path]
    """.wntc, or .safetensors of --for engine"""
    out: Out
    """folder for the pictures; of all mip levels, for folders level_0, level_1, ..."""
    mip: str = "0"
    """the level to write, or all"""
    maps: str | None = None
    """names of those to write, as in albedo,normal; all by default"""
    dds: bool = False
    """DDS, with the level and all smaller ones in it: BC7 colours, BC5 normals, BC4 for one channel, halves for HDR"""
    ktx2: bool = False
    """KTX 2.0, with the same in it"""
    bc1: bool = False
    """with --dds or --ktx2, colours in BC1, and BC3 with alpha"""
    best: bool = False
    """with --bc1, the best that there is, by quicktex"""
    exr: bool = False
    """EXR for all maps, colours as linear light"""
    rectangle: str | None = None
    """X,Y,W,H: only these texels of the level"""
    device: str = "auto"
    """auto (CUDA when present), cpu, cuda or cuda:N"""
    json: bool = False
    """print nothing but one JSON object, as the last line on stdout"""

    def main(self) -> dict:
        from warp_neural import texture

        blocks = self.dds or self.ktx2
        if self.dds + self.ktx2 + self.exr > 1 or (self.bc1 and not blocks) or (self.best and not self.bc1):
            raise InputError("--dds, --ktx2, --exr: give one; --bc1 only with --dds or --ktx2, and --best with --bc1")
        loaded = texture.load(self.file, resolve_device(self.device))
        spec, maps = loaded.state.spec, self._chosen(loaded.state.maps)
        mip = level_of("--mip", self.mip, spec.mips)
        if mip == "all" and self.rectangle is not None:
            raise InputError("--rectangle: lies in one mip level; leave --mip all out")
        first = 0 if mip == "all" else mip
        rectangle = rectangle_of("--rectangle", self.rectangle, spec.size(first))
        several = mip == "all" or (blocks and rectangle is None)
        levels = range(first, spec.mips if several else first + 1)
        decoded = [loaded.decode(mip=level, rectangle=rectangle) for level in levels]
        if blocks:
            encoded = encode_maps(decoded, maps, bc1=self.bc1, quality="best" if self.best else "fast")
            paths = save_blocks(self.out, encoded, "ktx2" if self.ktx2 else "dds")
        else:
            folders = [self.out / f"level_{level}" if mip == "all" else self.out for level in levels]
            pairs = zip(folders, decoded, strict=True)
            paths = [path for folder, arrays in pairs for path in save_maps(folder, arrays, maps, exr=self.exr)]
        height, width = next(iter(decoded[0].values())).shape[:2]
        return {"width": width, "height": height, "written": [str(path) for path in paths]}

    def _chosen(self, maps: tuple[Map, ...]) -> list[Map]:
        names = names_of(self.maps)
        for name in names or ():
            if name not in (each.name for each in maps):
                raise InputError(f"--maps {name}: {self.file} holds {', '.join(each.name for each in maps)}")
        if names == ():
            raise InputError(f"--maps: give some of {', '.join(each.name for each in maps)}")
        return [each for each in maps if names is None or each.name in names]
