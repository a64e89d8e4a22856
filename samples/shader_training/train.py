"""The network, how it is trained, and where it is kept."""

from dataclasses import dataclass
from pathlib import Path

import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.nn.convert import Form
from warp_neural.samples.shader_training.disney import ENCODING, N_IN, N_OUT, draw
from warp_neural.samples.shader_training.loss import RelativeError

EPOCH = 100  # steps
LOSS = RelativeError("relative_error", "", "", (0.3, 1.0, 0.1, 0.2))
RTXNS_LOSS = wn.losses.relative_l2.weighted(1, 10, 1, 5)


@dataclass(frozen=True)
class Recipe:
    """Adam, its rate on a cosine from `rate` to 0. An epoch has 100 steps of `batch` samples."""

    epochs: int
    batch: int
    rate: float = 1e-2
    loss: wn.losses.Loss = LOSS

    @property
    def steps(self) -> int:
        return self.epochs * EPOCH


def make_net(device: wp.DeviceLike, seed: int) -> wn.MLP:
    """30-32-32-32-4, the network of RTXNS's shader training."""
    exponential = wn.activations.exponential
    return wn.MLP(
        N_IN, N_OUT, width=32, depth=3, encoding=ENCODING, output_activation=exponential, seed=seed, device=device
    )


def train(net: wn.MLP, recipe: Recipe, config: cli.TrainingConfig) -> float:
    """Follow the recipe; the seconds it takes after the first step, which compiles."""
    rates = wn.optim.cosine(recipe.rate, 0.0, recipe.steps)
    trainer = wn.Trainer(
        net, sample=draw, loss=recipe.loss, optimizer=wn.optim.Adam(lr=rates), batch=recipe.batch, seed=config.seed
    )
    return cli.train(trainer, recipe.steps, config)


def load(path: Path, device: wp.DeviceLike) -> wn.MLP:
    """A network of 5 inputs and 4 outputs from our file, or from one of RTXNS's with its encoding in front."""
    if Form.of_file(path) is Form.SAFETENSORS:
        net = wn.load_network(path, device=device)
    else:
        net = wn.load_rtxns(path, n_in=N_IN, encoding=ENCODING, device=device)
    if (net.n_in, net.n_out) != (N_IN, N_OUT):
        raise wn.InputError(
            f"{path}: {net.n_in} inputs and {net.n_out} outputs; the BRDF has {N_IN} and {N_OUT}: "
            "give a network by samples.shader_training"
        )
    return net


def save(folder: Path, net: wn.MLP) -> None:
    """In our form and both of RTXNS's."""
    wn.save_network(folder / "network.safetensors", net)
    wn.save_rtxns(folder / "network.ns.bin", net)
    wn.save_rtxns(folder / "network.json", net)
