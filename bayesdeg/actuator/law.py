"""The law of the solid at one point, compiled: energy, stress and elasticity.

W(F, p) = Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) + p (J − 1), with G = F⁻ᵀ, M = I₁ F − F C = ½ ∂I₂/∂F.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@njit(cache=True)
def invert(f: Floats, g: Floats) -> float:  # pragma: no cover - compiled
    """Overwrite ``g`` with F⁻ᵀ and return det F."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for m in range(3):
            n, o = (m + 1) % 3, (m + 2) % 3
            g[m, i] = f[n, j] * f[o, k] - f[n, k] * f[o, j]
    jacobian = f[0, 0] * g[0, 0] + f[0, 1] * g[0, 1] + f[0, 2] * g[0, 2]
    if jacobian != 0.0:
        g /= jacobian
    return float(jacobian)


@njit(cache=True)
def energy(f: Floats, constants: Floats) -> float:  # pragma: no cover - compiled
    """Return the isochoric energy Σ cᵢ (Ī₁ − 3)ⁱ + r (√Ī₂ − √3) [C1]."""
    jacobian = np.linalg.det(f)
    c = f.T @ f
    first = np.trace(c)
    second = 0.5 * (first * first - np.sum(c * c))
    x = first * jacobian ** (-2.0 / 3.0) - 3.0
    y = second * jacobian ** (-4.0 / 3.0)
    total = x * (constants[0] + x * (constants[1] + x * constants[2]))
    return float(total + constants[3] * (np.sqrt(y) - np.sqrt(3.0)))


@njit(cache=True)
def _yeoh(
    f: Floats, jacobian: float, constants: Floats
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return I₁ and J^(-2/3) W', J^(-4/3) W''."""
    first = 0.0
    for i in range(3):
        for j in range(3):
            first += f[i, j] * f[i, j]
    isochoric = jacobian ** (-2.0 / 3.0)
    x = isochoric * first - 3.0
    w1 = isochoric * (constants[0] + x * (2.0 * constants[1] + 3.0 * constants[2] * x))
    w2 = isochoric * isochoric * (2.0 * constants[1] + 6.0 * constants[2] * x)
    return first, w1, w2


@njit(cache=True)
def stress(
    f: Floats, g: Floats, jacobian: float, p: float, constants: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (3, 3) with P = ∂W/∂F."""
    first, w1, _ = _yeoh(f, jacobian, constants)
    on_g, on_f = p * jacobian - 2.0 / 3.0 * first * w1, 2.0 * w1
    for i in range(3):
        for j in range(3):
            out[i, j] = on_g * g[i, j] + on_f * f[i, j]
    if constants[3] != 0.0:
        m, second = _second(f, first)
        v1, isochoric, _ = _root(second, jacobian, constants[3])
        out += v1 * isochoric * (2.0 * m - 4.0 / 3.0 * second * g)


@njit(cache=True)
def _second(f: Floats, first: float) -> tuple[Floats, float]:  # pragma: no cover - compiled
    """Return M = I₁ F − F C and I₂ = ½ M : F."""
    m = first * f - f @ (f.T @ f)
    return m, 0.5 * np.sum(m * f)


@njit(cache=True)
def _root(
    second: float, jacobian: float, r: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return V', J^(-4/3) and V'' of V = r √Ī₂."""
    isochoric = jacobian ** (-4.0 / 3.0)
    y = isochoric * second
    return 0.5 * r / np.sqrt(y), isochoric, -0.25 * r / (y * np.sqrt(y))


@njit(cache=True)
def elasticity(
    f: Floats, g: Floats, jacobian: float, p: float, constants: Floats, out: Floats
) -> None:  # pragma: no cover - compiled
    """Overwrite ``out`` (6, 3, 3) with A_iJkL = ∂²W/∂F_iJ∂F_kL for ik = 00, 01, 02, 11, 12, 22."""
    first, w1, w2 = _yeoh(f, jacobian, constants)
    pj = p * jacobian
    gg = 4.0 / 9.0 * first * (w1 + first * w2) + pj
    gf = -4.0 / 3.0 * (w1 + first * w2)
    ff = 4.0 * w2
    crossed = 2.0 / 3.0 * first * w1 - pj
    pair = 0
    for i in range(3):
        for k in range(i, 3):
            for j in range(3):
                on_g, on_f = gg * g[i, j] + gf * f[i, j], gf * g[i, j] + ff * f[i, j]
                for m in range(3):
                    out[pair, j, m] = on_g * g[k, m] + on_f * f[k, m] + crossed * g[i, m] * g[k, j]
                if i == k:
                    out[pair, j, j] += 2.0 * w1
            pair += 1
    if constants[3] != 0.0:
        _add_second(f, g, jacobian, constants[3], first, out)


@njit(cache=True)
def _add_second(
    f: Floats, g: Floats, jacobian: float, r: float, first: float, out: Floats
) -> None:  # pragma: no cover - compiled
    """Add the part of r √Ī₂ to the elasticity."""
    m, second = _second(f, first)
    v1, isochoric, v2 = _root(second, jacobian, r)
    left, right = f @ f.T, f.T @ f
    d = isochoric * (2.0 * m - 4.0 / 3.0 * second * g)
    a = v1 * isochoric
    pair = 0
    for i in range(3):
        for k in range(i, 3):
            for j in range(3):
                for n in range(3):
                    value = 2.0 * (2.0 * f[i, j] * f[k, n] - f[i, n] * f[k, j])
                    if i == k:
                        value -= 2.0 * right[n, j]
                    if j == n:
                        value -= 2.0 * left[i, k]
                    if i == k and j == n:
                        value += 2.0 * first
                    value -= 8.0 / 3.0 * (g[i, j] * m[k, n] + m[i, j] * g[k, n])
                    value += 16.0 / 9.0 * second * g[i, j] * g[k, n]
                    value += 4.0 / 3.0 * second * g[i, n] * g[k, j]
                    out[pair, j, n] += a * value + v2 * d[i, j] * d[k, n]
            pair += 1
