"""shader 3: four networks learn one image, and the best is kept. Leaves step_03.png and step_03.safetensors.

    python -m samples.shader_training.step_03_model_exploration [--image FILE]

Plain: the position, ReLU. Frequency: its sines and cosines of 3 octaves, leaky ReLU. Latent: these and a trainable
texture of 32 x 32 x 4. Ours spends fewer parameters than that otherwise, as image formats do: one channel fine, for
the edges, four coarse ones, for the colours, and one hidden layer. Expect 20.0, 24.9, 27.4 and 28.5 dB on the CPU.
"""

from dataclasses import dataclass

import warp as wp

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.shader_training.figures import save_fits
from warp_neural.samples.shader_training.photo import PhotoConfig, bilinear, load_photo, picture, psnr

OCTAVES = wn.encodings.Frequency(octaves=3)
LATENT = wn.encodings.LatentTexture(32, 32, 4)
FINE, COARSE = wn.encodings.LatentTexture(72, 72, 1), wn.encodings.LatentTexture(14, 14, 4)


@dataclass(frozen=True, kw_only=True)
class Config(PhotoConfig):
    steps: cli.Count | None = None
    """of each network; none: 2000 of 2048 samples on the CPU, 10000 of 65,536 on CUDA"""


@wp.func
def sample(index: int, random: wn.random.Stream, texels: wp.array2d[wp.vec3]) -> tuple[wp.vec2, wp.vec3]:
    u = wn.random.uniform(random, 0)
    uv = wp.vec2(u[0], u[1])
    return uv, bilinear(texels, uv)


def make_networks(seed: int, device: wp.Device) -> dict[str, wn.MLP]:
    common = {"output_activation": wn.activations.sigmoid, "seed": seed, "device": device}
    leaky = {"activation": wn.activations.leaky_relu, **common}
    latent, ours = wn.encodings.Concatenate((OCTAVES, LATENT)), wn.encodings.Concatenate((OCTAVES, FINE, COARSE))
    return {
        "plain 3x32": wn.MLP(2, 3, width=32, depth=3, **common),
        "frequency": wn.MLP(2, 3, width=32, depth=3, encoding=OCTAVES, **leaky),
        "latent texture": wn.MLP(2, 3, width=32, depth=3, encoding=latent, **leaky),
        "ours: fine and coarse": wn.MLP(2, 3, width=32, depth=1, encoding=ours, **leaky),
    }


def main(config: Config) -> dict:
    device = cli.resolve_device(config.device)
    pixels = load_photo(config)
    texels = wp.array(pixels, dtype=wp.vec3, device=device)
    steps = config.steps or (10000 if device.is_cuda else 2000)
    networks, fits, metrics = make_networks(config.seed, device), {}, {}
    for name, net in networks.items():
        adam = wn.optim.Adam(lr=wn.optim.cosine(1e-2, 0.0, steps), eps=1e-15)  # texels have small gradients
        trainer = wn.Trainer(
            net, sample=sample, data=texels, loss=wn.losses.gamma_l2, optimizer=adam, seed=config.seed,
            batch=1 << 16 if device.is_cuda else 2048,
        )  # fmt: skip
        cli.train(trainer, steps, config, f"step_03 {name.replace(':', '')}")
        fits[name] = picture(net, len(pixels))
        metrics[name] = {"psnr": psnr(pixels, fits[name]), "parameters": net.master.size}
    best = max(metrics, key=lambda name: metrics[name]["psnr"])
    wn.save_network(config.out / "step_03.safetensors", networks[best])
    save_fits(config.out / "step_03.png", pixels, fits, metrics)
    return {"networks": metrics, "best": best, "steps": steps}


if __name__ == "__main__":
    cli.run(main, Config)
