"""Each input as a blob over bins: a soft one-hot code."""

from dataclasses import dataclass

from warp_neural.kernels.nn.encodings.base import Encoding, require_sizes

# The kernel 15/16 (1 - u^2)^2 on [-1, 1], of radius one bin, and its integral; tiny-cuda-nn takes it for a Gaussian
QUARTIC = """
auto density = [](real u) { const real s = wp::max(1.0f - u * u, 0.0f); return 0.9375f * s * s; };
auto integral = [](real u) {
    u = wp::min(wp::max(u, -1.0f), 1.0f);
    return 0.5f + u * (0.9375f + u * u * (-0.625f + 0.1875f * u * u));
};
"""


@dataclass(frozen=True)
class OneBlob(Encoding):
    """The share of a bump around x that falls in each of `bins` equal bins of [0, 1] (Mueller et al. 2019).

    The kernel is cyclic, as tiny-cuda-nn's: what leaves at one end enters at the other, so that shares of x in [0, 1]
    always sum to 1, and x = 0 and x = 1 encode alike. Farther than one bin outside, the results are 0. Results go by
    input, then by bin.
    """

    bins: int = 16

    def __post_init__(self):
        require_sizes(self, "bins")

    def n_out(self, n_in: int) -> int:
        return self.bins * n_in

    def encode_text(self, n_in: int, aligned: int) -> str:
        return self.for_each_bin(n_in, "integral", f"out[i * {self.bins} + k] = above - below;")

    def adjoint_text(self, n_in: int, aligned: int) -> str:
        slope = f"{self.bins}.0f * (below - above)"
        return self.for_each_bin(n_in, "density", f"d_in[i] += d_out[i * {self.bins} + k] * {slope};")

    def for_each_bin(self, n_in: int, kernel: str, use: str) -> str:
        """`use` for bin k of input i, of the `kernel` at its edges, `below` and `above`; also one turn away."""
        bins = f"{self.bins}.0f"
        return f"""{QUARTIC}
auto cyclic = [&](real u) {{ return {kernel}(u) + {kernel}(u - {bins}) + {kernel}(u + {bins}); }};
#pragma unroll
for (int i = 0; i < {n_in}; ++i) {{
    real below = cyclic(-{bins} * in[i]);
    #pragma unroll
    for (int k = 0; k < {self.bins}; ++k) {{
        const real above = cyclic(static_cast<real>(k + 1) - {bins} * in[i]);
        {use}
        below = above;
    }}
}}
"""
