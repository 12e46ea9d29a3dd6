"""The posterior once more: plain loops, scipy.stats, its own formulas; one vector at a time."""

import math

import numpy as np
from scipy import stats

from bayesdeg.laws import HalfNormal, LogNormal, Normal, TruncatedNormal
from tests.emulator.closed_form import BOX, LENGTH


def log_prior(parameters, values):
    """Log prior density of the unconstrained vector: that of the values times |dx/dz|."""
    total = 0.0
    for p in parameters:
        x, law = float(values[p.name]), p.law
        match law:
            case Normal():
                total += stats.norm(law.mean, law.sd).logpdf(x)
            case TruncatedNormal():
                low, high = ((b - law.mean) / law.sd for b in (law.low, law.high))
                total += stats.truncnorm(low, high, law.mean, law.sd).logpdf(x)
            case LogNormal():  # the law of z = ln x is normal
                total += stats.norm(math.log(law.median), law.sigma).logpdf(math.log(x))
            case HalfNormal():  # z = ln x
                total += stats.halfnorm(scale=law.sd).logpdf(x) + math.log(x)
            case _:
                raise NotImplementedError(law)
    return total


def interpolate(nodes, values, at):
    """Polynomial through the nodes, by Newton's divided differences."""
    table = [list(values)]
    for k in range(1, len(nodes)):
        last = table[-1]
        table.append(
            [(last[i + 1] - last[i]) / (nodes[i + k] - nodes[i]) for i in range(len(last) - 1)]
        )
    result, product = 0.0, 1.0
    for k, column in enumerate(table):
        result += column[0] * product
        product *= at - nodes[k]
    return result


def suffix(node):
    return f"{node:g}".replace(".", "_")


def constants_at(values, nodes, degradation):
    c1 = [values[f"c1_at_{suffix(n)}"] for n in nodes]
    c3 = [values[f"c3_at_{suffix(n)}"] for n in nodes]
    ratio = [values[f"c2_ratio_at_{suffix(n)}"] for n in nodes]
    c2 = [r * math.sqrt(3.0 * a * b) for r, a, b in zip(ratio, c1, c3, strict=True)]
    return tuple(interpolate(nodes, c, degradation) for c in (c1, c2, c3))


def deviation_variance(values, nodes, degradation, sd):
    """σ² + (d ln C1/dD sd)², the derivative by a small step."""
    h = 1e-5
    up, down = (math.log(constants_at(values, nodes, degradation + d)[0]) for d in (h, -h))
    return values["stiffness_scatter"] ** 2 + ((up - down) / (2.0 * h) * sd) ** 2


def yeoh_stress(c1, c2, c3, stretch, mode, cauchy):
    """Nominal or Cauchy stress: Σ i C_i (I1 − 3)^(i−1) times 2 (λ − λ_t), by mode."""
    if mode == "uniaxial":
        i1, kinematic = stretch**2 + 2.0 / stretch, 2.0 * (stretch - stretch**-2)
    elif mode == "equibiaxial":
        i1, kinematic = 2.0 * stretch**2 + stretch**-4, 2.0 * (stretch - stretch**-5)
    else:
        i1, kinematic = stretch**2 + 1.0 + stretch**-2, 2.0 * (stretch - stretch**-3)
    stress = kinematic * (c1 + 2.0 * c2 * (i1 - 3.0) + 3.0 * c3 * (i1 - 3.0) ** 2)
    return stretch * stress if cauchy else stress


def curvature(c1, c2, c3, pressure, volume_ratio, paper):
    """Curvature [1/m] and p dκ/dp of the actuator in closed form."""
    scale = volume_ratio ** (1.0 / 3.0)
    q = pressure / 1000.0 / c1
    raw = (c2 / math.sqrt(3.0 * c1 * c3), math.log(c3 / c1), math.log(paper / 1000.0 / c1 / scale))
    a, b, c = (
        2.0 * (v - lo) / (hi - lo) - 1.0
        for v, lo, hi in zip(raw, BOX.lower, BOX.upper, strict=True)
    )
    u = 2.0 * q / BOX.load - 1.0
    gain = 0.7 + 0.25 * u + 0.1 * u * u - 0.15 * a - 0.2 * b - 0.1 * c
    gain += 0.05 * u * b + 0.03 * a * b
    kappa = q * math.exp(gain) / LENGTH * 1000.0 / scale
    return kappa, kappa * (1.0 + q * (0.25 + 0.2 * u + 0.05 * b) * 2.0 / BOX.load)


def most_probable(residual, slope, variance, spread):
    """Mean of m given r = J m + ε: the linear Gaussian rule with full matrices."""
    J = np.array(slope)
    covariance = spread * np.outer(J, J) + np.diag(variance)
    return spread * J @ np.linalg.solve(covariance, np.array(residual))


