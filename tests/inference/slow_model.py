"""The posterior once more: plain loops, scipy.stats, its own formulas; one vector at a time."""

import math
from itertools import pairwise

import numpy as np
from scipy import stats

from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.tensile import Tensile
from bayesdeg.priors import HalfNormal, LogNormal, Normal, TruncatedNormal, Uniform
from tests.surrogate.closed_form import BOX, LENGTH


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
            case Uniform():  # z = logit of the place between the bounds
                width = law.high - law.low
                place = (x - law.low) / width
                total += stats.uniform(law.low, width).logpdf(x)
                total += math.log(width * place * (1.0 - place))
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


def casteljau(controls, t):
    """Polynomial of control values: averages of neighbours, until one is left."""
    while len(controls) > 1:
        controls = [(1.0 - t) * left + t * right for left, right in pairwise(controls)]
    return controls[0]


def control_values(values, nodes):
    names = [
        f"at_{suffix(n)}" if k in (0, len(nodes) - 1) else f"control_{suffix(n)}"
        for k, n in enumerate(nodes)
    ]
    c1, ratio, c3 = ([values[f"{q}_{n}"] for n in names] for q in ("c1", "c2_ratio", "c3"))
    c2 = [r * math.sqrt(3.0 * a * b) for r, a, b in zip(ratio, c1, c3, strict=True)]
    return c1, c2, c3


def constants_at(values, nodes, degradation):
    t = (degradation - nodes[0]) / (nodes[-1] - nodes[0])
    return tuple(casteljau(c, t) for c in control_values(values, nodes))


def constant_slopes_at(values, nodes, degradation):
    """dC/dD by a complex step."""
    h = 1e-30
    return tuple(c.imag / h for c in constants_at(values, nodes, degradation + 1j * h))


def deviation_variance(values, nodes, degradation, sd):
    """σ² + (d ln C1/dD sd)²."""
    c1 = constants_at(values, nodes, degradation)[0]
    slope = constant_slopes_at(values, nodes, degradation)[0]
    return values["stiffness_scatter"] ** 2 + (slope / c1 * sd) ** 2


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


def mechanics(c1, c2, c3, pressure, volume_ratio, paper):
    """Curvature [1/m], p dκ/dp, bend angle [°], peak stretch of the actuator in closed form."""
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
    kappa = q * math.exp(gain) / LENGTH
    grown = kappa * (1.0 + q * (0.25 + 0.2 * u + 0.05 * b) * 2.0 / BOX.load)
    angle = math.degrees(kappa * LENGTH * (1.0 + q * (0.05 + 0.02 * u + 0.01 * a)))
    stretch = 1.0 + q * math.exp(0.1 + 0.3 * u + 0.1 * b)
    return kappa * 1000.0 / scale, grown * 1000.0 / scale, angle, stretch


def noise_covariance(places, outputs, sds, length, correlation):
    """Errors of reading: alike nearby on the path, and in the two outputs of one picture.

    A place is the path up to a reading and the reading's number; a fifth of its error is its own.
    """
    size = len(places)
    matrix = np.empty((size, size))
    for i in range(size):
        for j in range(size):
            alike = math.exp(-abs(places[i][0] - places[j][0]) / length)
            alike *= 1.0 if places[i][1] == places[j][1] else 0.8
            across = 1.0 if outputs[i] == outputs[j] else correlation
            matrix[i, j] = sds[i] * sds[j] * alike * across
    return matrix


def most_probable(residual, slopes, noise, spreads):
    """Mean of m given r = J m + ε: the linear Gaussian rule with full matrices."""
    J, tau = np.array(slopes), np.diag(spreads)
    return tau @ J.T @ np.linalg.solve(noise + J @ tau @ J.T, np.array(residual))


def log_readings(residual, slopes, noise, spreads):
    J = np.array(slopes)
    covariance = noise + J @ np.diag(spreads) @ J.T
    return stats.multivariate_normal(np.zeros(len(J)), covariance).logpdf(residual)


