"""Backpropagation: the package's own adjoints behind `torch.autograd`."""

import torch

from warp_neural.torch.launches import adjoint, evaluate
from warp_neural.torch.shape import Shape


class Evaluate(torch.autograd.Function):
    """(x float32 [n, n_in], params, shape, loss_scale) -> float32 [n, n_out].

    loss_scale: what gradients are multiplied by on their way through a float16 network, and divided by after it.
    """

    @staticmethod
    def forward(ctx, x: torch.Tensor, params: torch.Tensor, shape: Shape, loss_scale: float) -> torch.Tensor:
        y, packed = evaluate(shape, x, params)
        ctx.save_for_backward(x, params, packed)
        ctx.shape, ctx.loss_scale = shape, loss_scale
        return y

    @staticmethod
    def backward(ctx, dy: torch.Tensor):
        needs = ctx.needs_input_grad[:2]
        dx, dparams = Adjoint.apply(dy, *ctx.saved_tensors, ctx.shape, ctx.loss_scale, needs)
        return dx, dparams, None, None


class Adjoint(torch.autograd.Function):
    """The gradients, which cannot be differentiated once more: that is an error, not a wrong number."""

    @staticmethod
    def forward(ctx, dy, x, params, packed, shape: Shape, loss_scale: float, needs: tuple[bool, bool]):
        dx, dparams = adjoint(shape, x, params, packed, dy * loss_scale if loss_scale != 1 else dy, needs)
        if loss_scale != 1:
            for gradient in (dx, dparams):
                if gradient is not None:
                    gradient /= loss_scale
        if dparams is not None:
            for place in shape.resting:
                dparams[place].zero_()
        return dx, dparams

    @staticmethod
    def backward(ctx, *_):
        raise NotImplementedError(
            "warp_neural.torch has no second derivatives: leave create_graph out, or take the gradient by finite "
            "differences of the outputs"
        )