def log_curve(residual, slope, variance, spread):
    covariance = np.diag(variance) + spread * np.outer(slope, slope)
    return stats.multivariate_normal(np.zeros(len(slope)), covariance).logpdf(residual)


def log_tensile(model, values):
    data, out = model.tensile, []
    for s, mode in enumerate(data.modes):
        level, sd = data.degradation[s], data.degradation_sd[s]
        c = constants_at(values, model.nodes, level)
        spread = deviation_variance(values, model.nodes, level, sd)
        points = np.flatnonzero(data.mask[s])
        f = [yeoh_stress(*c, data.stretch[s, j], mode, data.cauchy[s, j]) for j in points]
        y = [data.stress[s, j] for j in points]
        floor, noise = values["tensile_noise_floor"], values["tensile_noise"]
        m = 0.0
        for _ in range(3):
            slope = [fj * math.exp(m) for fj in f]
            residual = [yj - (sj - sj * m) for yj, sj in zip(y, slope, strict=True)]
            variance = [floor**2 + (noise * sj) ** 2 for sj in slope]
            density = log_curve(residual, slope, variance, spread)
            m = most_probable(residual, slope, variance, spread)
        out.append(density)
    return out


def actuator_variance(model, values, kappa, s, j):
    return (
        values["curvature_noise_floor"] ** 2
        + (values["curvature_noise"] * kappa) ** 2
        + (model.forward.relative_error * kappa) ** 2
        + model.actuator.curvature_sd[s, j] ** 2
    )


def actuator_curve(model, values, s, m):
    """Curvatures and slopes of a specimen whose stiffness is e^m times the median."""
    data = model.actuator
    c = constants_at(values, model.nodes, data.degradation[s, 0])
    soft = [ci * math.exp(m) for ci in c]
    return [
        curvature(*soft, data.pressure[s, j], values["volume_ratio"], values["paper_stiffness"])
        for j in np.flatnonzero(data.mask[s])
    ]


def log_actuator(model, values):
    data, out = model.actuator, []
    for s in range(len(data.specimens)):
        points = np.flatnonzero(data.mask[s])
        spread = deviation_variance(
            values, model.nodes, data.degradation[s, 0], data.degradation_sd[s, 0]
        )
        m = 0.0
        for _ in range(2):
            curve = actuator_curve(model, values, s, m)
            slope = [-change for _, change in curve]
            residual = [
                data.curvature[s, j] - (kappa - J * m)
                for j, (kappa, _), J in zip(points, curve, slope, strict=True)
            ]
            variance = [
                actuator_variance(model, values, kappa, s, j)
                for j, (kappa, _) in zip(points, curve, strict=True)
            ]
            density = log_curve(residual, slope, variance, spread)
            m = most_probable(residual, slope, variance, spread)
        out.append(density)
    return out


def median_elongation(model, values, degradation):
    logs = [math.log(values[f"elongation_at_{suffix(n)}"]) for n in model.elongation_nodes]
    return math.exp(interpolate(model.elongation_nodes, logs, degradation))


def log_breaks(model, values):
    return [
        stats.lognorm(
            values["elongation_scatter"], scale=median_elongation(model, values, level)
        ).logpdf(elongation)
        for level, elongation in zip(model.breaks.degradation, model.breaks.elongation, strict=True)
    ]


def log_statistics(model, values):
    out = []
    for s in model.statistics:
        mean = {
            "young_modulus": lambda level: 6.0 * constants_at(values, model.nodes, level)[0],
            "elongation_at_break": lambda level: median_elongation(model, values, level),
            "volume_ratio": lambda _: values["volume_ratio"],
        }[s.quantity](s.degradation)
        law = stats.norm(mean, s.se) if math.isinf(s.dof) else stats.t(s.dof, mean, s.se)
        out.append(law.logpdf(s.value))
    return out


def is_stable(values, nodes):
    """C1 > 0, C3 > 0 and dW/dI1 > 0 at every strain, at eleven levels of degradation."""
    for k in range(11):
        c1, c2, c3 = constants_at(values, nodes, nodes[-1] * k / 10.0)
        if c1 <= 0.0 or c3 <= 0.0:
            return False
        lowest = -c2 / (3.0 * c3)  # dW/dI1 is a parabola of I1 − 3
        if lowest > 0.0 and c1 + 2.0 * c2 * lowest + 3.0 * c3 * lowest**2 <= 0.0:
            return False
    return True


def log_prob(model, vector):
    values = {name: float(v) for name, v in model.table.named(vector).items()}
    if not is_stable(values, model.nodes):
        return -math.inf
    blocks = (log_tensile, log_actuator, log_breaks, log_statistics)
    return log_prior(model.table.parameters, values) + sum(
        sum(block(model, values)) for block in blocks
    )