def log_tensile(model, values):
    data, out = model.data_of(Tensile).tests, []
    for s, mode in enumerate(data.modes):
        level = data.degradation[s]
        c = constants_at(values, model.world.nodes, level)
        c_slopes = constant_slopes_at(values, model.world.nodes, level)
        spreads = [values["stiffness_scatter"] ** 2, data.degradation_sd[s] ** 2]
        points = np.flatnonzero(data.mask[s])
        places = [(data.stretch[s, j], j) for j in points]
        f, g = (
            [yeoh_stress(*k, data.stretch[s, j], mode, data.cauchy[s, j]) for j in points]
            for k in (c, c_slopes)
        )
        floor, share = values["tensile_noise_floor"], values["tensile_noise"]
        m, d = 0.0, 0.0
        for _ in range(3):
            stress = [math.exp(m) * (fj + gj * d) for fj, gj in zip(f, g, strict=True)]
            slopes = [[sj, math.exp(m) * gj] for sj, gj in zip(stress, g, strict=True)]
            residual = [
                data.stress[s, j] - (sj - jm * m - jd * d)
                for j, sj, (jm, jd) in zip(points, stress, slopes, strict=True)
            ]
            sds = [math.hypot(floor, share * sj) for sj in stress]
            noise = noise_covariance(
                places, [0] * len(places), sds, values["tensile_noise_length"], 0.0
            )
            density = log_readings(residual, slopes, noise, spreads)
            m, d = most_probable(residual, slopes, noise, spreads)
        out.append(density)
    return out


def common_error(model, values, s, j):
    """g, the emulator's error in its own standard errors."""
    data = model.data_of(Curvature).tests
    return (
        values["emulator_error_level"] / math.sqrt(3.0)
        + values["emulator_error_pressure"]
        * (2.0 * data.pressure[s, j] / model.world.largest_pressure - 1.0)
        + values["emulator_error_degradation"]
        * (2.0 * data.degradation[s, 0] / model.world.nodes[-1] - 1.0)
    )


def actuator_readings(model, values, s, m):
    """Mean, slope, sd, place and output of a specimen whose stiffness is e^m times the median."""
    data = model.data_of(Curvature).tests
    soft = [
        ci * math.exp(m) for ci in constants_at(values, model.world.nodes, data.degradation[s, 0])
    ]
    place = np.cumsum(np.abs(np.diff(np.concatenate([[0.0], data.pressure[s]]))))
    rows = []
    for output, mask in enumerate((data.mask[s], data.mask[s] & data.angle_mask[s])):
        for j in np.flatnonzero(mask):
            p, own = data.pressure[s, j], values["volume_ratio"]
            kappa, grown, angle, _ = mechanics(*soft, p, own, values["paper_stiffness"])
            error = 1.0 + common_error(model, values, s, j) * model.world.forward.relative_error
            growth = grown / (kappa * error)
            if output == 0:
                floor = math.hypot(values["curvature_noise_floor"], data.curvature_sd[s, j])
                sd = math.hypot(floor, values["curvature_noise"] * kappa * error)
                rows.append((kappa * error, -grown, sd, (place[j], j), 0, data.curvature[s, j]))
            else:
                read = angle * error
                floor = math.hypot(values["bend_angle_noise_floor"], data.angle_sd[s, j])
                sd = math.hypot(floor, values["bend_angle_noise"] * read)
                rows.append((read, -read * growth, sd, (place[j], j), 1, data.bend_angle[s, j]))
    return rows


def linearised_actuator(model, values, s, m):
    """Residual, slopes, noise and variance of the deviation, at the deviation m."""
    level, sd = (
        model.data_of(Curvature).tests.degradation[s, 0],
        model.data_of(Curvature).tests.degradation_sd[s, 0],
    )
    spread = deviation_variance(values, model.world.nodes, level, sd)
    mean, slope, sd, place, output, read = zip(*actuator_readings(model, values, s, m), strict=True)
    residual = [y - (f - J * m) for y, f, J in zip(read, mean, slope, strict=True)]
    noise = noise_covariance(
        place, output, sd, values["curvature_noise_length"], values["reading_correlation"]
    )
    return residual, [[J] for J in slope], noise, [spread]


