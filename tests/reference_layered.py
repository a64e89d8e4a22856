"""Layered materials in float64: rows of inputs, by name as in `INPUTS`, under rows of lights and views.

Only the tables of directional albedo are the device's own; `mirrors_energy` is what they should hold.
"""

import numpy as np
from scipy.interpolate import RegularGridInterpolator

MIN_ALPHA = 1e-3


def dot(a, b):
    return (a * b).sum(axis=-1)


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def alphas(roughness, anisotropy):
    aspect = 1 - anisotropy
    longer = roughness**2 * np.sqrt(2 / (1 + aspect**2))
    return np.clip(np.stack([longer, longer * aspect], axis=-1), MIN_ALPHA, 1)


def smith_lambda(w, alpha):
    tan2 = ((w[..., :2] * alpha) ** 2).sum(-1) / w[..., 2] ** 2
    return (np.sqrt(1 + tan2) - 1) / 2


def ggx(h, alpha):
    slope = ((h[..., :2] / alpha) ** 2).sum(-1) + h[..., 2] ** 2
    return 1 / (np.pi * alpha[..., 0] * alpha[..., 1] * slope**2)


def reflection(light, view, alpha):
    """Mirrors' f cos, and times Schlick's fifth power: D G2 / (4 (n.v))."""
    h = unit(light + view)
    masked = 1 / (1 + smith_lambda(light, alpha) + smith_lambda(view, alpha))
    mirrors = ggx(h, alpha) * masked / (4 * view[..., 2])
    return np.stack([mirrors, mirrors * (1 - dot(light, h)) ** 5], axis=-1)


def visible_density(light, view, alpha):
    """D_v(h) / (4 (v.h))."""
    h = unit(light + view)
    return ggx(h, alpha) / (1 + smith_lambda(view, alpha)) / (4 * view[..., 2])


def mirrors_energy(view, alpha, side=1024):
    """(E, q) of one view by quadrature over facets' slopes, uniform in the area that GGX's density makes even."""
    u, v = np.meshgrid(*[(np.arange(side) + 0.5) / side] * 2)
    v = 1 - (1 - v) ** 3
    weight = 3 * (1 - v) ** (2 / 3)
    slope, turn = np.sqrt(v / (1 - v)), 2 * np.pi * u
    h = unit(np.stack([alpha[0] * slope * np.cos(turn), alpha[1] * slope * np.sin(turn), np.ones_like(u)], axis=-1))
    vh = h @ view
    light = 2 * vh[..., None] * h - view
    seen = (vh > 0) & (light[..., 2] > 0)
    safe = np.where(seen[..., None], light, [0, 0, 1.0])
    g = 1 / (1 + smith_lambda(safe, np.array(alpha)) + smith_lambda(view, np.array(alpha)))
    # draws follow D (n.h) dh = that of slopes; f cos dl = D G / (4 v_z) * 4 (v.h) dh
    value = np.where(seen, weight * g * vh / (view[2] * h[..., 2]), 0)
    energy = value.mean()
    return energy, (value * (1 - np.clip(vh, 0, 1)) ** 5).mean() / energy


def alpha_axis(alpha):
    least = MIN_ALPHA**0.25
    return (alpha**0.25 - least) / (1 - least)


def interpolated(table, *axes):
    nodes = [np.linspace(0, 1, n) for n in table.shape]
    return RegularGridInterpolator(nodes, table.astype(float))(np.clip(np.stack(axes, axis=-1), 0, 1))


def energy(tables, view, alpha, long):
    """(E, q) from the device's tables `(round energy, round share, long energy, long share)`."""
    c = np.clip(view[..., 2], 1e-4, 1)
    if not long:
        a, rest = alpha[..., 0], [alpha_axis(alpha[..., 0])]
    else:
        phi = np.arctan2(view[..., 1], view[..., 0])
        x, y = (alpha[..., 0] * np.cos(phi), alpha[..., 0] * np.sin(phi)), alpha[..., 1]
        a, b = np.hypot(x[0], y * np.sin(phi)), np.hypot(x[1], y * np.cos(phi))
        rest = [alpha_axis(a), alpha_axis(b), alpha[..., 0] * alpha[..., 1] / (a * b)]
    return (
        interpolated(tables[2 * long], c * (1 + a) / (c + a), *rest),
        interpolated(tables[2 * long + 1], np.sqrt(c), *rest),
    )


def eon_single(cosine, roughness):
    """E_FON (Portsmouth, Kutz and Hill 2025), as their listing has it."""
    c = np.clip(cosine, 1e-6, 1 - 1e-12)
    s = np.sqrt(1 - c * c)
    g = s * (np.arccos(c) - s * c) + 2 / 3 * (s / c * (1 - s**3) - s)
    return (1 + roughness * g / np.pi) / (1 + (0.5 - 2 / (3 * np.pi)) * roughness)


def eon(color, roughness, light, view):
    """f cos."""
    lz, vz = light[..., 2], view[..., 2]
    s = dot(light, view) - lz * vz
    t = np.where(s > 0, np.maximum(lz, vz), 1)
    a = 1 / (1 + (0.5 - 2 / (3 * np.pi)) * roughness)
    mean = a * (1 + (2 / 3 - 28 / (15 * np.pi)) * roughness)
    single = color * (a * (1 + roughness * s / t))[..., None]
    tint = color**2 * mean[..., None] / (1 - color * (1 - mean[..., None]))
    lost = (1 - eon_single(lz, roughness)) * (1 - eon_single(vz, roughness)) / np.maximum(1 - mean, 1e-12)
    return (single + tint * lost[..., None]) * (lz / np.pi)[..., None]


