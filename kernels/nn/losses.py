"""Losses: how far a prediction is from its target, and the derivative, as C expressions that all paths compile.

The loss of one sample is the mean over the components of weight * term; of `cross_entropy`, the sum.
"""

from dataclasses import dataclass, replace
from functools import cache

import warp as wp

from warp_neural.kernels.errors import InputError, is_finite, require, require_whole


@dataclass(frozen=True)
class Loss:
    """A loss of prediction and target vectors.

    term: C++ expression of one component's loss, of the floats `p` (prediction) and `t` (target). slope: its derivative
    in `p`. weights: one a component; () is all one. The target counts as constant: it gets no gradient.

    A loss of your own: `Loss("cubic", "wp::abs(p - t) * (p - t) * (p - t)", "3.0f * (p - t) * wp::abs(p - t)")`.
    """

    name: str
    term: str
    slope: str
    weights: tuple[float, ...] = ()

    def weighted(self, *weights: float) -> "Loss":
        """The same loss with component weights, finite and not negative."""
        valid = all(is_finite(w) and w >= 0 for w in weights)
        require(valid, f"{self.name}: weights", weights, "finite numbers, not negative, one a component")
        return replace(self, weights=tuple(float(w) for w in weights))

    def value(self, n: int) -> wp.Function:
        """`(prediction: vec of n float32, target) -> wp.float32`, differentiable in the prediction."""
        return make_value(self, n)

    def gradient(self, n: int) -> wp.Function:
        """`(prediction: vec of n float32, target) -> vec`: the derivative of `value` in the prediction."""
        return make_gradient(self, n)

    def value_text(self, n: int) -> str:
        """C++ that sets `loss` from the vectors `prediction` and `target`, with the weights `w`."""
        return f"{for_each(n, f'loss += w[i] * ({self.term});')}loss *= {1 / n!r}f;\n"

    def gradient_text(self, n: int) -> str:
        """C++ that sets `d[i]`."""
        return for_each(n, f"d[i] = w[i] * {1 / n!r}f * ({self.slope});")


@dataclass(frozen=True)
class CrossEntropy(Loss):
    """Of the vector as a whole: see `cross_entropy`."""

    def value_text(self, n: int) -> str:
        if n == 1:
            return for_each(1, "loss = w[i] * (wp::max(p, 0.0f) - t * p + wp::log(1.0f + wp::exp(-wp::abs(p))));")
        return self.exponentials(n) + for_each(n, "loss += w[i] * t * (largest + wp::log(total) - p);")

    def gradient_text(self, n: int) -> str:
        if n == 1:
            return for_each(1, "d[i] = w[i] * (1.0f / (1.0f + wp::exp(-p)) - t);")
        weight = for_each(n, "weight += w[i] * t;")
        return f"{self.exponentials(n)}real weight = 0.0f;\n{weight}" + for_each(
            n, "d[i] = weight * wp::exp(p - largest) / total - w[i] * t;"
        )

    def exponentials(self, n: int) -> str:
        """The largest logit, and the sum of the exponentials of all relative to it, which cannot overflow."""
        return f"""real largest = prediction.c[0], total = 0.0f;
{for_each(n, "largest = wp::max(largest, p);")}{for_each(n, "total += wp::exp(p - largest);")}"""


def for_each(n: int, statement: str) -> str:
    return f"""for (int i = 0; i < {n}; ++i) {{
    const real p = prediction.c[i], t = target.c[i];
    {statement}
}}
"""


def prelude(loss: Loss, n: int) -> str:
    require_whole(f"{loss.name}: n", n)
    weights = loss.weights or (1.0,) * n
    if len(weights) != n:
        raise InputError(f"{loss.name}: {len(weights)} weights for {n} components; give one weight a component")
    return f"using real = wp::float32;\nconst real w[{n}] = {{{', '.join(f'{v!r}f' for v in weights)}}};\n"