def log_actuator(model, values):
    out = []
    for s in range(len(model.data_of(Curvature).tests.specimens)):
        m = most_probable(*linearised_actuator(model, values, s, 0.0))[0]
        out.append(log_readings(*linearised_actuator(model, values, s, m)))
    return out


def log_rupture(model, values):
    """Bursting between two pressures, or surviving the largest: differences of normal laws."""
    data, out = model.data_of(Curvature).tests, []
    for s in range(len(data.specimens)):
        level, sd = data.degradation[s, 0], data.degradation_sd[s, 0]
        spread = elongation_variance(model, values, level, sd)
        m = most_probable(*linearised_actuator(model, values, s, 0.0))[0]
        soft = [ci * math.exp(m) for ci in constants_at(values, model.world.nodes, level)]
        burst = list(np.flatnonzero(data.ruptured[s]))
        end = data.pressure[s, burst[0]] if burst else math.inf
        survived = [
            j
            for j in np.flatnonzero(data.recorded[s])
            if j not in burst and 0.0 < data.pressure[s, j] < end
        ]

        def score(p, soft=soft, spread=spread, level=level):
            stretch = mechanics(*soft, p, values["volume_ratio"], values["paper_stiffness"])[3]
            median = median_elongation(model, values, level) / 100.0
            total = math.sqrt(spread + model.world.forward.relative_error**2)
            return math.log((stretch - 1.0) / median) / total

        low = score(max(data.pressure[s, j] for j in survived)) if survived else -math.inf
        high = score(end) if burst else math.inf
        law = stats.norm()
        out.append(math.log(law.sf(low) - law.sf(high)))
    return out


def median_elongation(model, values, degradation):
    logs = [math.log(values[f"elongation_at_{suffix(n)}"]) for n in model.world.elongation_nodes]
    return math.exp(interpolate(model.world.elongation_nodes, logs, degradation))


def elongation_variance(model, values, degradation, sd):
    """σ² + (d ln ε/dD sd)², the derivative by a small step."""
    h = 1e-5
    up, down = (math.log(median_elongation(model, values, degradation + d)) for d in (h, -h))
    return values["elongation_scatter"] ** 2 + ((up - down) / (2.0 * h) * sd) ** 2


def log_breaks(model, values):
    data = model.data_of(Breaks).table
    return [
        stats.lognorm(
            math.sqrt(elongation_variance(model, values, level, sd)),
            scale=median_elongation(model, values, level),
        ).logpdf(elongation)
        for level, sd, elongation in zip(
            data.degradation, data.degradation_sd, data.elongation, strict=True
        )
    ]


def young_modulus(model, values, level):
    """6 C1, and √3 r of the term r (√I₂ − √3) where its cause is active."""
    ratio = values.get("second_invariant.ratio", 0.0)
    return (6.0 + math.sqrt(3.0) * ratio) * constants_at(values, model.world.nodes, level)[0]


def log_statistics(model, values):
    out = []
    for s in model.data_of(Means).statistics:
        mean = {
            "young_modulus": lambda level: young_modulus(model, values, level),
            "elongation_at_break": lambda level: median_elongation(model, values, level),
            "volume_ratio": lambda _: values["volume_ratio"],
        }[s.quantity](s.degradation)
        law = stats.norm(mean, s.se) if math.isinf(s.dof) else stats.t(s.dof, mean, s.se)
        out.append(law.logpdf(s.value))
    return out


def log_prob(model, vector):
    values = {name: float(v) for name, v in model.table.named(vector).items()}
    blocks = (log_tensile, log_actuator, log_rupture, log_breaks, log_statistics)
    return log_prior(model.table.parameters, values) + sum(
        sum(block(model, values)) for block in blocks
    )
