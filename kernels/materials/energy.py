"""Directional albedo of GGX facets from small tables, and the share that Schlick's term has of it.

For mirrors E(v) is the integral of `reflection`'s first part over lights; its second part integrates to q E, q between
0 and 1. So facets of any reflectance f0 reflect (f0 (1 - q) + q) E: one table of E and one of q serve metals,
dielectrics and coats.

E falls where v_z is about alpha, whatever alpha is: its axis is v_z (1 + a) / (v_z + a). q's is sqrt(v_z), those of
alpha are its fourth root. Anisotropic facets are described in the view's own plane: alpha along it (a), across it (b),
and the correlation of both slopes as alpha_x alpha_y / (a b), 1 for none; so four axes are exact, and all tables
smooth. Between their nodes E is within 0.9 % of the integral.
"""

import warp as wp

from warp_neural.kernels.materials.ggx import MIN_ALPHA, sample_reflection, stretched
from warp_neural.kernels.shading.brdf import schlick

LEAST_COSINE = wp.constant(1.0e-4)  # of tables; the grazing views below it share its value


@wp.struct
class EnergyTables:
    """round_*: [cosine, alpha]; long_*: [cosine, a, b, correlation], of one entry where no facet is anisotropic."""

    round_energy: wp.array2d[float]
    round_share: wp.array2d[float]
    long_energy: wp.array4d[float]
    long_share: wp.array4d[float]


@wp.func
def alpha_axis(alpha: float) -> float:
    """[MIN_ALPHA, 1] to [0, 1]."""
    least = wp.sqrt(wp.sqrt(MIN_ALPHA))
    return (wp.sqrt(wp.sqrt(alpha)) - least) / (1.0 - least)


@wp.func
def alpha_at(x: float) -> float:
    """The inverse of `alpha_axis`."""
    least = wp.sqrt(wp.sqrt(MIN_ALPHA))
    root = least + (1.0 - least) * x
    return root * root * root * root


@wp.func
def place(x: float, count: int) -> tuple[int, float]:
    """Cell and place in it of x in [0, 1] among `count` >= 2 nodes."""
    at = wp.clamp(x, 0.0, 1.0) * float(count - 1)
    cell = wp.min(int(at), count - 2)
    return cell, at - float(cell)


@wp.func
def bilinear(table: wp.array2d[float], x: float, y: float) -> float:
    i, s = place(x, table.shape[0])
    j, t = place(y, table.shape[1])
    near = table[i, j] * (1.0 - t) + table[i, j + 1] * t
    far = table[i + 1, j] * (1.0 - t) + table[i + 1, j + 1] * t
    return near + (far - near) * s


@wp.func
def quadrilinear(table: wp.array4d[float], x: float, y: float, z: float, w: float) -> float:
    i, s = place(x, table.shape[0])
    j, t = place(y, table.shape[1])
    near = bilinear(table[i, j], z, w) * (1.0 - t) + bilinear(table[i, j + 1], z, w) * t
    far = bilinear(table[i + 1, j], z, w) * (1.0 - t) + bilinear(table[i + 1, j + 1], z, w) * t
    return near + (far - near) * s


@wp.func
def energy_axis(cosine: float, alpha: float) -> float:
    return cosine * (1.0 + alpha) / (cosine + alpha)


@wp.func
def round_energy(tables: EnergyTables, cosine: float, alpha: float) -> wp.vec2:
    """(E, q) of isotropic facets."""
    c, y = wp.clamp(cosine, LEAST_COSINE, 1.0), alpha_axis(alpha)
    energy = bilinear(tables.round_energy, energy_axis(c, alpha), y)
    return wp.vec2(energy, bilinear(tables.round_share, wp.sqrt(c), y))


