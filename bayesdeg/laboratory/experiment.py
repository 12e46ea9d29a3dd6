"""A whole virtual experiment: every test of a design on one truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.causes.catalogue import in_order
from bayesdeg.laboratory.actuators import inflate_actuators
from bayesdeg.laboratory.design import Design
from bayesdeg.laboratory.effects import HiddenEffect
from bayesdeg.laboratory.films import tear_films, weigh_moisture, weigh_shrinkage
from bayesdeg.laboratory.truth import Truth
from bayesdeg.measure.tables import TABLES


@dataclass(frozen=True)
class VirtualExperiment:
    """What a virtual experiment recorded, and what was true.

    Parameters
    ----------
    tables : mapping of str to pandas.DataFrame
        By name as in `bayesdeg.measure.tables.TABLES`, with the columns of the files, rounded as
        recorded.
    truth : Truth
        The material and the errors.
    effects : tuple of HiddenEffect
        What was hidden.
    actuators, films : pandas.DataFrame
        By ``specimen_id``: ``degradation_pct``, ``ln_stiffness``, ``limit_stretch`` as they
        really were; of actuators also ``status``, how their solution ended.
    """

    tables: Mapping[str, pd.DataFrame]
    truth: Truth
    effects: tuple[HiddenEffect, ...]
    actuators: pd.DataFrame
    films: pd.DataFrame


def run_experiment(
    design: Design,
    truth: Truth,
    *,
    forward: ForwardMap,
    generator: np.random.Generator,
    effects: Sequence[HiddenEffect] = (),
) -> VirtualExperiment:
    """Make every test of a design.

    Each kind of test has its own stream of random numbers, so that with one seed films and errors
    are the same whatever is hidden.

    Parameters
    ----------
    design : Design
        What is tested.
    truth : Truth
        What is tested really is.
    forward : ForwardMap
        The mechanics, called once for all actuators; the fine finite element model if the
        experiment is to stand for a real one.
    generator : numpy.random.Generator
        Source of all randomness.
    effects : sequence of HiddenEffect
        What is hidden, in actuators and in the stresses of films.

    Returns
    -------
    VirtualExperiment
    """
    by_name = {hidden.cause.name: hidden for hidden in effects}
    ordered = tuple(by_name[c.name] for c in in_order(h.cause for h in by_name.values()))
    tear, inflate, moisture, shrinkage = generator.spawn(4)
    tensile, breaks, films = tear_films(design, truth, tear, ordered)
    actuator, actuators = inflate_actuators(
        design.actuator, truth, effects=ordered, forward=forward, generator=inflate
    )
    if not design.bend_angle:
        actuator = actuator.drop(columns="bend_angle_deg")
    tables = {
        "moisture": weigh_moisture(design.moisture, truth, moisture),
        "shrinkage": weigh_shrinkage(design.shrinkage, truth, shrinkage, design.mixture),
        "tensile": tensile,
        "breaks": breaks,
        "actuator": actuator,
    }
    tables = {name: _in_order_of_contract(name, table) for name, table in tables.items()}
    return VirtualExperiment(tables, truth, ordered, actuators, films)


def _in_order_of_contract(name: str, table: pd.DataFrame) -> pd.DataFrame:
    return table[[column.name for column in TABLES[name].columns if column.name in table]]
