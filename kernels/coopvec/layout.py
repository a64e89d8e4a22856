"""Where each parameter lies in a packed buffer, and the kernel that packs float32 parameters into it.

CUDA, tensor-core formats ("inferencing optimal"): the B operands of `fragment_layout`. CUDA float32: row major, rows
padded to 16 bytes. CPU: float32 values already rounded to the format, [n_in, n_out] with rows padded to 16 elements, so
that the inner loop runs over neurons.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from warp_neural.kernels.coopvec.convert import make_element_place
from warp_neural.kernels.coopvec.formats import make_decode, make_encode
from warp_neural.kernels.coopvec.fragment_layout import Layout, Text, biases, half_biases, operands
from warp_neural.kernels.nn.activations import relu
from warp_neural.kernels.nn.spec import FLOAT16, INT8, Format, NetworkSpec, round_up


@dataclass(frozen=True)
class LayerLayout:
    """One layer in the packed buffer; offsets in 32-bit words from the network's start (`master` in floats).

    k, n: inputs and outputs; k_pad, n_pad: as stored. scales (INT8): 1 / input step, input step * weight step,
    1 / the next layer's largest input (127 steps), and the product of the last two, `fraction`, to 22 bits.
    """

    k: int
    n: int
    k_pad: int
    n_pad: int
    weights: int
    bias: int
    scales: int
    master: int

    @property
    def fractions(self) -> int:
        """INT8: a second row of biases, in fractions of the next layer's largest input, for ReLU's short cut.

        Sums of products stand as MAGIC + sum in accumulators. MAGIC * fraction is exact, so that one multiply-add gives
        fraction * sum + bias, the bias to about one step of the products.
        """
        return (self.bias + self.scales) // 2

    def k_blocks(self, format: Format) -> int:
        return self.k_pad // format.k_step

    def k_pairs(self, format: Format) -> int:
        return (self.k_blocks(format) + 1) // 2

    def operands(self, format: Format) -> Layout:
        """Of the weights, for tensor cores."""
        return operands(format, self.n_pad, self.k_pad)


def bias_is_half(spec: NetworkSpec, cuda: bool) -> bool:
    """Float16 accumulators start from a float16 bias; every other bias is float32."""
    return cuda and spec.accumulation == "float16" and spec.format.k_step > 0


def bias_layout(spec: NetworkSpec, n: int) -> Layout:
    """Of `n` biases, for tensor cores."""
    return half_biases(n) if bias_is_half(spec, cuda=True) else biases(n)


def bias_joins_relu(spec: NetworkSpec, is_last: bool) -> bool:
    """Float16 sums of hidden ReLU layers start from zero: adding the bias at the end is one instruction with ReLU.

    To start from the bias, every product has it copied into new registers.
    """
    return not is_last and (spec.format, spec.accumulation, spec.activation) == (FLOAT16, "float16", relu)


@cache
def network_layout(spec: NetworkSpec, cuda: bool) -> tuple[tuple[LayerLayout, ...], int]:
    """The layers of one network and its size in words; each layer starts at a multiple of 16 bytes (CPU: 64)."""
    layers, word, master, format = [], 0, 0, spec.format
    for index, (k, n) in enumerate(spec.layers):
        last = index == len(spec.layers) - 1
        if not cuda:
            k_pad, n_pad = k, round_up(n, 16)
            n_words = k_pad * n_pad
        elif format.k_step == 0:
            k_pad, n_pad = round_up(k, 4), round_up(n, 4)
            n_words = n_pad * k_pad
        else:
            k_pad, n_pad = round_up(k, format.k_step), round_up(n, 8 if last else max(8, format.k_step))
            n_words = operands(format, n_pad, k_pad).elements // format.per_word
        bias = word + n_words
        if not cuda or format.k_step == 0:
            bias_words = n_pad
        else:
            bias_words = bias_layout(spec, n_pad).elements // (2 if bias_is_half(spec, cuda) else 1)
        scales = bias + bias_words * (2 if format is INT8 else 1)
        layers.append(LayerLayout(k, n, k_pad, n_pad, word, bias, scales, master))
        word = scales + (4 if cuda else 16)
        master += n * k + n
    return tuple(layers), word


MAGIC = 12582912.0  # 1.5 * 2^23, bits 0x4b400000: whole numbers below 2^22 added to it stand in its low bits
LAYER_COLUMNS = 8  # of the table that the kernels below take: k, n, k_pad, n_pad, weights, bias, scales, master


def layer_table(spec: NetworkSpec, cuda: bool) -> list[list[int]]:
    """`network_layout` as rows of plain integers, [layers, LAYER_COLUMNS]."""
    layers, _ = network_layout(spec, cuda)
    return [[l.k, l.n, l.k_pad, l.n_pad, l.weights, l.bias, l.scales, l.master] for l in layers]


@wp.func_native(f"return {biases(0).place(Text('i'))[0]};")
def bias_place(i: int) -> int: ...


@wp.func_native(f"return {half_biases(0).place(Text('i'))[0]};")
def half_bias_place(i: int) -> int: ...


@cache
def make_pack_kernel(format: Format, cuda: bool, half_bias: bool):
    """The kernel that packs master parameters, launched with dim (networks, words of one network).

    Arguments: layers [L, LAYER_COLUMNS]; steps [networks, L, 2], the (input, weight) quantization steps of INT8 (unused
    otherwise); master [networks * n_parameters] row major; n_parameters; packed [networks * words].
    """
    encode, decode = make_encode(format), make_decode(format)
    fragments = cuda and format.k_step > 0
    if fragments:
        place = make_element_place("inferencing_optimal", format)
    half_encode = make_encode(FLOAT16)
    is_int8 = wp.constant(format is INT8)
    bits = wp.constant(format.bits)

    @wp.func
    def weight(master: wp.array[float], base: int, n: int, k: int, n_out: int, n_in: int, step: float) -> wp.uint32:
        if n >= n_out or k >= n_in:
            return wp.uint32(0)
        return encode(master[base + n * n_in + k] / step)

    @wp.func
    def bias(master: wp.array[float], base: int, n: int, n_out: int, n_in: int) -> float:
        if n >= n_out:
            return 0.0
        return master[base + n_out * n_in + n]

    @wp.func
    def largest_inverse(steps: wp.array3d[float], network: int, layer: int) -> float:
        if layer + 1 == steps.shape[1]:
            return 0.0
        return 1.0 / (127.0 * steps[network, layer + 1, 0])

    @wp.func
    def fraction(steps: wp.array3d[float], network: int, layer: int) -> float:
        exact = steps[network, layer, 0] * steps[network, layer, 1] * largest_inverse(steps, network, layer)
        return wp.cast(wp.cast(exact, wp.uint32) & ~wp.uint32(3), float)

    @wp.kernel(module="unique", enable_backward=False)
    def pack_kernel(
        layers: wp.array2d[int],
        steps: wp.array3d[float],
        master: wp.array[float],
        n_parameters: int,
        packed: wp.array[wp.uint32],
        words: int,
    ):
        network, word = wp.tid()
        layer = layers.shape[0] - 1
        while layers[layer, 4] > word:
            layer -= 1
        n_in = layers[layer, 0]
        n_out = layers[layer, 1]
        k_pad = layers[layer, 2]
        n_pad = layers[layer, 3]
        base = network * n_parameters + layers[layer, 7]
        step = float(1.0)
        if wp.static(is_int8):
            step = steps[network, layer, 1]
        result = wp.uint32(0)
        if word < layers[layer, 5]:
            local = word - layers[layer, 4]
            if wp.static(fragments):
                for element in range(wp.static(format.per_word)):
                    at = place(wp.static(format.per_word) * local + element, n_pad, k_pad, 0)
                    code = weight(master, base, at[0], at[1], n_out, n_in, step)
                    result = result | (code << wp.uint32(element * bits))
            elif wp.static(cuda):
                result = weight(master, base, local / k_pad, local % k_pad, n_out, n_in, step)
            else:
                code = weight(master, base, local % n_pad, local / n_pad, n_out, n_in, step)
                result = wp.cast(decode(code), wp.uint32)
        elif word < layers[layer, 6]:
            local = word - layers[layer, 5]
            biases = layers[layer, 6] - layers[layer, 5]
            if wp.static(is_int8) and local >= biases / 2:
                local -= biases / 2
                n = local
                if wp.static(fragments):
                    n = bias_place(local)
                z = bias(master, base, n, n_out, n_in) * largest_inverse(steps, network, layer)
                result = wp.cast(z - wp.static(MAGIC) * fraction(steps, network, layer), wp.uint32)
            elif wp.static(half_bias):
                n = half_bias_place(2 * local)
                low = half_encode(bias(master, base, n, n_out, n_in))
                result = low | (half_encode(bias(master, base, n + 1, n_out, n_in)) << wp.uint32(16))
            elif wp.static(fragments):
                result = wp.cast(bias(master, base, bias_place(local), n_out, n_in), wp.uint32)
            else:
                result = wp.cast(bias(master, base, local, n_out, n_in), wp.uint32)
        elif wp.static(is_int8):
            if word == layers[layer, 6]:
                result = wp.cast(1.0 / steps[network, layer, 0], wp.uint32)
            elif word == layers[layer, 6] + 1:
                result = wp.cast(steps[network, layer, 0] * step, wp.uint32)
            elif word == layers[layer, 6] + 2:
                result = wp.cast(largest_inverse(steps, network, layer), wp.uint32)
            elif word == layers[layer, 6] + 3:
                result = wp.cast(fraction(steps, network, layer), wp.uint32)
        packed[network * words + word] = result

    return pack_kernel
