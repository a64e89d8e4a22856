"""Neural textures with random latents in BC1 blocks."""

import numpy as np

from warp_neural.kernels.texture.block_latents import PARAMETERS
from warp_neural.kernels.texture.spec import BlockSpec
from warp_neural.texture.block_state import BlockState, to_bc1
from warp_neural.texture.state import Map, Tensor

MAPS = Map("albedo", "srgb", (0.0,) * 3, (1.0,) * 3), Map("height", "linear", (-2.0, 0.5), (5.0, 0.5))
SPEC = BlockSpec(48, 32, 4, 4, (1, 2, 4), (32, 32))


def make_state(spec=SPEC, seed=4, maps=MAPS):
    rng = np.random.default_rng(seed)
    most = np.array([31, 63, 31] * 2 + [3] * 16)
    counts = [[int(np.prod(spec.blocks(mip, g))) for mip in range(spec.mips)] for g in range(len(spec.scales))]
    blocks = tuple(tuple(to_bc1(rng.random((n, PARAMETERS)) * most) for n in levels) for levels in counts)
    tensors = {}
    for name, shape in spec.tensors.items():
        last, biases = name[-1] == "2", name.startswith("biases")
        values = rng.normal(0.5 if last and biases else 0, (0.03 if last else 0.2), shape)
        tensors[name] = Tensor(np.rint(256 * values).astype(np.int32), 1 / 256)
    return BlockState(spec, blocks, tensors, maps, {"psnr": 31.5})
