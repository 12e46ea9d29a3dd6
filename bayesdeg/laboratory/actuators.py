"""The actuators' test: pressure up step by step, curvature and bend angle read, until one bursts.

The folding of causes is that of `bayesdeg.inference.model`, on the truth instead of a guess.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.actuator.status import Status
from bayesdeg.causes.cause import Conditions, Degradation, Strength
from bayesdeg.laboratory.effects import HiddenEffect
from bayesdeg.laboratory.specimens import (
    alike_along,
    constants_of,
    draw_specimens,
    noise,
    stated_sd,
)
from bayesdeg.laboratory.truth import Truth

Floats = npt.NDArray[np.float64]


class _Plan(NamedTuple):
    """The rows of the design in the order of specimens, and as specimens by steps.

    ``known_sd`` is the reading error that the design states, on each row.
    """

    rows: pd.DataFrame
    names: pd.Series
    conditions: Conditions
    degradation_sd: Floats
    mask: npt.NDArray[np.bool_]
    known_sd: Floats


def inflate_actuators(
    table: pd.DataFrame,
    truth: Truth,
    *,
    effects: Sequence[HiddenEffect],
    forward: ForwardMap,
    generator: np.random.Generator,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Inflate actuators and read curvature and bend angle.

    A specimen bursts at the first pressure at which its peak stretch exceeds its own limit
    stretch, or at which the forward map finds no equilibrium; nothing is read from there on. A
    reading at zero pressure has no error, since curvature is counted from it.

    Parameters
    ----------
    table : pandas.DataFrame
        ``Design.actuator``.
    truth : Truth
        Material, scatter, reading errors.
    effects : sequence of HiddenEffect
        What is hidden, in the order of application.
    forward : ForwardMap
        The mechanics; its own standard error is not added.
    generator : numpy.random.Generator
        Source of randomness; how much is drawn depends on the design alone.

    Returns
    -------
    readings, specimens : pandas.DataFrame
        The columns of ``actuator.csv``, and the actuators as they really are, with ``status``
        saying how their solution ended.
    """
    plan = _plan(table, truth)
    specimens = _drawn(plan, truth, effects, generator)
    prediction = _predict(plan, truth, effects, forward, constants_of(specimens, truth))
    readings = _read(plan, truth, prediction, specimens, generator)
    worst = [Status(int(status)).name.lower() for status in prediction.status.max(axis=1)]
    return readings, specimens.assign(status=worst)


def _plan(table: pd.DataFrame, truth: Truth) -> _Plan:
    tests = [test for _, test in table.groupby("specimen_id", sort=False)]
    rows = pd.concat(tests, ignore_index=True)
    rows = rows.assign(degradation_sd_pct=stated_sd(rows, truth))
    first = rows.drop_duplicates("specimen_id")
    size = max(len(test) for test in tests)
    # repeating the last pressure adds no solution
    steps = [np.minimum(np.arange(size), len(test) - 1) for test in tests]
    pressure = np.stack(
        [t["pressure_kPa"].to_numpy(np.float64)[i] for t, i in zip(tests, steps, strict=True)]
    )
    known = rows["curvature_sd_per_m"].fillna(0.0) if "curvature_sd_per_m" in rows else None
    return _Plan(
        rows,
        first["specimen_id"],
        _conditions(tests, steps, pressure),
        first["degradation_sd_pct"].to_numpy(np.float64)[:, None],
        np.arange(size) < np.array([[len(test)] for test in tests]),
        np.zeros(len(rows)) if known is None else known.to_numpy(np.float64),
    )


def _conditions(
    tests: list[pd.DataFrame], steps: list[npt.NDArray[np.intp]], pressure: Floats
) -> Conditions:
    def recorded(name: str, default: object) -> npt.NDArray[np.generic]:
        return np.stack(
            [
                (t[name].to_numpy() if name in t else np.full(len(t), default))[i]
                for t, i in zip(tests, steps, strict=True)
            ]
        )

    return Conditions(
        pressure,
        np.array([[float(t["degradation_pct"].iloc[0])] for t in tests]),
        time=recorded("time_s", np.nan).astype(np.float64),
        cycle=recorded("cycle", 1).astype(np.int64),
        unloading=recorded("branch", "loading") == "unloading",
        humidity=recorded("humidity_pct", np.nan).astype(np.float64),
        mount=recorded("mount", "horizontal").astype(str),
    )


def _drawn(
    plan: _Plan, truth: Truth, effects: Sequence[HiddenEffect], generator: np.random.Generator
) -> pd.DataFrame:
    state = Degradation(plan.conditions.degradation, plan.degradation_sd)
    for hidden in effects:
        if hidden.cause.on_degradation is not None:
            state = hidden.cause.on_degradation(state, plan.conditions, hidden.effect)
    count = len(plan.names)
    value, sd = (np.broadcast_to(v, (1, count, 1))[0, :, 0] for v in (state.value, state.sd))
    drawn = draw_specimens(plan.names, truth, degradation=value, sd=sd, generator=generator)
    return _weakened(drawn, truth, effects)


