"""Exact derivatives of the emulated curvature by the inputs, through coordinates and groups."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.emulator.batch import Batch
from bayesdeg.emulator.coordinates import SLACK, coordinates
from bayesdeg.emulator.evaluation import evaluate
from bayesdeg.emulator.scaling import LOAD, MATERIAL, NAMES, SECOND, TrainingRange
from bayesdeg.emulator.terms import Terms, stacked

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def curvature_gradient(
    inputs: Inputs, batch: Batch, allowed: Flags, terms: Terms, span: TrainingRange
) -> dict[str, Floats]:
    """Return derivatives of curvature times moulded length by every field that is given.

    Parameters
    ----------
    inputs : Inputs
        Without a reference pressure.
    batch : Batch
        Of the inputs, one row a point.
    allowed : array of bool, shape (n_rows, 1)
        Where the map answers; elsewhere derivatives are nan.
    terms : Terms
        Of which the first output is Y₀.
    span : TrainingRange
        Of load and groups.

    Returns
    -------
    dict of array
        mm/m over the unit of the field.
    """
    answered = allowed[:, 0]
    middle = 0.5 * (span.lower + span.upper)
    groups = np.where(answered, batch.groups, np.concatenate([[0.0], middle])[:, None])
    groups[0] = np.where(answered, batch.loads[:, 0], 0.0)
    scale = np.broadcast_to(inputs.linear_scale, batch.shape).ravel()
    change, by_group = _by_groups(groups, terms, span)
    fields = _rates(inputs, batch.shape, groups)
    gradient = {}
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):  # where it is refused
        for name, by in fields.items():
            value = sum(by_group[NAMES.index(group)] * rate for group, rate in by.items())
            if name == "linear_scale":
                value = value - change / scale
            value = np.where(answered, 1e3 * value / scale, np.nan)
            gradient[name] = value.reshape(batch.shape)
    return gradient


@lru_cache(maxsize=8)
def _with_gradient(terms: Terms) -> Terms:
    """Return Y₀ and its derivatives by the 13 coordinates, as 14 outputs."""
    first = terms.output(0)
    return stacked([first, *(first.derivative(axis) for axis in range(len(NAMES)))])


def _by_groups(groups: Floats, terms: Terms, span: TrainingRange) -> tuple[Floats, Floats]:
    """Return κ s L (n,) and its derivatives by load and groups (13, n)."""
    at = coordinates(groups.T, span)
    rows = np.ascontiguousarray(at.points.T)
    phi = rows[SLACK][:, None]
    y = evaluate(_with_gradient(terms), rows, rows[0][:, None], phi)[:, :, 0]
    gain = np.exp(y[0] + at.warp)
    by_group = np.einsum("an,nag->gn", y[1:], at.jacobian) + at.warp_gradient.T
    by_group *= groups[0] * gain
    by_group[NAMES.index(LOAD)] += gain
    return groups[0] * gain, by_group


def _rates(
    inputs: Inputs, shape: tuple[int, ...], groups: Floats
) -> dict[str, Mapping[str, Floats]]:
    """Return the derivatives of the groups by each field of the inputs that is given."""

    def spread(value: Floats) -> Floats:
        return np.broadcast_to(value, shape).ravel()

    at = dict(zip(NAMES, groups, strict=True))
    c1, c3, scale = spread(inputs.c1), spread(inputs.c3), spread(inputs.linear_scale)
    second = np.zeros(1) if inputs.second_invariant is None else spread(inputs.second_invariant)
    modulus = c1 + SECOND * second
    one = np.ones(())
    with np.errstate(divide="ignore", invalid="ignore"):
        by_modulus = _by_modulus(at, modulus)
        weight = 1e-6 * scale / modulus
        rates: dict[str, Mapping[str, Floats]] = {
            "pressure": {LOAD: 1e-3 / modulus},
            "c1": by_modulus,
            "c2": {"softening": 1.0 / np.sqrt(3.0 * c3 * modulus)},
            "c3": {"softening": -0.5 * at["softening"] / c3, "log_stiffening": 1.0 / c3},
            "linear_scale": {
                "log_paper": -1.0 / scale,
                "paper_thickness": -at["paper_thickness"] / scale,
                "gravity_along": at["gravity_along"] / scale,
                "gravity_up": at["gravity_up"] / scale,
                "erosion": -at["erosion"] / scale,
            },
            "paper_stiffness": {"log_paper": 1.0 / spread(inputs.paper_stiffness)},
            "second_invariant": {name: SECOND * rate for name, rate in by_modulus.items()}
            | {"second_invariant": SECOND * (by_modulus["second_invariant"] + 1.0 / modulus)},
            "skin": {"skin": one},
            "paper_thickness": {"paper_thickness": 1.0 / scale},
            "paper_slack": {"paper_slack": one},
            "paper_mismatch": {"paper_mismatch": one},
            "weight_along": {"gravity_along": weight},
            "weight_up": {"gravity_up": weight},
            "wall_factor": {"wall_factor": one},
            "erosion": {"erosion": 1.0 / scale},
        }
    return {name: by for name, by in rates.items() if getattr(inputs, name) is not None}


def _by_modulus(at: Mapping[str, Floats], modulus: Floats) -> dict[str, Floats]:
    """Return the derivatives of the groups by M, all else as it is."""
    ratios = (LOAD, "second_invariant", "gravity_along", "gravity_up")
    logarithms = [group.name for group in MATERIAL if group.name.startswith("log_")]
    return (
        {name: -at[name] / modulus for name in ratios}
        | dict.fromkeys(logarithms, -1.0 / modulus)
        | {"softening": -0.5 * at["softening"] / modulus}
    )
