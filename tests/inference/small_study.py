"""A small study as arrays: ragged curves of all modes, one set of parameters that made them."""

from dataclasses import replace
from functools import cache

import numpy as np

from bayesdeg.inference.model import JointModel
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.observations.breaks import Breaks, BreakTable
from bayesdeg.observations.curvature import (
    BEND_ANGLE,
    EMULATOR,
    ActuatorCurves,
    Curvature,
    actuator_parameters,
)
from bayesdeg.observations.means import Means, Statistic
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.specimens import (
    STIFFNESS_SCATTER,
    FilmsAndActuators,
    elongation_parameters,
    has_elongation,
    material_parameters,
    no_map,
)
from bayesdeg.observations.tensile import TENSILE, Tensile, TensileCurves
from tests.surrogate.closed_form import ClosedFormMap

NODES = (0.0, 12.5, 25.0)
ELONGATION_NODES = (0.0, 25.0)

TRUTH = {
    "c1_at_0": 0.3,
    "c2_ratio_at_0": -0.2,
    "c3_at_0": 1.5e-3,
    "c1_control_12_5": 0.5,
    "c2_ratio_control_12_5": -0.1,
    "c3_control_12_5": 5e-3,
    "c1_at_25": 1.5,
    "c2_ratio_at_25": -0.15,
    "c3_at_25": 0.1,
    "stiffness_scatter": 0.05,
    "tensile_noise": 0.03,
    "tensile_noise_floor": 0.01,
    "tensile_noise_length": 0.05,
    "volume_ratio": 0.62,
    "paper_stiffness": 3e4,
    "curvature_noise": 0.02,
    "curvature_noise_floor": 0.1,
    "curvature_noise_length": 15.0,
    "bend_angle_noise": 0.02,
    "bend_angle_noise_floor": 0.25,
    "reading_correlation": 0.4,
    "emulator_error_level": 0.3,
    "emulator_error_pressure": -0.5,
    "emulator_error_degradation": 0.8,
    "elongation_at_0": 210.0,
    "elongation_at_25": 52.0,
    "elongation_scatter": 0.1,
}


def base_parameters():
    return (
        *material_parameters(NODES),
        STIFFNESS_SCATTER,
        *TENSILE,
        *actuator_parameters(140.0),
        *BEND_ANGLE,
        *EMULATOR,
        *elongation_parameters(ELONGATION_NODES),
    )


def tensile_curves():
    """Four films, without stresses: two modes, one curve of Cauchy stress, different lengths."""
    modes = ("uniaxial", "uniaxial", "equibiaxial", "planar")
    cauchy = np.zeros((4, 6), bool)
    cauchy[1] = True
    stretch = np.ones((4, 6))
    stretch[0] = np.linspace(1.1, 2.8, 6)
    stretch[1] = np.linspace(1.05, 1.6, 6)
    stretch[2, :4] = np.linspace(1.1, 1.7, 4)
    stretch[3, :5] = np.linspace(1.2, 2.0, 5)
    measure = np.where(cauchy, "cauchy", "nominal")
    return TensileCurves(
        specimens=("f1", "f2", "f3", "f4"),
        modes=modes,
        degradation=np.array([0.0, 22.0, 0.3, 11.0]),
        degradation_sd=np.array([0.0, 1.0, 0.5, 0.8]),
        basis=yeoh_basis(stretch, np.array(modes)[:, None], measure),
        stretch=stretch,
        stress=np.zeros((4, 6)),
        cauchy=cauchy,
        mask=np.arange(6) < np.array([6, 6, 4, 5])[:, None],
    )


def actuator_curves():
    """Five actuators, without readings: gaps, one with its own reading error."""
    pressure = np.tile(np.linspace(20.0, 140.0, 7), (5, 1))
    mask = np.ones((5, 7), bool)
    mask[1, 3] = False
    mask[4, 5:] = False
    angle_mask = mask.copy()
    angle_mask[0] = False
    angle_mask[3, [0, 4]] = False
    recorded = np.ones((5, 7), bool)
    recorded[4, 5:] = False
    curvature_sd = np.zeros((5, 7))
    curvature_sd[2] = 0.15
    angle_sd = np.zeros((5, 7))
    return ActuatorCurves(
        specimens=("a1", "a2", "a3", "a4", "a5"),
        degradation=np.array([[0.0], [0.0], [5.2], [14.0], [24.0]]),
        degradation_sd=np.array([[0.0], [0.5], [0.5], [1.0], [0.7]]),
        pressure=pressure,
        curvature=np.zeros((5, 7)),
        curvature_sd=curvature_sd,
        angle_sd=angle_sd,
        mask=mask,
        bend_angle=np.zeros((5, 7)),
        angle_mask=angle_mask,
        recorded=recorded,
        ruptured=np.zeros((5, 7), bool),
        cycle=np.ones((5, 7), np.int64),
        branch=np.full((5, 7), "loading"),
        time=np.full((5, 7), np.nan),
        humidity=np.full((5, 7), np.nan),
        mount=np.full((5, 7), "horizontal"),
    )


