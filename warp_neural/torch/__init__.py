"""Networks and encodings as PyTorch modules, with tiny-cuda-nn's constructors and configuration.

    import warp_neural.torch as tcnn

    model = tcnn.NetworkWithInputEncoding(3, 4, encoding_config, network_config)

Batches of any size, on the CPU and on CUDA, without a compiler. See `Module` for what all of them share, and
`load_tcnn_params` for parameters of tiny-cuda-nn's own.
"""

from importlib import import_module

try:
    import_module("torch")  # before the modules below, which need it
except ModuleNotFoundError as error:
    raise ModuleNotFoundError("warp_neural.torch needs PyTorch: pip install 'warp-neural[torch]'") from error

from warp_neural.torch.modules import Encoding, Module, Network, NetworkWithInputEncoding, supports_jit_fusion
from warp_neural.torch.sharing import from_warp

__all__ = ["Encoding", "Module", "Network", "NetworkWithInputEncoding", "from_warp", "supports_jit_fusion"]
