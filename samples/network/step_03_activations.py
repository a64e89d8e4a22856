"""network 3: leaky ReLU inside, exponential outside; still 1,251 parameters. Leaves step_03.png.

    python -m samples.network.step_03_activations [--image FILE]

The activations differ from step 2. No neuron is without derivative any more, and colours are positive from the start.
"""

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.network.step_01_basic_network import fit
from warp_neural.samples.network.target import Config, load_target


def make_network(**options) -> wn.MLP:
    inside, outside = wn.activations.leaky_relu, wn.activations.exponential
    return wn.MLP(2, 3, width=32, depth=2, activation=inside, output_activation=outside, **options)


def main(config: Config) -> dict:
    return fit(config, "step_03", make_network, load_target(config))[1]


if __name__ == "__main__":
    cli.run(main, Config)