def frame(normal, angle, view):
    """Rows x, y, z; the normal bent towards the viewer to a cosine of 0.01 at least."""
    n = unit(np.concatenate([normal[..., :2], np.maximum(normal[..., 2:], 0.05)], axis=-1))
    cosine, least = dot(n, view), np.minimum(0.01, view[..., 2])
    bent = unit(n - view * cosine[..., None]) * np.sqrt(1 - least**2)[..., None] + view * least[..., None]
    n = np.where((cosine < least)[..., None], bent, n)
    t = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    y = unit(np.cross(n, t))
    return np.stack([np.cross(y, n), y, n], axis=-2)


def into(frame, w):
    return np.einsum("...ij,...j->...i", frame, w)


def compensated(f0, parts, e):
    grazing = np.minimum(50 * f0.max(axis=-1, keepdims=True), 1)
    once = f0 * (parts[..., :1] - parts[..., 1:]) + grazing * parts[..., 1:]
    return once * (1 + f0 * ((1 - e) / e)[..., None])


def facets(inputs, prefix, angle, anisotropy, tables, light, view, long):
    f = frame(inputs[f"{prefix}normal"], angle, view)
    alpha = alphas(inputs[f"{prefix}roughness"][:, 0], anisotropy)
    l, v = into(f, light), into(f, view)
    e, q = energy(tables, v, alpha, long)
    above = l[..., 2] > 0
    safe = np.where(above[:, None], l, [0, 0, 1.0])
    return safe, v, above[:, None], alpha, e, np.stack([e, e * q], axis=-1)


def eon_albedo(color, roughness, cosine):
    single = eon_single(cosine, roughness)[:, None]
    mean = (1 + (2 / 3 - 28 / (15 * np.pi)) * roughness) / (1 + (0.5 - 2 / (3 * np.pi)) * roughness)
    tint = color**2 * mean[:, None] / (1 - color * (1 - mean[:, None]))
    return color * single + tint * (1 - single)


def with_fingerprints(inputs):
    """In float64, with the roughnesses that fingerprints leave."""
    i = {name: np.asarray(value, float) for name, value in inputs.items()}
    rough = i["roughness"] + (i["fingerprint_roughness"] - i["roughness"]) * i["fingerprints"] * (1 - i["coat"])
    coat_rough = i["coat_roughness"] + (i["fingerprint_roughness"] - i["coat_roughness"]) * i["fingerprints"]
    return {**i, "roughness": rough, "coat_roughness": coat_rough}


def evaluate(inputs, tables, light, view, long=True):
    """f cos `[n, 3]`, the density of samples `[n]`, and the directional albedo `[n, 3]`."""
    i = with_fingerprints(inputs)
    one = np.ones((len(light), 3))
    angle = 0.5 * np.arctan2(i["tangent"][:, 1], i["tangent"][:, 0])
    anisotropy = i["anisotropy"][:, 0] * np.minimum(np.linalg.norm(i["tangent"], axis=-1), 1)
    zero = np.zeros(len(light))
    cl, cv, c_above, c_alpha, c_e, c_whole = facets(i, "coat_", zero, zero, tables, light, view, False)
    bl, bv, b_above, b_alpha, b_e, b_whole = facets(i, "", angle, anisotropy, tables, light, view, long)

    coat_f0, base_f0 = one * 0.08 * i["coat_specular"], one * 0.08 * i["specular"]
    root = np.sqrt(np.minimum(coat_f0[:, :1], 0.99))
    ior = (1 + root) / (1 - root)
    way = 1 / np.sqrt(1 - (1 - cv[:, 2:] ** 2) / ior**2)
    under = i["coat_color"] ** way * (1 - compensated(coat_f0, c_whole, c_e))
    clean = 1 - i["dust"]
    base_share = clean * (1 + i["coat"] * (under - 1))
    below = base_share * (1 - i["metalness"]) * (1 - compensated(base_f0, b_whole, b_e))

    def base(parts):
        metal, other = compensated(i["color"], parts, b_e), compensated(base_f0, parts, b_e)
        return base_share * (other + (metal - other) * i["metalness"])

    value = clean * i["coat"] * compensated(coat_f0, reflection(cl, cv, c_alpha), c_e) * c_above
    value = value + base(reflection(bl, bv, b_alpha)) * b_above
    value += below * eon(i["color"], i["diffuse_roughness"][:, 0], bl, bv) * b_above
    value += i["dust"] * eon(i["dust_color"], i["dust_roughness"][:, 0], light, view)

    albedos = np.stack(
        [
            clean * i["coat"] * compensated(coat_f0, c_whole, c_e),
            base(b_whole),
            below * eon_albedo(i["color"], i["diffuse_roughness"][:, 0], bv[:, 2]),
            i["dust"] * eon_albedo(i["dust_color"], i["dust_roughness"][:, 0], view[:, 2]),
        ]
    )
    chances = albedos.mean(axis=-1) / albedos.mean(axis=-1).sum(axis=0)
    density = chances[0] * visible_density(cl, cv, c_alpha) * c_above[:, 0] + chances[3] * light[:, 2] / np.pi
    density += (chances[1] * visible_density(bl, bv, b_alpha) + chances[2] * bl[:, 2] / np.pi) * b_above[:, 0]
    return value, density, albedos.sum(axis=0)