@cache
def make_value(loss: Loss, n: int) -> wp.Function:
    """`Loss.value`."""
    vec = wp.types.vector(n, float)
    gradient = f"{prelude(loss, n)}real d[{n}];\n{loss.gradient_text(n)}"

    @wp.func_native(
        f"{prelude(loss, n)}real loss = 0.0f;\n{loss.value_text(n)}return loss;\n",
        adj_snippet=f"{gradient}for (int i = 0; i < {n}; ++i) adj_prediction.c[i] += adj_ret * d[i];\n",
    )
    def value(prediction: vec, target: vec) -> wp.float32: ...

    return value


@cache
def make_gradient(loss: Loss, n: int) -> wp.Function:
    """`Loss.gradient`."""
    vec = wp.types.vector(n, float)

    @wp.func_native(
        f"{prelude(loss, n)}wp::vec_t<{n}, real> y;\nreal* const d = y.c;\n{loss.gradient_text(n)}return y;\n"
    )
    def gradient(prediction: vec, target: vec) -> vec: ...

    return gradient


# The sign of p - t, NaN where either is not finite, so that bad samples show in the gradient; 0 where they are equal
SIGN = "(p == t ? 0.0f : (p - t) / wp::abs(p - t))"

l1 = Loss("l1", "wp::abs(p - t)", SIGN)
"""|p - t|. Its derivative where they are equal is 0, as in the other losses of |p - t|; tiny-cuda-nn's is -1 there."""

l2 = Loss("l2", "(p - t) * (p - t)", "2.0f * (p - t)")

# Of these the denominators count as constant in the derivative (tiny-cuda-nn's losses of the same names; Lehtinen et
# al. 2018, "Noise2Noise", for the relative L2: so the mean of noisy targets is learned). mape is exact.
relative_l1 = Loss("relative_l1", "wp::abs(p - t) / (wp::abs(p) + 0.01f)", f"{SIGN} / (wp::abs(p) + 0.01f)")
relative_l2 = Loss("relative_l2", "(p - t) * (p - t) / (p * p + 0.01f)", "2.0f * (p - t) / (p * p + 0.01f)")
mape = Loss("mape", "wp::abs(p - t) / (wp::abs(t) + 0.01f)", f"{SIGN} / (wp::abs(t) + 0.01f)")
HALF_SUM = "(0.5f * (wp::abs(p) + wp::abs(t)) + 0.01f)"
smape = Loss("smape", f"wp::abs(p - t) / {HALF_SUM}", f"{SIGN} / {HALF_SUM}")

cross_entropy = CrossEntropy("cross_entropy", "", "")
"""-sum of weight * t * log softmax(p): predictions are logits, targets probabilities. One component: p is the logit of
the probability t, and the loss that of the two outcomes, -t log sigmoid(p) - (1 - t) log(1 - sigmoid(p)).

tiny-cuda-nn's loss of this name takes probabilities where this one takes logits, -t log p, without a softmax, and
divides by the number of components, where this is the sum over them."""

ROOT = "(p <= 0.0f ? 0.0f : wp::pow(p, 0.45454545f))"
TARGET_ROOT = "(t <= 0.0f ? 0.0f : wp::pow(t, 0.45454545f))"
gamma_l2 = Loss(
    "gamma_l2",
    f"({ROOT} - {TARGET_ROOT}) * ({ROOT} - {TARGET_ROOT})",
    f"(p <= 0.0f ? 0.0f : 0.9090909f * ({ROOT} - {TARGET_ROOT}) * wp::pow(p, -0.54545455f))",
)
"""Squared error after gamma 1/2.2, the course's: of linear colours as a display shows them. Values below 0 count as 0;
a prediction there has derivative 0, so it stays dead unless the network's output is always positive."""


def huber(delta: float = 1.0) -> Loss:
    """Half the square of the error up to `delta`, then delta * (|error| - delta / 2) (Huber 1964)."""
    require(is_finite(delta) and delta > 0, "huber: delta", delta, "a positive number")
    near, d = f"wp::abs(p - t) <= {float(delta)!r}f", f"{float(delta)!r}f"
    return Loss(
        f"huber({delta})",
        f"({near} ? 0.5f * (p - t) * (p - t) : {d} * (wp::abs(p - t) - 0.5f * {d}))",
        f"({near} ? p - t : {d} * {SIGN})",
    )


ALL = (l1, l2, relative_l1, relative_l2, mape, smape, huber(), cross_entropy, gamma_l2)
