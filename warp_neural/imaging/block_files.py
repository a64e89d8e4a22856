"""Textures in block formats from files, whichever of the two it is."""

from pathlib import Path

from warp_neural.errors import InputError
from warp_neural.imaging import dds, ktx2
from warp_neural.imaging.block_texture import BlockTexture


def load_blocks(path: Path | str) -> BlockTexture:
    """A .dds or .ktx2 file, by its content. Raises `InputError` for one that is damaged or holds something else."""
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); give a .dds or .ktx2 file") from error
    try:
        if data.startswith(ktx2.MAGIC):
            return ktx2.parse_ktx2(data)
        if data.startswith(dds.MAGIC):
            return dds.parse_dds(data)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    raise InputError(f"{path}: neither DDS nor KTX 2.0; give a .dds or .ktx2 file")
