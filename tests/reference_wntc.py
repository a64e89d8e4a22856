"""A reader of `.wntc` files in plain Python, after docs/wntc.md alone; slow, and trusts the file but for checksums."""

import json
import zlib
from decimal import Decimal, getcontext
from functools import cache
from itertools import pairwise, product
from math import ceil, floor, prod

import numpy as np

NEAR = ((0, -1), (-1, 0), (-1, -1), (-1, 1), (0, -2), (-2, 0))


class Bytes:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, n):
        self.at += n
        assert self.at <= len(self.data)
        return self.data[self.at - n : self.at]

    def number(self):
        result, shift = 0, 0
        while True:
            (byte,) = self.take(1)
            result, shift = result + (byte % 128 << shift), shift + 7
            if byte < 128:
                return result

    def section(self, start):
        content = self.take(self.number())
        checked = self.data[start : self.at]
        assert zlib.crc32(checked) == int.from_bytes(self.take(4), "little")
        return Bytes(content)


class Stream:
    def __init__(self, data):
        self.bytes = Bytes(data)
        self.x = int.from_bytes(self.bytes.take(4), "big")

    def symbol(self, frequencies):
        """None for 'none of these'."""
        slot, start = self.x % 65536, 0
        every, place = [*frequencies, 65536 - sum(frequencies)], 0
        while slot >= start + every[place]:
            start, place = start + every[place], place + 1
        frequency = every[place]
        self.x = frequency * (self.x >> 16) + slot - start
        self.refill()
        if place == len(frequencies):
            return None
        return (place + 1) // 2 * (1 if place % 2 else -1)

    def bits(self, b):
        slot = self.x % 65536
        self.x = (self.x >> 16) * 2 ** (16 - b) + slot % 2 ** (16 - b)
        self.refill()
        return slot >> (16 - b)

    def refill(self):
        while self.x < 2**23:
            self.x = self.x * 256 + self.bytes.take(1)[0]

    def end(self):
        assert self.x == 2**23 and self.bytes.at == len(self.bytes.data)