def values_of(truth=None, count=1):
    return {name: np.full(count, value) for name, value in (truth or TRUTH).items()}


def altered(model, *, actuator=..., tensile=..., breaks=..., statistics=..., **changes):
    """The model with other data, none where they are None, or with another forward map."""
    if "base" in changes:
        model = replace(model, base=changes.pop("base"))
    if changes:
        model = model.with_world(**{n: no_map if v is None else v for n, v in changes.items()})
    if actuator is None:
        model = model.without_kinds("actuator", "rupture")
    elif actuator is not ...:
        model = model.with_observations(*data_of_actuators(actuator, model.base))
    kinds = {"tensile": (Tensile, tensile), "breaks": (Breaks, breaks)}
    kinds["statistics"] = (Means, statistics)
    for name, (kind, data) in kinds.items():
        if data is None or data == ():
            model = model.without_kinds(name)
        elif data is not ...:
            model = model.with_observations(kind(data))
    if not has_elongation(model.base):
        return model.without_kinds("rupture")
    return (
        model
        if not model.of_kind(Curvature)
        else model.with_observations(*data_of_actuators(model.data_of(Curvature).tests, model.base))
    )


@cache
def small_model(forward=None):
    """Return the model with all kinds of data, simulated from ``TRUTH``."""
    generator = np.random.default_rng(20211124)
    world = FilmsAndActuators(
        nodes=NODES,
        elongation_nodes=ELONGATION_NODES,
        forward=forward or ClosedFormMap(),
        largest_pressure=140.0,
    )
    empty = JointModel(base_parameters(), (Tensile(tensile_curves()),), world)
    empty = empty.with_observations(*data_of_actuators(actuator_curves(), empty.base))
    values = values_of()
    tensile = empty.data_of(Tensile).tests
    constants = empty.world.constants(values, tensile.degradation)[0]
    stress = np.matmul(tensile.basis, constants[..., None])[..., 0]
    stress = stress * np.exp(0.06 * generator.standard_normal((4, 1)))
    stress = stress * (1.0 + 0.03 * generator.standard_normal(stress.shape))
    breaks = BreakTable(
        specimens=("b1", "b2", "b3"),
        degradation=np.array([0.0, 13.0, 25.0]),
        degradation_sd=np.array([0.0, 0.8, 1.0]),
        elongation=np.array([215.0, 100.0, 55.0]),
    )
    statistics = (
        Statistic("young_modulus", 0.0, 1.73, 0.15 / np.sqrt(3.0), "published", 2.0),
        Statistic("young_modulus", 25.0, 9.5, 1.0, "published"),
        Statistic("elongation_at_break", 25.0, 52.0, 5.0, "published"),
        Statistic("volume_ratio", 0.0, 0.62, 0.035, "published"),
    )
    return altered(
        empty,
        tensile=replace(tensile, stress=np.where(tensile.mask, stress, 0.0)),
        breaks=breaks,
        statistics=statistics,
    ).with_observations(
        *data_of_actuators(
            altered(
                empty,
                tensile=replace(tensile, stress=np.where(tensile.mask, stress, 0.0)),
                breaks=breaks,
                statistics=statistics,
            )
            .data_of(Curvature)
            .tests.with_readings(empty.data_of(Curvature).drawn(empty.tests(values), generator)[0]),
            altered(
                empty,
                tensile=replace(tensile, stress=np.where(tensile.mask, stress, 0.0)),
                breaks=breaks,
                statistics=statistics,
            ).base,
        )
    )


def draws_near_truth(model, count, *, spread=0.05, seed=0):
    """Vectors about the truth, all of them possible."""
    generator = np.random.default_rng(seed)
    centre = model.table.vectors(values_of())
    return centre + spread * generator.standard_normal((count, centre.shape[1]))


def near_medians(model, count, **known):
    """Vectors about the medians of the priors, or about known values."""
    medians = {p.name: p.law.quantile(0.5) for p in model.table.parameters} | known
    centre = model.table.vectors(medians)
    return centre + 0.02 * np.random.default_rng(5).standard_normal((count, len(centre)))
