"""tiny-cuda-nn's network configurations as network specifications of this package."""

from dataclasses import dataclass

from warp_neural.kernels.nn import activations
from warp_neural.kernels.nn.activations import Activation
from warp_neural.kernels.nn.spec import FLOAT16, FLOAT32, NetworkSpec
from warp_neural.torch.options import Options

SIGMOID = "(1.0f / (1.0f + wp::exp(-10.0f * z)))"
ROOT = "wp::sqrt(z * z + 0.04f)"
EXP = "wp::exp(-10.0f * wp::abs(z))"
LOG = f"({EXP} < 1e-3f ? {EXP} * (1.0f - 0.5f * {EXP}) : wp::log(1.0f + {EXP}))"

# tiny-cuda-nn's are sharpened by 10: f(10 z) / 10 of those in wn.activations, squareplus with b = 4
sharp_softplus = Activation("sharp_softplus", f"(z > 0.0f ? z : 0.0f) + 0.1f * {LOG}", SIGMOID)
sharp_squareplus = Activation(
    "sharp_squareplus",
    f"z > 0.0f ? 0.5f * (z + {ROOT}) : 0.02f / ({ROOT} - z)",
    f"z > 0.0f ? 0.5f + 0.5f * z / {ROOT} : 0.02f / (({ROOT} - z) * {ROOT})",
)
ACTIVATIONS = {
    "None": activations.linear,
    "ReLU": activations.relu,
    "LeakyReLU": activations.leaky_relu,
    "Exponential": activations.exponential,
    "Sigmoid": activations.sigmoid,
    "Sine": activations.sine,
    "Squareplus": sharp_squareplus,
    "Softplus": sharp_softplus,
    "Tanh": activations.tanh,
}


@dataclass(frozen=True)
class NetworkOptions:
    """Of a network's configuration. biases: not tiny-cuda-nn's: every layer has them, and they are trained."""

    width: int
    depth: int
    activation: Activation
    output_activation: Activation
    biases: bool

    def spec(self, n_in: int, n_out: int, half: bool) -> NetworkSpec:
        sizes = (n_in, *[self.width] * self.depth, n_out)
        return NetworkSpec(sizes, self.activation, self.output_activation, FLOAT16 if half else FLOAT32)


def read_network(config: dict, where: str = "network_config") -> NetworkOptions:
    """Raises `InputError` naming what is not supported."""
    options = Options(where, config)
    fused = options.choice("otype", {"FullyFusedMLP": True, "CutlassMLP": False, "MLP": False}, REFUSED)
    network = NetworkOptions(
        options.whole("n_neurons", 128),
        options.whole("n_hidden_layers", 5, 1 if fused else 0),
        options.choice("activation", ACTIVATIONS, {}, "ReLU"),
        options.choice("output_activation", ACTIVATIONS, {}, "None"),
        options.flag("biases"),
    )
    options.end()
    return network


REFUSED = {"MegakernelMLP": "the nearest is 'FullyFusedMLP'", "TorchMLP": "the nearest is 'CutlassMLP'"}
