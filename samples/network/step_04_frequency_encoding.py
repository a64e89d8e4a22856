"""network 4: a frequency encoding before step 3, 1,699 parameters. Leaves step_04.png.

    python -m samples.network.step_04_frequency_encoding [--image FILE]

The network sees sines and cosines of 2 pi u and 2 pi v in four octaves instead of (u, v): what a step in u moves by
little moves the fourth octave by much. All have period 1, so opposite edges of the picture look alike to it.
"""

import warp_neural as wn
from warp_neural import cli
from warp_neural.samples.network.step_01_basic_network import fit
from warp_neural.samples.network.target import Config, load_target


def make_network(**options) -> wn.MLP:
    inside, outside = wn.activations.leaky_relu, wn.activations.exponential
    options["encoding"] = wn.encodings.Frequency(octaves=4, lowest=2.0)
    return wn.MLP(2, 3, width=32, depth=2, activation=inside, output_activation=outside, **options)


def main(config: Config) -> dict:
    return fit(config, "step_04", make_network, load_target(config))[1]


if __name__ == "__main__":
    cli.run(main, Config)