@wp.func
def long_energy(tables: EnergyTables, view: wp.vec3, alpha: wp.vec2) -> wp.vec2:
    """(E, q) of anisotropic facets."""
    x, y = view[0] * view[0], view[1] * view[1]
    xx, yy = alpha[0] * alpha[0], alpha[1] * alpha[1]
    tiny = 1.0e-8  # upright views have no plane: any will do
    a = wp.sqrt((xx * x + yy * y + tiny * (xx + yy)) / (x + y + 2.0 * tiny))
    b = wp.sqrt((yy * x + xx * y + tiny * (xx + yy)) / (x + y + 2.0 * tiny))
    correlation = alpha[0] * alpha[1] / (a * b)
    c, p, q = wp.clamp(view[2], LEAST_COSINE, 1.0), alpha_axis(a), alpha_axis(b)
    energy = quadrilinear(tables.long_energy, energy_axis(c, a), p, q, correlation)
    return wp.vec2(energy, quadrilinear(tables.long_share, wp.sqrt(c), p, q, correlation))


@wp.func
def integrate(view: wp.vec3, alpha: wp.vec2, side: int) -> wp.vec2:
    """(E, q) by `side`^2 visible facets, the closer the more they are inclined: GGX's tail is long."""
    total = wp.vec2()
    for i in range(side * side):
        u, t = (float(i % side) + 0.5) / float(side), (float(i / side) + 0.5) / float(side)
        light = sample_reflection(view, alpha, u, 1.0 - t * t)
        if light[2] > 0.0:
            s_view, s_light = stretched(view, alpha), stretched(light, alpha)
            weight = 2.0 * t * light[2] * (view[2] + s_view) / (light[2] * s_view + view[2] * s_light)
            cosine = wp.sqrt(0.5 + 0.5 * wp.dot(light, view))
            total += wp.vec2(weight, weight * schlick(cosine))
    return wp.vec2(total[0] / float(side * side), total[1] / total[0])


@wp.func
def view_at(cosine: float, turn: float) -> wp.vec3:
    c = wp.clamp(cosine, LEAST_COSINE, 1.0)
    sine = wp.sqrt(wp.max(1.0 - c * c, 0.0))
    return wp.vec3(sine * wp.cos(turn), sine * wp.sin(turn), c)


@wp.func
def cosine_at(x: float, alpha: float) -> float:
    """The inverse of `energy_axis`."""
    return x * alpha / (1.0 + alpha - x)


@wp.kernel(module="unique", enable_backward=False)
def round_kernel(side: int, energies: wp.array2d[float], shares: wp.array2d[float]):
    i, j = wp.tid()
    x, alpha = float(i) / float(energies.shape[0] - 1), alpha_at(float(j) / float(energies.shape[1] - 1))
    energies[i, j] = integrate(view_at(cosine_at(x, alpha), 0.0), wp.vec2(alpha), side)[0]
    shares[i, j] = integrate(view_at(x * x, 0.0), wp.vec2(alpha), side)[1]


@wp.kernel(module="unique", enable_backward=False)
def long_kernel(side: int, energies: wp.array4d[float], shares: wp.array4d[float]):
    i, j, k, l = wp.tid()
    x = float(i) / float(energies.shape[0] - 1)
    a, b = alpha_at(float(j) / float(energies.shape[1] - 1)), alpha_at(float(k) / float(energies.shape[2] - 1))
    correlation = wp.max(float(l) / float(energies.shape[3] - 1), 1.0e-3)
    # the matrix of squared alphas in the view's plane has a^2 and b^2 on its diagonal: its own values and their turn
    product = a * b * correlation
    half_sum, half_gap = 0.5 * (a * a + b * b), 0.5 * (a * a - b * b)
    root = wp.sqrt(half_gap * half_gap + a * a * b * b * (1.0 - correlation * correlation))
    longer = wp.sqrt(half_sum + root)
    alpha = wp.vec2(longer, wp.max(product / longer, 1.0e-6))
    turn = 0.5 * wp.acos(wp.clamp(half_gap / wp.max(root, 1.0e-12), -1.0, 1.0))
    energies[i, j, k, l] = integrate(view_at(cosine_at(x, a), turn), alpha, side)[0]
    shares[i, j, k, l] = integrate(view_at(x * x, turn), alpha, side)[1]