def scale(k):
    return Decimal(2 ** (k // 8) * (17 + 2 * (k % 8))) / 1024


def symbols(k):
    reach = floor(6 * scale(k)) + 2
    return [0] + [sign * s for s in range(1, reach + 1) for sign in (1, -1)]


def exponential(x):
    getcontext().prec = 60
    return round(x.exp() * 2**32)


def frequencies(masses, whole):
    return [1 + mass * (65520 - len(masses)) // whole for mass in masses]


@cache
def tails(k):
    one, result = exponential(-1 / (8 * scale(k))), [2**32]
    for _ in range(8 * len(symbols(k)) // 2 + 8):
        result.append(result[-1] * one >> 32)
    return result


@cache
def laplace(k, phase):
    t, masses = tails(k), []
    for s in symbols(k):
        low, high = 8 * s - 4 - phase, 8 * s + 4 - phase
        if low >= 0:
            masses.append((t[low] - t[high]) >> 1)
        elif high <= 0:
            masses.append((t[-high] - t[-low]) >> 1)
        else:
            masses.append(2**32 - ((t[-low] + t[high]) >> 1))
    return frequencies(masses, 2**32)


@cache
def number_table(which):
    if which < 96:
        return laplace(which, 0)
    if which > 191:
        return frequencies([64 - (which - 191), which - 191], 64)
    masses = [exponential(-(s**2) / (2 * scale(which - 96) ** 2)) for s in symbols(which - 96)]
    return frequencies(masses, sum(masses))


def read_numbers(data, shapes):
    heads = []
    for _ in shapes:
        (table,), z = data.take(1), data.number()
        heads.append((table, -(z + 1) // 2 if z % 2 else z // 2))
    rest = data.take(len(data.data) - data.at)
    stream, arrays = Stream(rest) if rest else None, []
    for shape, (table, middle) in zip(shapes, heads, strict=True):
        values = []
        for _ in range(prod(shape)):
            symbol = 0 if table == 255 else stream.symbol(number_table(table))
            values.append(middle + (stream.bits(16) - 32768 if symbol is None else symbol))
        arrays.append(np.array(values, int).reshape(shape))
    if stream:
        stream.end()
    return arrays


def weight(level):
    size = abs(level)
    size = size if size < 4 else (4 + size % 4) << (size // 4 - 1)
    return -size if level < 0 else size


def read_contexts(data, grids):
    """(channels in the streams, the seven arrays of weights) of each grid."""
    used = []
    for _, channels, _, _ in grids:
        bits = int.from_bytes(data.take(ceil(channels / 8)), "little")
        used.append([c for c in range(channels) if bits >> c & 1])
    shapes = []
    for g, each in enumerate(used):
        n, p = len(each), len(used[g + 1]) if g + 1 < len(used) else 0
        shapes += [(n,), (n,), (6, n), (6, n), (n * (n - 1) // 2,), (n * (n - 1) // 2,), (p, n)]
    which = read_numbers(Bytes(data.take(data.number())), shapes)
    levels = read_numbers(data, [(int(each.sum()),) for each in which])
    arrays = []
    for mask, each in zip(which, levels, strict=True):
        whole = np.zeros(mask.shape, int)
        whole[mask == 1] = [weight(int(level)) for level in each]
        arrays.append(whole)
    return [(each, arrays[7 * g : 7 * g + 7]) for g, each in enumerate(used)]


def decode_block(stream, q, place, side, context, parents, ratio):
    """Into q [rows, columns, n], from its first row and column."""
    scale_0, mean_0, scale_near, mean_near, scale_of, mean_of, scale_parent = context
    rows, columns, n = q.shape
    pair = {pair: i for i, pair in enumerate((d, c) for d in range(n) for c in range(d + 1, n))}
    ends = min(place[0] + side, rows), min(place[1] + side, columns)
    for y, x, c in product(range(place[0], ends[0]), range(place[1], ends[1]), range(n)):
        s, m = int(scale_0[c]), int(mean_0[c])
        for k, (dy, dx) in enumerate(NEAR):
            if place[0] <= y + dy < ends[0] and place[1] <= x + dx < ends[1]:
                s += int(scale_near[k, c]) * abs(int(q[y + dy, x + dx, c]))
                m += int(mean_near[k, c]) * int(q[y + dy, x + dx, c])
        for d in range(c):
            s += int(scale_of[pair[d, c]]) * abs(int(q[y, x, d]))
            m += int(mean_of[pair[d, c]]) * int(q[y, x, d])
        for p in range(len(scale_parent)):
            above = [(y // ratio + i, x // ratio + j) for i in (0, 1) for j in (0, 1)]
            size = sum(abs(int(parents[i % parents.shape[0], j % parents.shape[1], p])) for i, j in above)
            s += int(scale_parent[p, c]) * size
        s = min(max(s, 64), 2**18 - 1)
        octave = s.bit_length() - 1
        eighths = (min(max(m, -127 * 4096), 127 * 4096) + 256) >> 9
        centre = (eighths + 4) >> 3
        phase = eighths - 8 * centre
        symbol = stream.symbol(laplace(8 * (octave - 6) + (s >> (octave - 3)) % 8, abs(phase)))
        if symbol is None:
            q[y, x, c] = stream.bits(8) - 128
        else:
            q[y, x, c] = centre - symbol if phase < 0 else centre + symbol


def tensor_shapes(channels, mips, grids, hidden):
    shapes = []
    for scale, n, kernel, _ in grids:
        shapes += [[(n, scale, scale, 4)], [(n, scale, 2)] * 2, []][kernel]
    sizes = [sum(grid[1] for grid in grids) + (mips > 1), *hidden, channels]
    for n_in, n_out in pairwise(sizes):
        shapes += [(n_out, n_in), (n_out,)]
    return shapes


def read(content):
    """A dict: latents by (mip, grid), integers and steps of the tensors in order, maps, extra."""
    data = Bytes(content)
    assert data.take(5) == b"WNTC\x01"
    head = data.section(0)
    height, width = (int.from_bytes(head.take(2), "little") for _ in range(2))
    channels, mips, block, count = head.take(4)
    grids = [(2**scale, n, kernel, bits) for scale, n, kernel, bits in (head.take(4) for _ in range(count))]
    hidden = [width + 1 for width in head.take(head.take(1)[0])]
    maps, extra = json.loads(zlib.decompress(head.take(len(head.data) - head.at)))
    network = data.section(data.at)
    shapes = tensor_shapes(channels, mips, grids, hidden)
    steps = np.frombuffer(network.take(2 * len(shapes)), "<f2")
    tensors = read_numbers(network, shapes)
    contexts, index, latents = read_contexts(data.section(data.at), grids), data.section(data.at), {}
    coarsest = grids[-1][0]
    for mip, g in product(range(mips), reversed(range(count))):
        size, (used, context) = grids[g][0], contexts[g]
        rows, columns = (ceil(max(side >> mip, 1) / coarsest) * coarsest // size for side in (height, width))
        q, side = np.zeros((rows, columns, len(used)), int), 2**block // size
        parents = latents["coded", mip, g + 1] if g + 1 < count else np.zeros((rows, columns, 0), int)
        ratio = grids[g + 1][0] // size if g + 1 < count else 1
        for place in product(range(0, rows, side), range(0, columns, side)):
            n = index.number()
            if n:
                crc, content = int.from_bytes(index.take(4), "little"), data.take(n)
                assert zlib.crc32(content) == crc
                stream = Stream(content)
                decode_block(stream, q, place, side, context, parents, ratio)
                stream.end()
        whole = np.zeros((rows, columns, grids[g][1]), int)
        whole[..., used] = q
        latents["coded", mip, g], latents[mip, g] = q, 2 * whole - 1 if grids[g][3] == 1 else whole
    assert index.at == len(index.data) and data.at == len(data.data)
    return {"latents": latents, "tensors": tensors, "steps": steps, "maps": maps, "extra": extra}
