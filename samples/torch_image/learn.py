"""The loop: a PyTorch module, a PyTorch loss, a PyTorch optimizer."""

from collections.abc import Callable

import numpy as np
import torch
import warp as wp

import warp_neural.torch as tcnn
from warp_neural import cli
from warp_neural.cli import CommonConfig
from warp_neural.errors import InputError

LOSSES: dict[str, Callable[[torch.Tensor, torch.Tensor], torch.Tensor]] = {
    "L2": lambda y, target: (y - target).square().mean(),
    "RelativeL2": lambda y, target: ((y - target).square() / (y.detach().square() + 0.01)).mean(),
}


def learn(config: CommonConfig, description: dict, target: np.ndarray) -> tuple[np.ndarray, int]:
    """The learned picture, linear [height, width, 3], and the number of parameters."""
    device = wp.device_to_torch(cli.resolve_device(config.device))
    generator = torch.Generator(device).manual_seed(config.seed)
    image = torch.from_numpy(target).to(device)

    model = tcnn.NetworkWithInputEncoding(2, 3, description["encoding"], description["network"], config.seed).to(device)
    loss_of, optimizer = make_loss(description["loss"]), make_optimizer(description["optimizer"], model)
    for _ in cli.progress(range(config.steps), config, desc="steps"):
        uv = torch.rand((config.batch, 2), device=device, generator=generator)
        loss = loss_of(model(uv).float(), colours(image, uv))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()

    with torch.no_grad():
        return model(centres(*target.shape[:2], device)).float().cpu().numpy(), model.params.numel()


def colours(image: torch.Tensor, uv: torch.Tensor) -> torch.Tensor:
    """Bilinear between the centres of pixels, [n, 3]; beyond the outermost, theirs."""
    size = torch.tensor([image.shape[1], image.shape[0]], device=uv.device)
    place = uv * size - 0.5
    low = place.floor()
    u, v = (place - low).unsqueeze(-1).unbind(1)
    x, y = ([(low[:, axis].long() + step).clamp(0, int(size[axis]) - 1) for step in (0, 1)] for axis in (0, 1))
    top = torch.lerp(image[y[0], x[0]], image[y[0], x[1]], u)
    return torch.lerp(top, torch.lerp(image[y[1], x[0]], image[y[1], x[1]], u), v)


def centres(height: int, width: int, device: torch.device) -> torch.Tensor:
    """uv of the pixels, [height, width, 2]."""
    v, u = ((torch.arange(n, device=device) + 0.5) / n for n in (height, width))
    return torch.stack(torch.meshgrid(u, v, indexing="xy"), dim=-1)


def make_loss(description: dict) -> Callable[[torch.Tensor, torch.Tensor], torch.Tensor]:
    name = description.get("otype")
    if name not in LOSSES:
        raise InputError(f"loss otype {name!r}: this sample has {', '.join(LOSSES)}")
    return LOSSES[name]


def make_optimizer(description: dict, model: tcnn.Module) -> torch.optim.Optimizer:
    """Adam, also where another optimizer is nested around it."""
    while description.get("otype") != "Adam":
        if "nested" not in description:
            raise InputError(f"optimizer otype {description.get('otype')!r}: this sample has Adam")
        description = description["nested"]
    betas = description.get("beta1", 0.9), description.get("beta2", 0.999)
    rate, epsilon = description.get("learning_rate", 1e-3), description.get("epsilon", 1e-8)
    return torch.optim.Adam(model.parameters(), lr=rate, betas=betas, eps=epsilon)
