"""Modules of `warp_neural.torch` from records of tiny-cuda-nn; tests that import this are skipped without PyTorch."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="no PyTorch: pip install torch")

import warp_neural.torch as tcnn  # noqa: E402

torch.set_num_threads(1)  # tests run side by side


def make(record: dict) -> tcnn.Module:
    dtype = torch.float16 if record["param_precision"] == "fp16" else torch.float32
    if record["kind"] == "encoding":
        return tcnn.Encoding(record["n_in"], record["encoding"], dtype=dtype)
    if record["kind"] == "network":
        return tcnn.Network(record["n_in"], record["n_out"], record["network"], dtype=dtype)
    return tcnn.NetworkWithInputEncoding(
        record["n_in"], record["n_out"], record["encoding"], record["network"], dtype=dtype
    )


def gradients(module: tcnn.Module, x: np.ndarray, dy: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """y, dx and dparams of sum(dy * y), float32; on the module's device."""
    x, dy = (torch.from_numpy(values).to(module.params.device) for values in (x, dy))
    x.requires_grad_()
    y = module(x)
    (y.float() * dy).sum().backward()
    return tuple(values.detach().float().cpu().numpy() for values in (y, x.grad, module.params.grad))
