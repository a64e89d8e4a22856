"""Matrices, biases and vectors in memory as the cooperative-vector operations take them, made by NumPy."""

import numpy as np
import warp as wp

from warp_neural.kernels.coopvec.formats import make_encode
from warp_neural.kernels.coopvec.operations import Buffer
from warp_neural.kernels.nn.spec import FLOAT32, TF32

N, ROOM = 77, 4096  # threads (no multiple of 32), elements set aside for a matrix


def positions(layout, format, rows, columns):
    """[rows, columns] element positions in a buffer, by walking the buffer in the order that the lanes load it."""
    place = np.full((rows + 64, columns + 64), -1)
    if layout == "row_major" or (layout == "inferencing_optimal" and format is FLOAT32):
        pitch = columns if layout == "row_major" else -(-columns // 4) * 4
        return np.arange(rows)[:, None] * pitch + np.arange(columns)
    if layout == "column_major":
        return np.arange(columns)[None, :] * rows + np.arange(rows)[:, None]
    at = 0
    if layout == "training_optimal":
        for tile_n in range(0, rows, 16):
            for tile_k in range(0, columns, 8):
                for lane in range(32):
                    for half in (0, 8):
                        for odd in (0, 1):
                            place[tile_n + half + lane // 4, tile_k + lane % 4 * 2 + odd] = at
                            at += 1
        return place[:rows, :columns]
    blocks = -(-columns // format.k_step)
    columns_of = {16: (0, 1), 8: (0, 1, 8, 9), 32: (0,)}[format.bits]
    for tile_n in range(0, rows, 8):
        for pair in range(0, blocks, 2):
            for lane in range(32):
                for block in (pair, pair + 1):
                    for register in (0, 1):
                        first = block * format.k_step + lane % 4 * 2
                        first += register if format is TF32 else register * format.k_step // 2
                        for offset in columns_of:
                            if first + offset < place.shape[1]:
                                place[tile_n + lane // 4, first + offset] = at
                            at += 1
    return place[:rows, :columns]


def encoded(format, values):
    """Bits of each value, as unsigned integers of the format's width."""
    encode = make_encode(format)

    @wp.kernel(module="unique", enable_backward=False)
    def encode_kernel(x: wp.array[float], y: wp.array[wp.uint32]):
        i = wp.tid()
        y[i] = encode(x[i])

    bits = wp.zeros(values.size, dtype=wp.uint32, device="cpu")
    x = wp.array(values.astype(np.float32).ravel(), dtype=float, device="cpu")
    wp.launch(encode_kernel, values.size, inputs=[x], outputs=[bits], device="cpu")
    return bits.numpy().astype({8: np.uint8, 16: np.uint16, 32: np.uint32}[format.bits]).reshape(values.shape)


def matrix_buffer(matrices, layout, format, device):
    """A Buffer of several matrices, ROOM elements apart, with room for gradients."""
    data = np.zeros((len(matrices), ROOM), encoded(format, np.zeros(1)).dtype)
    for matrix, row in zip(matrices, data, strict=True):
        row[positions(layout, format, *matrix.shape)] = encoded(format, matrix)
    buffer = Buffer()
    buffer.data = wp.array(data.view(np.uint32).ravel(), dtype=wp.uint32, device=device)
    buffer.gradient = wp.zeros(data.size, dtype=float, device=device)
    return buffer


def bias_buffer(biases, device, kind="float32"):
    words = np.pad(biases.astype(kind).ravel(), (0, biases.size % 2)).view(np.uint32)
    buffer = Buffer()
    buffer.data = wp.array(words, dtype=wp.uint32, device=device)
    buffer.gradient = wp.zeros(biases.size, dtype=float, device=device)
    return buffer


def small_integers(rng, *shape):
    return rng.integers(-3, 4, shape).astype(np.float64)


def choose(divergence):
    """(matrix of each thread, which threads take part): all alike, three matrices interleaved, a quarter returned."""
    threads = np.arange(N)
    return threads * 7 % 3 if divergence == 1 else threads * 0, threads % 4 != 0 if divergence == 2 else threads >= 0


def vectors(spec, values, device):
    """Vectors [n, columns] as the product of `spec` takes them; what packed ones have past the end is no number."""
    if spec.dtype is wp.uint32:
        codes = np.pad(encoded(spec.format, values), ((0, 0), (0, -values.shape[1] % 4)), constant_values=0xFF)
        return wp.array(codes.view(np.uint32), dtype=spec.vec_in, device=device)
    values = values.astype(wp.dtype_to_numpy(spec.dtype))
    return wp.array(values, dtype=spec.vec_in, device=device, requires_grad=spec.dtype is not wp.int8)
