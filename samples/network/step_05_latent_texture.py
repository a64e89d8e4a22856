"""network 5: a trainable texture before step 3, 1,315 + 4,096 parameters. Leaves step_05.png.

    python -m samples.network.step_05_latent_texture [--image FILE]

In place of step 4's fixed encoding, four numbers from a 32 x 32 texture, bilinearly, that training moves along with the
weights: detail lies in the texture, and the network, the same at every pixel, learns what to make of it.
"""

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.network.step_01_basic_network import fit
from warp_neural.samples.network.target import Config, load_target


def make_network(**options) -> wn.MLP:
    inside, outside = wn.activations.leaky_relu, wn.activations.exponential
    options["encoding"] = wn.encodings.LatentTexture(width=32, height=32, channels=4)
    return wn.MLP(2, 3, width=32, depth=2, activation=inside, output_activation=outside, **options)


def main(config: Config) -> dict:
    return fit(config, "step_05", make_network, load_target(config))[1]


if __name__ == "__main__":
    cli.run(main, Config)
