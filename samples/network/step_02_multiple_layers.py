"""network 2: two hidden layers of 32 neurons, 1,251 parameters. Leaves step_02.png, the target on the left.

    python -m samples.network.step_02_multiple_layers [--image FILE]

Only the network differs from step 1. Each hidden ReLU folds the picture along a line. Large flat areas come; edges stay
soft, and where an output began below 0, as all biases begin at 0, it may stay black.
"""

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.network.step_01_basic_network import fit
from warp_neural.samples.network.target import Config, load_target


def make_network(**options) -> wn.MLP:
    return wn.MLP(2, 3, width=32, depth=2, output_activation=wn.activations.relu, **options)


def main(config: Config) -> dict:
    return fit(config, "step_02", make_network, load_target(config))[1]


if __name__ == "__main__":
    cli.run(main, Config)
