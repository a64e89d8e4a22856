"""Backpropagation: the package's own adjoints behind `torch.autograd`; second derivatives by PyTorch's operations."""

import torch

from warp_neural.torch.launches import adjoint, evaluate
from warp_neural.torch.shape import Shape
from warp_neural.torch.twice import evaluate_twice


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
    """The gradients, which can be differentiated again: see `twice`."""

    @staticmethod
    def forward(ctx, dy, x, params, packed, shape: Shape, loss_scale: float, needs: tuple[bool, bool]):
        dx, dparams = adjoint(shape, x, params, packed, dy * loss_scale if loss_scale != 1 else dy, needs)
        if loss_scale != 1:
            for gradient in (dx, dparams):
                if gradient is not None:
                    gradient /= loss_scale
        if dparams is not None:
            for place in shape.resting:
                dparams[place] = 0
        ctx.save_for_backward(dy, x, params)
        ctx.shape, ctx.needs = shape, needs
        return dx, dparams

    @staticmethod
    def backward(ctx, *weights: torch.Tensor | None):
        """Of the sums of gradients times `weights`; can itself be differentiated."""
        again, shape = torch.is_grad_enabled(), ctx.shape
        given = [weights[i] for i in range(2) if ctx.needs[i]]
        with torch.enable_grad():
            # new tensors: of their own graph, what the saved ones come from counts elsewhere
            dy, x, params = (tensor.view_as(tensor) if again else tensor.detach() for tensor in ctx.saved_tensors)
            params = torch.where(resting(shape, params), params.detach(), params)
            dy, x, params = (t if t.requires_grad else t.detach().requires_grad_() for t in (dy, x, params))
            y = evaluate_twice(shape, x, params)
            inputs = [tensor for tensor, needed in zip((x, params), ctx.needs, strict=True) if needed]
            first = torch.autograd.grad(y, inputs, dy, create_graph=True, materialize_grads=True)
            if ctx.needs[1]:
                given[-1] = given[-1].masked_fill(resting(shape, params), 0)
            total = sum((gradient * weight).sum() for gradient, weight in zip(first, given, strict=True))
            *results, dparams = torch.autograd.grad(total, (dy, x, params), create_graph=again, materialize_grads=True)
        return *results, dparams.masked_fill(resting(shape, params), 0), None, None, None, None


def resting(shape: Shape, params: torch.Tensor) -> torch.Tensor:
    """[n_parameters], which are not trained."""
    mask = torch.zeros(params.shape, dtype=torch.bool, device=params.device)
    for place in shape.resting:
        mask[place] = True
    return mask
