"""A neural texture in plain PyTorch: the training step of `warp_neural.texture`, written straight down.

Latents lie in grids, each read by kernels that depend on the texel's place in its cell; a network makes the channels of
all grids into those of the texture. The loss is the mean squared error and `rate_weight` times the bits a texel that
the latents take, by a Laplace distribution a channel. Latents carry noise of half a step.
"""

from collections.abc import Callable

import numpy as np
import torch  # noqa: TID253  only `perf.texture_torch` imports this file, where PyTorch is installed
from torch import Tensor, nn  # noqa: TID253
from torch.nn.functional import elu, softplus  # noqa: TID253

from warp_neural.kernels.texture.levels import TILE
from warp_neural.kernels.texture.spec import Grid, TextureSpec

BILINEAR = 0.3  # times the weights of bilinear interpolation; trained kernels start there
LEAST = 0.02  # sigma
FLOOR = 2.0**-24  # of a probability, as a coder has
LATENT_RATE, NETWORK_RATE = 0.3, 5e-3


class Texture(nn.Module):
    """targets: [height, width, channels]. Sides are multiples of the coarsest grid's scale."""

    def __init__(self, spec: TextureSpec, targets: np.ndarray, rate_weight: float):
        super().__init__()
        self.spec, self.rate_weight = spec, rate_weight
        self.register_buffer("targets", torch.from_numpy(targets))
        cells = [spec.cells(0, g) for g in range(len(spec.grids))]
        grids = list(zip(spec.grids, cells, strict=True))
        self.latents = nn.ParameterList([torch.randn(*size, grid.channels) for grid, size in grids])
        self.scales = nn.ParameterList([torch.zeros(grid.channels) for grid in spec.grids])
        shapes = {name: shape for name, shape in spec.tensors.items() if name.startswith("kernel")}
        start = {name: first_kernel(spec.grids[int(name.split("_")[1])], shape) for name, shape in shapes.items()}
        self.kernels = nn.ParameterDict(start)
        self.layers = nn.ModuleList([nn.Linear(n_in, n_out) for n_out, n_in in spec.layers])

    def forward(self, corners: Tensor) -> Tensor:
        """The loss of tiles whose first texels are `corners`, [tiles, 2]."""
        return self.loss(self.patches(corners), self.target(corners))

    def patches(self, corners: Tensor) -> list[Tensor]:
        """Of each grid, latents of the tiles' cells and the next ones, with noise: [tiles, side, side, channels]."""
        found = []
        for grid, latents in zip(self.spec.grids, self.latents, strict=True):
            rows, columns = around(corners // grid.scale, TILE // grid.scale + 1, latents.shape)
            noisy = latents[rows, columns]
            found.append(noisy + torch.rand_like(noisy) - 0.5)
        return found

    def target(self, corners: Tensor) -> Tensor:
        rows, columns = around(corners, TILE, self.targets.shape)
        return self.targets[rows, columns]

    def loss(self, patches: list[Tensor], target: Tensor) -> Tensor:
        x = torch.cat([self.read(g, patch) for g, patch in enumerate(patches)], -1)  # [tiles, TILE, TILE, n_in]
        for layer in self.layers[:-1]:
            x = elu(layer(x))
        error = (self.layers[-1](x).float() - target).square().mean()
        return error + self.rate_weight * self.bits(patches) / target[..., 0].numel()

    def read(self, g: int, patch: Tensor) -> Tensor:
        """A grid's channels of every texel, [tiles, TILE, TILE, channels]."""
        n = patch.shape[1] - 1
        taps = torch.stack([patch[:, y : y + n, x : x + n] for y in (0, 1) for x in (0, 1)], 3)
        read = torch.einsum("thwkc,cyxk->thywxc", taps, self.kernel(g))
        return read.reshape(len(patch), TILE, TILE, -1)

    def kernel(self, g: int) -> Tensor:
        """[channels, scale, scale, 4]."""
        grid = self.spec.grids[g]
        if grid.kernel == "learned":
            return self.kernels[f"kernel_{g}"]
        if grid.kernel == "separable":
            y, x = self.kernels[f"kernel_{g}_y"], self.kernels[f"kernel_{g}_x"]
        else:
            y = x = BILINEAR**0.5 * line(grid).to(self.targets).expand(grid.channels, -1, -1)
        return torch.einsum("cya,cxb->cyxab", y, x).flatten(-2)

    def bits(self, patches: list[Tensor]) -> Tensor:
        """Of the tiles' own cells."""
        with torch.autocast(patches[0].device.type, enabled=False):
            own = [patch[:, :-1, :-1].float() for patch in patches]
            return sum(laplace_bits(q, softplus(s) + LEAST).sum() for q, s in zip(own, self.scales, strict=True))


def around(corners: Tensor, side: int, shape: torch.Size) -> tuple[Tensor, Tensor]:
    """Rows and columns of side x side places from each corner on, which wrap; to index with."""
    offsets = torch.arange(side, device=corners.device)
    rows, columns = ((corners[:, a, None] + offsets) % shape[a] for a in (0, 1))
    return rows[:, :, None], columns[:, None, :]


def line(grid: Grid) -> Tensor:
    """Weights of linear interpolation, [scale, 2]."""
    f = (torch.arange(grid.scale) + 0.5) / grid.scale
    return torch.stack([1 - f, f], -1)


def first_kernel(grid: Grid, shape: tuple[int, ...]) -> Tensor:
    if grid.kernel == "separable":
        return BILINEAR**0.5 * (line(grid) + 0.3 * torch.randn(shape))
    both = torch.einsum("ya,xb->yxab", line(grid), line(grid)).flatten(-2)
    return BILINEAR * (both + 0.3 * torch.randn(shape))


def laplace_bits(q: Tensor, sigma: Tensor) -> Tensor:
    """Of the mass of a Laplace distribution, of mean deviation sigma, between q - 1/2 and q + 1/2."""
    d = q.abs()
    near = d.clamp(max=0.5)
    inside = 1 - 0.5 * torch.exp(-(0.5 + near) / sigma) - 0.5 * torch.exp(-(0.5 - near) / sigma)
    outside = 0.5 * (1 - torch.exp(-1 / sigma)) * torch.exp(-(d.clamp(min=0.5) - 0.5) / sigma)
    return -torch.log2(torch.where(d < 0.5, inside, outside) + FLOOR)


def make_step(texture: Texture, tiles: int, dtype: torch.dtype, compiled: bool) -> Callable[[], Tensor]:
    """A call that takes a step of new tiles, everything by Adam, and returns the loss. dtype: of products, by autocast;
    float16 with a scaled loss."""
    device, coarsest = texture.targets.device, texture.spec.grids[-1].scale
    network = [*texture.layers.parameters(), *texture.kernels.parameters(), *texture.scales]
    groups = [{"params": list(texture.latents), "lr": LATENT_RATE}, {"params": network, "lr": NETWORK_RATE}]
    optimizer = torch.optim.Adam(groups, betas=(0.9, 0.99), capturable=device.type == "cuda")
    scaler = torch.amp.GradScaler(device.type, enabled=dtype is torch.float16)
    places = [side // coarsest for side in texture.targets.shape[:2]]
    evaluate = torch.compile(texture) if compiled else texture

    def step() -> Tensor:
        corners = torch.stack([torch.randint(n, (tiles,), device=device) * coarsest for n in places], 1)
        optimizer.zero_grad()
        with torch.autocast(device.type, dtype, enabled=dtype is not torch.float32):
            loss = evaluate(corners)
        scaler.scale(loss).backward()
        scaler.step(optimizer)
        scaler.update()
        return loss

    return step
