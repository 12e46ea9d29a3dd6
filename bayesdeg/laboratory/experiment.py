"""A complete virtual experiment: films and actuators tested on one truth.

Causes are applied as in `bayesdeg.inference.model`, but to the truth.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.actuator.demand import demanded, scatter_law
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import Asked, ForwardMap, Further, Inputs, Prediction
from bayesdeg.actuator.status import Status
from bayesdeg.causes.catalogue import in_order
from bayesdeg.causes.cause import (
    Conditions,
    Degradation,
    FilmConditions,
    StrengthConditions,
)
from bayesdeg.causes.fold import Acting, applied
from bayesdeg.data.batches import batch_numbers, batch_order
from bayesdeg.data.moisture import mass_loss_from_degradation, saturating
from bayesdeg.data.settings import Mixture, RuptureCriterion
from bayesdeg.data.shrinkage import film_volume
from bayesdeg.data.study import Study
from bayesdeg.data.tables import BASE_TABLES, Table
from bayesdeg.errors import BayesdegError
from bayesdeg.laboratory.truth import (
    HiddenEffect,
    Truth,
    constants_of,
    correlate_along,
    draw_specimens,
    noise,
    significant,
    stated_sd,
)
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.material.strength import ScatterLaw, Strength
from bayesdeg.observations.force import TABLE as TIP_FORCES

VIRTUAL_TABLES: Mapping[str, Table] = MappingProxyType(
    {name: table for name, table in BASE_TABLES.items() if name != "summary"}
    | {TIP_FORCES.name: TIP_FORCES}
)
"""Tables of a virtual experiment; published statistics are never virtual."""

LEVELS = (0, 5, 10, 15, 20, 25)
REPLICATES = 3
PRESSURES = np.arange(20.0, 241.0, 20.0)
STRETCH_POINTS = 15
LARGEST_SHARE = 0.97  # the last reading of a tensile curve is taken just before the break
TIMES = (0, 4, 8, 12, 16, 20, 24)
FILMS_A_TIME = 9
SHRINKAGE_FILMS = 4

SPECIMEN = ("specimen_id", "degradation_pct", "degradation_sd_pct")
_SCHEDULE = ("cycle", "branch")
_ERRORS = ("curvature_sd_per_m", "bend_angle_sd_deg")
_ROOM = ("temperature_C", "batch")  # optional columns of films and actuators
_CONDITIONS = (*_ERRORS, "time_s", *_SCHEDULE, "humidity_pct", "mount", *_ROOM)


def _specimens(prefix: str) -> pd.DataFrame:
    pairs = [(level, copy) for level in LEVELS for copy in range(1, REPLICATES + 1)]
    return pd.DataFrame(
        {
            "specimen_id": [f"{prefix}{level:02d}-{copy}" for level, copy in pairs],
            "degradation_pct": [float(level) for level, _ in pairs],
            "degradation_sd_pct": np.nan,
        }
    )


def _tensile() -> pd.DataFrame:
    share = LARGEST_SHARE * np.arange(1, STRETCH_POINTS + 1) / STRETCH_POINTS
    points = pd.DataFrame(
        {"mode": "uniaxial", "elongation_share": share, "stress_measure": "nominal"}
    )
    return _specimens("F").merge(points, how="cross")


def _moisture() -> pd.DataFrame:
    pairs = [(time, film) for time in TIMES for film in range(1, FILMS_A_TIME + 1)]
    names = [f"M{time:02d}-{film}" for time, film in pairs]
    return pd.DataFrame({"film_id": names, "time_h": [float(time) for time, _ in pairs]})


class Breaking(NamedTuple):
    """Rupture of walls.

    Parameters
    ----------
    criterion : str
        Measure of a wall's state compared with the films' elongation at break.
    size_ratio : float
        Volume of an actuator as moulded over that of a tested film [–].
    """

    criterion: RuptureCriterion = "principal_stretch"
    size_ratio: float = 1.0


BY_STRETCH = Breaking()


@dataclass(frozen=True)
class Design:
    """Tests and their settings; the defaults are those of Nagai et al.

    Parameters
    ----------
    actuator : pandas.DataFrame
        One row per reading: ``specimen_id``, ``degradation_pct``, ``degradation_sd_pct`` (nan to
        use the truth's), ``pressure_kPa``, and the optional columns of ``actuator.csv`` to be
        recorded. Rows of a specimen are in test order. Default: 6 levels of degradation, 3
        actuators each, 20 to 240 kPa in steps of 20 kPa.
    tensile : pandas.DataFrame
        One row per reading: the columns of the specimen, ``mode``, ``stress_measure``, and either
        ``stretch`` or ``elongation_share``, the share of the specimen's own elongation at break.
        Default: 3 films per level, 15 readings up to 97 % of the elongation at break.
    breaks : pandas.DataFrame
        One row per specimen; one also in ``tensile`` is the same film. Default: those.
    moisture : pandas.DataFrame
        ``film_id``, ``time_h``. Default: 9 films each after 0, 4, …, 24 h.
    shrinkage : pandas.DataFrame
        ``film_id``. Default: 4 films.
    mixture : Mixture
        Mixture of the films of ``shrinkage``.
    bend_angle, cavity_volume : bool
        Whether bend angle and cavity volume are read together with the curvature.
    breaking : Breaking
        Rupture of walls.
    force : pandas.DataFrame, optional
        One row per reading of a blocked tip force, with the columns of ``actuator``, on separate
        specimens. Default: none.

    References
    ----------
    Nagai, Kurita, Shintake (2021), Front. Robot. AI 8:760485; doi:10.3389/frobt.2021.760485.

    Examples
    --------
    >>> design = Design()
    >>> len(design.actuator), len(design.tensile), len(design.breaks), len(design.moisture)
    (216, 270, 18, 63)
    """

    actuator: pd.DataFrame = field(
        default_factory=lambda: _specimens("A").merge(
            pd.DataFrame({"pressure_kPa": PRESSURES}), how="cross"
        )
    )
    tensile: pd.DataFrame = field(default_factory=_tensile)
    breaks: pd.DataFrame = field(default_factory=lambda: _specimens("F"))
    moisture: pd.DataFrame = field(default_factory=_moisture)
    shrinkage: pd.DataFrame = field(
        default_factory=lambda: pd.DataFrame(
            {"film_id": [f"S{film}" for film in range(1, SHRINKAGE_FILMS + 1)]}
        )
    )
    mixture: Mixture = field(default_factory=Mixture)
    bend_angle: bool = True
    cavity_volume: bool = False
    breaking: Breaking = BY_STRETCH
    force: pd.DataFrame | None = None

    @property
    def scatter_law(self) -> ScatterLaw:
        """Scatter law of the elongation at break between specimens."""
        return scatter_law(self.breaking.criterion)


def design_of(study: Study) -> Design:
    """Return the design of a study.

    Tests without a table in the study follow the default design; films of its tensile tests are
    also broken if it has no ``break.csv``. Specimens that burst get the readings that they would
    have had: those of the longest test that begins with theirs.

    Examples
    --------
    >>> from pathlib import Path
    >>> table = pd.DataFrame({"film_id": ["a", "b"], "time_h": [0.0, 7.0]})
    >>> design_of(Study("s", Path("s"), moisture=table)).moisture["time_h"].tolist()
    [0.0, 7.0]
    """

    def noted(
        name: str, frame: pd.DataFrame, columns: Sequence[str], optional: Sequence[str]
    ) -> pd.DataFrame:
        recorded = study.recorded.get(name, frozenset())
        also = [column for column in optional if column in recorded]
        chosen = frame[[*SPECIMEN, *columns, *also]].reset_index(drop=True)
        if "degradation_sd_pct" in recorded:
            return chosen
        return chosen.assign(degradation_sd_pct=np.nan)

    pressures, force = ("pressure_kPa",), study.table(TIP_FORCES.name)
    usual = Design()
    actuator, tensile = usual.actuator, usual.tensile
    if study.actuator is not None:
        tests = [test for _, test in study.actuator.groupby("specimen_id", sort=False)]
        whole = pd.concat([_with_rest(test, tests) for test in tests], ignore_index=True)
        actuator = noted("actuator", whole, pressures, _CONDITIONS)
    if study.tensile is not None:
        tensile = noted("tensile", study.tensile, ("mode", "stretch", "stress_measure"), _ROOM)
    if study.breaks is not None:
        breaks = noted("breaks", study.breaks, (), ())
    else:
        uniaxial = tensile.loc[tensile["mode"] == "uniaxial", list(SPECIMEN)]
        breaks = uniaxial.drop_duplicates("specimen_id").reset_index(drop=True)
    if force is not None:
        force = noted(TIP_FORCES.name, force, pressures, _CONDITIONS)
    moisture, shrinkage = usual.moisture, usual.shrinkage
    if study.moisture is not None:
        moisture = study.moisture[["film_id", "time_h"]].reset_index(drop=True)
    if study.shrinkage is not None:
        shrinkage = study.shrinkage[["film_id"]].reset_index(drop=True)
    recorded = study.recorded.get("actuator", frozenset())
    return Design(
        actuator=actuator,
        tensile=tensile,
        breaks=breaks,
        moisture=moisture,
        shrinkage=shrinkage,
        mixture=study.settings.shrinkage.mixture,
        bend_angle=study.actuator is None or "bend_angle_deg" in recorded,
        cavity_volume="cavity_volume_ml" in recorded,
        breaking=Breaking(
            study.settings.rupture.criterion,
            geometry_of_study(study.settings).volume / study.settings.rupture.film_volume,
        ),
        force=force,
    )


def _with_rest(test: pd.DataFrame, tests: list[pd.DataFrame]) -> pd.DataFrame:
    """Return a test with the readings after a burst, of the longest one that begins alike."""
    if test["ruptured"].iloc[-1] != 1:
        return test
    steps = ["pressure_kPa", *_SCHEDULE]
    done = test[steps].to_numpy()
    alike = [other for other in tests if np.array_equal(other[steps].to_numpy()[: len(test)], done)]
    rest = max(alike, key=len).iloc[len(test) :]
    same = {column: test[column].iloc[0] for column in SPECIMEN}
    return pd.concat([test, rest.assign(**same)]) if len(rest) else test


Floats = npt.NDArray[np.float64]

DRY_MASS = 2.0  # of an undegraded film [g]
DRY_MASS_SCATTER = 0.05
MASS_POURED = 30.0  # stated by the source [g]
MASS_POURED_SCATTER = 0.01
VOLUME_RATIO_RANGE = (0.32, 0.99)  # a film neither gains volume nor exceeds its poured volume


def weigh_moisture(
    table: pd.DataFrame, truth: Truth, generator: np.random.Generator
) -> pd.DataFrame:
    r"""Weigh unearthed films, moist and dry.

    .. math:: M_C = M_{C0} (1 - D_R(t)/100) + \sigma z, \quad M_0 = M_d / (1 - M_C/100)

    The dry mass falls with the degradation rate by Eq. 6 of doi:10.3389/frobt.2021.760485.

    From ``film_id`` and ``time_h`` to the columns of ``moisture.csv``.
    """
    z = generator.standard_normal((2, len(table)))
    time = table["time_h"].to_numpy(np.float64)
    rate = saturating(time, truth.degradation_limit, truth.time_constant)
    content = truth.moisture_initial * (1.0 - rate / 100.0) + truth.moisture_scatter * z[0]
    lost = mass_loss_from_degradation(rate, moisture_initial_pct=truth.moisture_initial)
    dry = DRY_MASS * np.exp(DRY_MASS_SCATTER * z[1]) * (1.0 - lost / 100.0)
    moist = dry / (1.0 - content / 100.0)
    return table.assign(mass_equilibrated_g=moist.round(4), mass_dry_g=dry.round(4))


def weigh_shrinkage(
    table: pd.DataFrame,
    truth: Truth,
    generator: np.random.Generator,
    mixture: Mixture | None = None,
) -> pd.DataFrame:
    r"""Weigh films when poured, cured and conditioned.

    A conditioned film contains as much water as undegraded films; the cured one had the volume
    :math:`V_1 = V_2/\alpha`, and has lost only water since.

    From ``film_id`` to the columns of ``shrinkage.csv``; by default of the mixture 2 : 1 : 8.
    """
    z = generator.standard_normal((3, len(table)))
    mixture = mixture or Mixture()
    poured = MASS_POURED * np.exp(MASS_POURED_SCATTER * z[0])
    moisture = truth.moisture_initial + truth.moisture_scatter * z[1]
    ratio = np.clip(truth.volume_ratio + truth.volume_ratio_scatter * z[2], *VOLUME_RATIO_RANGE)
    solids = poured * mixture.solids
    conditioned = solids / (1.0 - moisture / 100.0)
    volume = film_volume(poured, conditioned, mixture)
    cured = conditioned + mixture.water_density * volume * (1.0 / ratio - 1.0)
    return table.assign(
        mass_poured_g=poured.round(4),
        mass_cured_g=cured.round(4),
        mass_conditioned_g=conditioned.round(4),
    )


def tear_films(
    design: Design,
    truth: Truth,
    generator: np.random.Generator,
    effects: Sequence[HiddenEffect] = (),
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Stretch films until they break.

    Parameters
    ----------
    design : Design
        Its ``tensile`` and ``breaks``; a specimen in both is one film.
    truth : Truth
        Material, scatter, reading errors.
    effects : sequence of HiddenEffect
        Effects hidden in the stresses, in the order of application.

    Returns
    -------
    tensile, breaks, films : pandas.DataFrame
        The columns of ``tensile.csv`` and ``break.csv``, and the true films. Uniaxial readings at
        or above a film's own limit are missing.
    """
    columns = list(SPECIMEN)
    both = pd.concat([design.tensile[columns], design.breaks[columns]])
    both = both.drop_duplicates("specimen_id")
    films = draw_specimens(
        both["specimen_id"],
        truth,
        degradation=both["degradation_pct"].to_numpy(np.float64),
        sd=stated_sd(both, truth),
        generator=generator,
        law=design.scatter_law,
    )
    limit = films["limit_stretch"].loc[design.breaks["specimen_id"]].to_numpy()
    breaks = design.breaks[columns].assign(
        degradation_sd_pct=stated_sd(design.breaks, truth),
        elongation_pct=(100.0 * (limit - 1.0)).round(2),
    )
    batches = batch_order(design.tensile, design.actuator)
    tensile = _stretch(design.tensile, films, truth, generator, effects=effects, batches=batches)
    return tensile, breaks, films


def _stretch(
    table: pd.DataFrame,
    films: pd.DataFrame,
    truth: Truth,
    generator: np.random.Generator,
    *,
    effects: Sequence[HiddenEffect],
    batches: Sequence[str],
) -> pd.DataFrame:
    limit = films["limit_stretch"].loc[table["specimen_id"]].to_numpy()
    if "stretch" in table:
        stretch = table["stretch"].to_numpy(np.float64)
    else:
        stretch = 1.0 + table["elongation_share"].to_numpy(np.float64) * (limit - 1.0)
    stretch = stretch.round(4)
    mode, measure = table["mode"].to_numpy(str), table["stress_measure"].to_numpy(str)
    where = films.index.get_indexer(pd.Index(table["specimen_id"]))
    constants = constants_of(films, truth)[where]
    stress = np.sum(yeoh_basis(stretch, mode, measure) * constants, axis=-1)
    level = films["degradation_pct"].to_numpy()[where]
    names = table["specimen_id"].astype(str)
    temperature: Floats = np.full(len(table), np.nan)
    if "temperature_C" in table:
        temperature = table["temperature_C"].to_numpy(np.float64)
    batch_of = dict(zip(names.drop_duplicates(), batch_numbers(table, batches), strict=True))
    tests = FilmConditions(
        stretch[:, None],
        mode,
        measure[:, None] == "cauchy",
        level,
        temperature,
        names.map(batch_of).to_numpy(np.int64),
    )
    column = stress[None, :, None]
    stress = applied("on_stress", column, tests, _acting(effects), constants[None])[0, :, 0]
    z = correlate_along(
        stretch,
        generator.standard_normal(stress.shape),
        specimen=[f"{name} {kind}" for name, kind in zip(table["specimen_id"], mode, strict=True)],
        length=truth.tensile_noise_length,
    )
    stress += noise(stress, z, floor=truth.tensile_noise_floor, share=truth.tensile_noise)
    read = table[list(SPECIMEN)].assign(
        degradation_sd_pct=stated_sd(table, truth),
        mode=mode,
        stretch=stretch,
        stress_MPa=significant(stress, 5),
        stress_measure=measure,
        **{column: table[column] for column in _ROOM if column in table},
    )
    whole = (mode != "uniaxial") | (stretch < limit)
    kept: pd.DataFrame = read.loc[whole]
    return kept.reset_index(drop=True)


class _Plan(NamedTuple):
    """The rows of the design ordered by specimen, and as specimens by steps."""

    rows: pd.DataFrame
    names: pd.Series
    conditions: Conditions
    degradation_sd: Floats
    mask: npt.NDArray[np.bool_]


def inflate_actuators(
    table: pd.DataFrame,
    truth: Truth,
    generator: np.random.Generator,
    *,
    effects: Sequence[HiddenEffect],
    forward: ForwardMap,
    breaking: Breaking = BY_STRETCH,
    cavity_volume: bool = False,
    batches: Sequence[str] = (),
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Inflate actuators and read curvature and bend angle.

    A specimen bursts at the first pressure at which its peak stretch exceeds its own limit stretch,
    or for which the forward map finds no equilibrium; nothing is read from there on. A reading at
    zero pressure has no error, since curvature is relative to it.

    Parameters
    ----------
    table : pandas.DataFrame
        ``Design.actuator``.
    truth : Truth
        Material, scatter, reading errors.
    generator : numpy.random.Generator
        Random generator; the number of draws depends on the design only.
    effects : sequence of HiddenEffect
        Hidden effects, in the order of application.
    forward : ForwardMap
        The mechanics; its own standard error is not added.
    breaking : Breaking
        Definition of the peak stretch.
    cavity_volume : bool
        Whether the volume of the cavity is read too.
    batches : sequence of str
        From `bayesdeg.data.batches.batch_order`.

    Returns
    -------
    readings, specimens : pandas.DataFrame
        The columns of ``actuator.csv``, and the true actuators, with ``status`` of their solution.
    """
    plan = _plan(table, truth, batches)
    asked: Asked = "cavity_volume" if cavity_volume else ""
    tested = _tested(plan, truth, effects, forward, generator, breaking=breaking, asked=asked)
    found = tested.prediction
    swept = None if found.further is None else found.further.value
    bent = Bent(found.curvature, found.bend_angle, tested.burst, swept)
    return read_actuators(table, truth, bent, generator), _with_status(tested)


class _Tested(NamedTuple):
    """True specimens, their responses, and where a wall breaks."""

    specimens: pd.DataFrame
    prediction: Prediction
    burst: npt.NDArray[np.bool_]


def _tested(
    plan: _Plan,
    truth: Truth,
    effects: Sequence[HiddenEffect],
    forward: ForwardMap,
    generator: np.random.Generator,
    *,
    breaking: Breaking,
    asked: Asked,
) -> _Tested:
    """Draw the specimens of a plan and inflate them."""
    law, causes = scatter_law(breaking.criterion), _acting(effects)
    state = Degradation(plan.conditions.degradation, plan.degradation_sd)
    state = applied("on_degradation", state, plan.conditions, causes)
    believed, sd = (
        np.broadcast_to(v, (1, len(plan.names), 1))[0, :, 0] for v in (state.value, state.sd)
    )
    specimens = draw_specimens(
        plan.names, truth, degradation=believed, sd=sd, generator=generator, law=law
    )
    specimens = _weakened(specimens, truth, effects, plan.conditions.room_humidity, law)
    constants = constants_of(specimens, truth)
    c1, c2, c3 = (constants[None, :, i, None] for i in range(3))
    inputs = Inputs(
        pressure=plan.conditions.pressure,
        c1=c1,
        c2=c2,
        c3=c3,
        linear_scale=np.full((1, 1, 1), np.cbrt(truth.volume_ratio)),
        paper_stiffness=np.full((1, 1, 1), truth.paper_stiffness),
        paper_thickness=np.full((1, 1, 1), truth.paper_thickness),
        asked=asked,
    )
    prediction = demanded(
        forward,
        applied("on_inputs", inputs, plan.conditions, causes),
        breaking.criterion,
        scatter=np.array(truth.elongation_scatter),
        size_ratio=breaking.size_ratio,
    )
    prediction = applied("on_reading", prediction, plan.conditions, causes)
    prediction = _without_walkers(prediction, plan.mask.shape)
    limit = specimens["limit_stretch"].to_numpy()[:, None]
    burst = (prediction.status != int(Status.CONVERGED)) | (prediction.peak_stretch > limit)
    return _Tested(specimens, prediction, burst)


def _with_status(tested: _Tested) -> pd.DataFrame:
    worst = [Status(int(status)).name.lower() for status in tested.prediction.status.max(axis=1)]
    return tested.specimens.assign(status=worst)


def press_tips(
    table: pd.DataFrame,
    truth: Truth,
    generator: np.random.Generator,
    *,
    effects: Sequence[HiddenEffect],
    forward: ForwardMap,
    breaking: Breaking = BY_STRETCH,
    batches: Sequence[str] = (),
) -> tuple[pd.DataFrame, pd.DataFrame]:
    r"""Inflate actuators with held tips, and read the force.

    .. math:: y = g F + \sqrt{f^2 + (s\,g F)^2}\; z

    with g ``force_gain``, f ``force_noise_floor`` [N], s ``force_noise`` and z correlated along the
    path of pressure like errors of curvature: the law of `bayesdeg.observations.force.HeldTip`. A
    reading at zero pressure has no error.

    A specimen's test ends below the pressure at which it would burst with a free tip, or at which
    no equilibrium is found. A held tip strains the walls by some 6 % less on the one mesh examined,
    a coarse one (5 to 7 %, fresh and at 25 %).

    Parameters
    ----------
    table : pandas.DataFrame
        ``Design.force``.
    forward : ForwardMap
        The mechanics, including ``tip_force``.
    truth, generator, effects, breaking, batches
        As in `inflate_actuators`.

    Returns
    -------
    readings, specimens : pandas.DataFrame
        The columns of ``force.csv``, and the true actuators, with ``status`` of their solution:
        that of the free tip, or ``held_tip_not_reached``.

    Raises
    ------
    BayesdegError
        If the forward map does not predict tip forces.
    """
    plan = _plan(table, truth, batches)
    tested = _tested(plan, truth, effects, forward, generator, breaking=breaking, asked="tip_force")
    further = tested.prediction.further
    if further is None:
        raise BayesdegError("the forward map of this experiment does not predict tip forces")
    over = tested.burst | ~np.isfinite(further.value)
    held = ~np.logical_or.accumulate(over, axis=1)[plan.mask]
    force = truth.force_gain * further.value[plan.mask]
    z, _ = _normals(plan.rows, truth, generator)
    floor = np.full(len(plan.rows), truth.force_noise_floor)
    error = noise(force, z, floor=floor, share=truth.force_noise)
    counted = plan.rows["pressure_kPa"].to_numpy() != 0.0
    readings = plan.rows.assign(tip_force_N=(force + counted * error).round(5))
    kept: pd.DataFrame = readings.loc[held]
    lost = np.any(~np.isfinite(further.value) & ~tested.burst, axis=1)
    real = _with_status(tested)
    real["status"] = real["status"].mask(lost, "held_tip_not_reached")
    return kept.reset_index(drop=True), real


class Bent(NamedTuple):
    """Responses of actuators at each step of their tests, each (n_specimens, n_steps).

    Parameters
    ----------
    curvature, angle : array
        Without reading errors [1/m, °].
    burst : array of bool
        Whether a wall breaks at that pressure.
    volume : array, optional
        Cavity volume minus that at zero pressure [ml].
    """

    curvature: Floats
    angle: Floats
    burst: npt.NDArray[np.bool_]
    volume: Floats | None = None


def read_actuators(
    table: pd.DataFrame, truth: Truth, bent: Bent, generator: np.random.Generator
) -> pd.DataFrame:
    """Read actuators bent by separate physics, up to their rupture.

    ``table`` is as in `inflate_actuators`; of the truth only the reading errors count; ``bent`` has
    the specimens in the order of first appearance in the table. Returned are the columns of
    ``actuator.csv``.
    """
    plan = _plan(table, truth)
    reached = (np.cumsum(bent.burst, axis=1) - bent.burst == 0)[plan.mask]
    over, curvature, angle = bent.burst[plan.mask], bent.curvature[plan.mask], bent.angle[plan.mask]
    counted = plan.rows["pressure_kPa"].to_numpy() != 0.0
    known, known_angle = (
        plan.rows[name].fillna(0.0).to_numpy(np.float64) if name in plan.rows else 0.0
        for name in _ERRORS
    )
    floor = np.hypot(truth.curvature_noise_floor, known)
    angle_floor = np.hypot(truth.bend_angle_noise_floor, known_angle)
    z, y = _normals(plan.rows, truth, generator)
    error = noise(curvature, z, floor=floor, share=truth.curvature_noise)
    slip = noise(angle, y, floor=angle_floor, share=truth.bend_angle_noise)
    readings = plan.rows.assign(
        curvature_per_m=np.where(over, np.nan, curvature + counted * error).round(4),
        bend_angle_deg=np.where(over, np.nan, angle + counted * slip).round(3),
        ruptured=over.astype(np.int64),
    )
    if bent.volume is not None:
        swept = bent.volume[plan.mask]
        z, _ = _normals(plan.rows, truth, generator)  # after those of curvature and angle
        at_rest = np.full(len(plan.rows), truth.volume_noise_floor)
        swept = swept + counted * noise(swept, z, floor=at_rest, share=truth.volume_noise)
        readings = readings.assign(cavity_volume_ml=np.where(over, np.nan, swept).round(5))
    kept: pd.DataFrame = readings.loc[reached]
    return kept.reset_index(drop=True)


def _plan(table: pd.DataFrame, truth: Truth, batches: Sequence[str] = ()) -> _Plan:
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

    def recorded(name: str, default: object) -> npt.NDArray[np.generic]:
        return np.stack(
            [
                (t[name].to_numpy() if name in t else np.full(len(t), default))[i]
                for t, i in zip(tests, steps, strict=True)
            ]
        )

    conditions = Conditions(
        pressure,
        np.array([[float(t["degradation_pct"].iloc[0])] for t in tests]),
        time=recorded("time_s", np.nan).astype(np.float64),
        cycle=recorded("cycle", 1).astype(np.int64),
        unloading=recorded("branch", "loading") == "unloading",
        humidity=recorded("humidity_pct", np.nan).astype(np.float64),
        mount=recorded("mount", "horizontal").astype(str),
        temperature=recorded("temperature_C", np.nan).astype(np.float64),
        batch=batch_numbers(rows, batches)[:, None],
    )
    return _Plan(
        rows,
        first["specimen_id"],
        conditions,
        first["degradation_sd_pct"].to_numpy(np.float64)[:, None],
        np.arange(size) < np.array([[len(test)] for test in tests]),
    )


def _acting(effects: Sequence[HiddenEffect]) -> tuple[Acting, ...]:
    return tuple(Acting(hidden.cause, hidden.effect) for hidden in effects)


def _weakened(
    specimens: pd.DataFrame,
    truth: Truth,
    effects: Sequence[HiddenEffect],
    humidity: Floats,
    law: ScatterLaw,
) -> pd.DataFrame:
    """Return specimens with elongation limits reduced by the hidden effects."""
    acting = [hidden for hidden in effects if hidden.cause.on_strength is not None]
    if not acting:
        return specimens
    level = specimens["degradation_pct"].to_numpy()[None]
    median = truth.limit_stretch(level) - 1.0
    scatter = max(truth.elongation_scatter, 1e-12)  # for identical walls
    strength = Strength(median, np.full(level.shape, scatter), law)
    elongation = specimens["limit_stretch"].to_numpy() - 1.0
    z = np.log(elongation / median) / scatter
    flat = (
        Acting(one.cause, {name: size[..., 0] for name, size in one.effect.items()})
        for one in acting
    )
    conditions = StrengthConditions(level, humidity, truth.elongation_slope(level))
    strength = applied("on_strength", strength, conditions, flat)
    return specimens.assign(limit_stretch=1.0 + strength.limit(z)[0])


def _without_walkers(prediction: Prediction, shape: tuple[int, ...]) -> Prediction:
    def only(values: Floats) -> Floats:
        return np.broadcast_to(values, (1, *shape)).reshape(shape)

    further = prediction.further
    fields = vars(prediction).items()
    read: dict[str, Any] = {n: only(v) for n, v in fields if n not in ("excess", "further")}
    swept = None if further is None else Further(*map(only, vars(further).values()))
    return Prediction(**read, further=swept)


def _normals(
    rows: pd.DataFrame, truth: Truth, generator: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw the errors of curvature and bend angle in their standard deviations, each (n,).

    Both are correlated along the path of pressure, and with each other in a picture.
    """
    specimen = rows["specimen_id"]
    steps = rows["pressure_kPa"].groupby(specimen, sort=False).diff().abs().fillna(0.0)
    place = steps.groupby(specimen, sort=False).cumsum().to_numpy(np.float64)
    z, u = (
        correlate_along(
            place,
            generator.standard_normal(len(rows)),
            specimen=specimen.to_numpy(str),
            length=truth.curvature_noise_length,
        )
        for _ in range(2)
    )
    c = truth.reading_correlation
    return z, c * z + np.sqrt(1.0 - c**2) * u


@dataclass(frozen=True)
class VirtualExperiment:
    """Records of a virtual experiment, and the truth.

    Parameters
    ----------
    tables : mapping of str to pandas.DataFrame
        By name as in `VIRTUAL_TABLES`, with the columns of the files, rounded as
        recorded.
    truth : Truth
        The material and the errors.
    effects : tuple of HiddenEffect
        Hidden effects.
    actuators, films : pandas.DataFrame
        True values by ``specimen_id``: ``degradation_pct``, ``ln_stiffness``, ``limit_stretch``;
        for actuators also ``status`` of their solution.
    blocked : pandas.DataFrame, optional
        The same for actuators with held tips, which are separate specimens.
    """

    tables: Mapping[str, pd.DataFrame]
    truth: Truth
    effects: tuple[HiddenEffect, ...]
    actuators: pd.DataFrame
    films: pd.DataFrame
    blocked: pd.DataFrame | None = None


Inflate = Callable[[np.random.Generator], tuple[pd.DataFrame, pd.DataFrame]]


def run_experiment(
    design: Design,
    truth: Truth,
    *,
    forward: ForwardMap,
    generator: np.random.Generator,
    effects: Sequence[HiddenEffect] = (),
) -> VirtualExperiment:
    """Run every test of a design.

    Each kind of test has its own random stream, so that with one seed films and errors are the same
    whatever is hidden.

    Parameters
    ----------
    design : Design
        The tests.
    truth : Truth
        The true material and errors.
    forward : ForwardMap
        The mechanics, called once for all actuators; the fine finite element model if the
        experiment replaces a real one.
    effects : sequence of HiddenEffect
        Effects hidden in actuators and in the stresses of films.
    """
    by_name = {hidden.cause.name: hidden for hidden in effects}
    ordered = tuple(by_name[c.name] for c in in_order(h.cause for h in by_name.values()))
    batches = batch_order(design.tensile, design.actuator)

    inflate = partial(
        inflate_actuators,
        *(design.actuator, truth),
        effects=ordered,
        forward=forward,
        breaking=design.breaking,
        cavity_volume=design.cavity_volume,
        batches=batches,
    )
    press = None
    if design.force is not None:
        press = partial(
            press_tips,
            *(design.force, truth),
            effects=ordered,
            forward=forward,
            breaking=design.breaking,
            batches=batches,
        )
    return experiment_with(design, truth, inflate, generator, ordered, press=press)


def experiment_with(
    design: Design,
    truth: Truth,
    inflate: Inflate,
    generator: np.random.Generator,
    effects: tuple[HiddenEffect, ...] = (),
    *,
    press: Inflate | None = None,
) -> VirtualExperiment:
    """Run every test of a design, with actuators inflated by the caller.

    Parameters
    ----------
    design, truth, generator
        As in `run_experiment`.
    inflate : callable
        From a random generator to the columns of ``actuator.csv``, and the true actuators, as
        `inflate_actuators` returns them.
    effects : tuple of HiddenEffect
        Effects hidden in the stresses of films, in the order of application.
    press : callable, optional
        The same for ``force.csv``, as `press_tips` returns them; default: none.
    """
    tear, pressed, moisture, shrinkage = generator.spawn(4)
    tensile, breaks, films = tear_films(design, truth, tear, effects)
    actuator, actuators = inflate(pressed)
    if not design.bend_angle:
        actuator = actuator.drop(columns="bend_angle_deg")
    tables = {
        "moisture": weigh_moisture(design.moisture, truth, moisture),
        "shrinkage": weigh_shrinkage(design.shrinkage, truth, shrinkage, design.mixture),
        "tensile": tensile,
        "breaks": breaks,
        "actuator": actuator,
    }
    blocked = None
    if press is not None:
        [source] = generator.spawn(1)  # after all others, so that these do not change
        tables[TIP_FORCES.name], blocked = press(source)
    tables = {
        name: table[[column for column in VIRTUAL_TABLES[name].columns if column in table]]
        for name, table in tables.items()
    }
    return VirtualExperiment(tables, truth, effects, actuators, films, blocked)