def _weakened(
    specimens: pd.DataFrame, truth: Truth, effects: Sequence[HiddenEffect]
) -> pd.DataFrame:
    """Return specimens whose elongation limits are what the hidden effects leave of them."""
    acting = [hidden for hidden in effects if hidden.cause.on_strength is not None]
    if not acting:
        return specimens
    level = specimens["degradation_pct"].to_numpy()[None]
    median = truth.limit_stretch(level) - 1.0
    strength = Strength(median, np.full(level.shape, truth.elongation_scatter))
    elongation = specimens["limit_stretch"].to_numpy() - 1.0
    z = np.log(elongation / median) / np.maximum(strength.scatter, 1e-12)
    for hidden in acting:
        assert hidden.cause.on_strength is not None
        effect = {name: size[..., 0] for name, size in hidden.effect.items()}
        strength = hidden.cause.on_strength(strength, level, effect)
    limit = 1.0 + strength.median * np.exp(strength.scatter * z)
    return specimens.assign(limit_stretch=limit[0])


def _predict(
    plan: _Plan,
    truth: Truth,
    effects: Sequence[HiddenEffect],
    forward: ForwardMap,
    constants: Floats,
) -> Prediction:
    c1, c2, c3 = (constants[None, :, i, None] for i in range(3))
    inputs = Inputs(
        pressure=plan.conditions.pressure,
        c1=c1,
        c2=c2,
        c3=c3,
        linear_scale=np.full((1, 1, 1), np.cbrt(truth.volume_ratio)),
        paper_stiffness=np.full((1, 1, 1), truth.paper_stiffness),
        paper_thickness=np.full((1, 1, 1), truth.paper_thickness),
    )
    for hidden in effects:
        if hidden.cause.on_inputs is not None:
            inputs = hidden.cause.on_inputs(inputs, plan.conditions, hidden.effect)
    prediction = forward(inputs)
    for hidden in effects:
        if hidden.cause.on_reading is not None:
            prediction = hidden.cause.on_reading(prediction, plan.conditions, hidden.effect)
    return _without_walkers(prediction, plan.mask.shape)


def _without_walkers(prediction: Prediction, shape: tuple[int, ...]) -> Prediction:
    def only(values: Floats) -> Floats:
        return np.broadcast_to(values, (1, *shape)).reshape(shape)

    return Prediction(
        only(prediction.curvature),
        only(prediction.bend_angle),
        only(prediction.peak_stretch),
        only(prediction.slope),
        only(prediction.sd),
        only(prediction.bend_angle_sd),
        only(prediction.peak_stretch_sd),
        np.broadcast_to(prediction.status, (1, *shape)).reshape(shape),
    )


def _read(
    plan: _Plan,
    truth: Truth,
    prediction: Prediction,
    specimens: pd.DataFrame,
    generator: np.random.Generator,
) -> pd.DataFrame:
    limit = specimens["limit_stretch"].to_numpy()[:, None]
    burst = (prediction.status != int(Status.CONVERGED)) | (prediction.peak_stretch > limit)
    reached = (np.cumsum(burst, axis=1) - burst == 0)[plan.mask]
    over = burst[plan.mask]
    curvature, angle = prediction.curvature[plan.mask], prediction.bend_angle[plan.mask]
    counted = plan.rows["pressure_kPa"].to_numpy() != 0.0
    floor = np.hypot(truth.curvature_noise_floor, plan.known_sd)
    z, y = _normals(plan.rows, truth, generator)
    error = noise(curvature, z, floor=floor, share=truth.curvature_noise)
    slip = noise(angle, y, floor=truth.bend_angle_noise_floor, share=truth.bend_angle_noise)
    readings = plan.rows.assign(
        curvature_per_m=np.where(over, np.nan, curvature + counted * error).round(4),
        bend_angle_deg=np.where(over, np.nan, angle + counted * slip).round(3),
        ruptured=over.astype(np.int64),
    )
    kept: pd.DataFrame = readings.loc[reached]
    return kept.reset_index(drop=True)


def _normals(
    rows: pd.DataFrame, truth: Truth, generator: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw the errors of curvature and bend angle in their standard deviations, each (n,).

    Both are alike along the path of pressure, and correlated in one picture.
    """
    specimen = rows["specimen_id"]
    steps = rows["pressure_kPa"].groupby(specimen, sort=False).diff().abs().fillna(0.0)
    place = steps.groupby(specimen, sort=False).cumsum().to_numpy(np.float64)
    z, u = (
        alike_along(
            place,
            generator.standard_normal(len(rows)),
            specimen=specimen.to_numpy(str),
            length=truth.curvature_noise_length,
        )
        for _ in range(2)
    )
    c = truth.reading_correlation
    return z, c * z + np.sqrt(1.0 - c**2) * u
