"""Studies with an effect hidden in them: which causes, how large, in which design of tests.

Everything is drawn anew for each study: material laws, specimens, degradation rates, errors of
reading that are alike along a curve, and what is hidden.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.laboratory.design import PRESSURES, Design
from bayesdeg.laboratory.effects import HiddenEffect
from bayesdeg.laboratory.experiment import VirtualExperiment, run_experiment
from bayesdeg.laboratory.truth import Truth, drawn_truth
from bayesdeg.laboratory.writing import Provenance, study_files
from bayesdeg.laws import Normal, Parameter
from bayesdeg.measure.settings import Settings

SIZES = (0.5, 1.0, 1.5, 2.0)
LARGEST_PRESSURE = 200.0  # kPa; beyond, soft draws of the material balloon
SOFTEST = 0.26  # C1 at 0 % [MPa]: actuators of softer ones are about to balloon at that pressure
HELD = {"1": 8.0, "2": 45.0, "3": 150.0}  # s at each pressure, by the number of the specimen
CYCLES, HUMIDITY = 2, 60.0
MOUNTS = {"1": "horizontal", "2": "hanging", "3": "bending_up"}
TRIES = 200
# sizes that count as 1; where typical ones are beyond what the default tests can show
USUAL: Mapping[str, Mapping[str, float]] = {
    "degraded_skin": {"skin_stiffening": 1.0},
    "erosion": {"lost_share": 0.15},
    "film_mismatch": {"log_ratio": 0.2},
    "pressure_loss": {"fraction": 0.15},
    "degradation_misread": {"shift": 3.0, "scatter": 0.5},
    "wall_thickness": {"excess": 0.08},
    "second_invariant": {"ratio": 0.4},
    "paper_slack": {"slack": 0.015},
    "initial_curvature": {"mismatch": 0.012},
}


@dataclass(frozen=True)
class HiddenStudy:
    """One study with its hidden effects.

    Parameters
    ----------
    number : int
        Of the study; all randomness comes from it and the seed.
    kind : str
        ``single``, ``pair``, ``none`` or ``outside``.
    design : str
        One of `DESIGNS`.
    effects : tuple of HiddenEffect
        What is hidden.
    size : float
        Over the usual size.
    """

    number: int
    kind: str
    design: str
    effects: tuple[HiddenEffect, ...]
    size: float

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what is hidden."""
        return tuple(hidden.cause.name for hidden in self.effects)


def _bare() -> Design:
    design = Design()
    return replace(
        design, actuator=design.actuator[design.actuator["pressure_kPa"] <= LARGEST_PRESSURE]
    )


def _history() -> Design:
    """Two cycles with unloading; specimens of a level are held for different times."""
    up = [float(p) for p in PRESSURES if p <= LARGEST_PRESSURE][::2]
    path = [("loading", p) for p in up] + [("unloading", p) for p in up[-2::-1]]
    rows = []
    for name, level in (
        Design().actuator[["specimen_id", "degradation_pct"]].drop_duplicates().to_numpy()
    ):
        held = HELD[str(name)[-1]]
        steps = [(cycle + 1, *step) for cycle in range(CYCLES) for step in path]
        rows += [
            {
                "specimen_id": name,
                "degradation_pct": level,
                "degradation_sd_pct": np.nan,
                "pressure_kPa": pressure,
                "time_s": held * (k + 1),
                "cycle": cycle,
                "branch": branch,
                "humidity_pct": HUMIDITY,
            }
            for k, (cycle, branch, pressure) in enumerate(steps)
        ]
    return replace(Design(), actuator=pd.DataFrame(rows))


def _mounts() -> Design:
    design = _bare()
    mount = design.actuator["specimen_id"].str[-1].map(MOUNTS)
    return replace(design, actuator=design.actuator.assign(mount=mount))


def designs() -> dict[str, Design]:
    """Return the designs by name: curvature alone, with bend angle, with history, with mounts."""
    return {
        "curvature": replace(_bare(), bend_angle=False),
        "angle": _bare(),
        "history": _history(),
        "mounts": _mounts(),
    }


ONLY_IN = {
    "creep": "history",
    "humidity_drift": "history",
    "mullins": "history",
    "gravity": "mounts",
}
REFUSED = ({"paper_slack", "initial_curvature"}, {"paper_slack", "gravity"})  # by the library
LEFT_OUT = ("flaw_embrittlement",)  # shows in ruptures, not in readings: tested on its own


def drawn_study(number: int, *, seed: int) -> HiddenStudy:
    """Draw what is hidden in a study: 60 % one cause, 15 % two, 15 % none, 10 % another effect."""
    generator = np.random.default_rng((seed, number))
    kind = str(generator.choice(["single", "pair", "none", "outside"], p=[0.6, 0.15, 0.15, 0.1]))
    if kind == "none":
        return HiddenStudy(number, kind, str(generator.choice(list(designs()))), (), 0.0)
    if kind == "outside":
        effect = _outside(generator)
        return HiddenStudy(
            number, kind, str(generator.choice(["curvature", "angle"])), (effect,), 1.0
        )
    names = [name for name in CATALOGUE if name not in LEFT_OUT]
    # every cause in turn, so that the matrix is filled evenly
    first = names[number % len(names)]
    design = ONLY_IN.get(first, str(generator.choice(["angle", "angle", "curvature"])))
    size = float(generator.choice(SIZES))
    chosen = [first]
    if kind == "pair":
        fitting = [
            n
            for n in names
            if n != first and ONLY_IN.get(n, design) == design and {n, first} not in REFUSED
        ]
        chosen.append(str(generator.choice(fitting)))
        size = max(size, 1.0)
    return HiddenStudy(
        number, kind, design, tuple(_sized(n, size, generator) for n in chosen), size
    )


def _sized(name: str, size: float, generator: np.random.Generator) -> HiddenEffect:
    """Return a cause at a multiple of its usual size, of either sign where both can be."""
    cause = CATALOGUE[name]
    values = dict(USUAL.get(name, cause.typical))
    first = cause.parameters[0]
    scaled = values[first.name] * size
    if np.isfinite(float(first.law.log_density(-scaled))) and generator.random() < 0.5:
        scaled = -scaled
    top = float(first.law.quantile(1.0 - 1e-9))
    values[first.name] = min(scaled, top)
    return HiddenEffect(cause, values)


def _outside(generator: np.random.Generator) -> HiddenEffect:
    cause = OUTSIDE[int(generator.integers(len(OUTSIDE)))]
    return HiddenEffect(cause, dict(cause.typical))


def made(
    study: HiddenStudy, folder: Path, *, forward: ForwardMap, seed: int, command: str
) -> tuple[VirtualExperiment, Truth]:
    """Make the experiment and write its folder; materials that balloon are drawn anew."""
    design = designs()[study.design]
    for attempt in range(TRIES):
        generator = np.random.default_rng((seed, study.number, attempt))
        material = drawn_truth(generator)
        if not _representable(material):
            continue
        truth = replace(
            material,
            curvature_noise_length=float(generator.uniform(5.0, 24.0)),
            tensile_noise_length=0.1,
            reading_correlation=0.3,
        )
        experiment = run_experiment(
            design, truth, forward=forward, generator=generator, effects=study.effects
        )
        # every specimen read to its end: nothing balloons, nothing is refused
        if len(experiment.tables["actuator"]) == len(design.actuator):
            break
    else:
        raise RuntimeError(f"study {study.number}: no material stays in range in {TRIES} draws")
    folder.mkdir(parents=True, exist_ok=True)
    provenance = Provenance(command=command, seed=seed, mesh={"library": 0.0})
    settings = Settings(title=f"hidden effect {study.number}", seed=study.number)
    for name, text in study_files(experiment, settings, provenance=provenance).items():
        (folder / name).write_text(text, encoding="utf-8")
    return experiment, truth


def _representable(truth: Truth) -> bool:
    """Whether polynomials with positive Bernstein coefficients pass through the material's nodes.

    Others are stable too, but the calibration's trends cannot follow them: the misfit would be that
    of the trend, and no effect that is hidden here. Nor are materials of use that nearly balloon.
    """
    c1, c3 = np.array(truth.c1), np.array(truth.c3)
    c2 = np.array(truth.c2_ratio) * np.sqrt(3.0 * c1 * c3)
    between = [2.0 * c[1] - 0.5 * (c[0] + c[2]) for c in (c1, c2, c3)]
    if between[0] < 0.1 or between[2] < 0.003 or c1[0] < SOFTEST:
        return False
    return bool(abs(between[1]) < 0.8 * np.sqrt(3.0 * between[0] * between[2]))


def _gauge_wave(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A gauge whose error swings along its range."""
    wave = effect["amplitude"] * np.sin(2.0 * np.pi * inputs.pressure / 110.0)
    return replace(inputs, pressure=np.maximum(inputs.pressure + wave, 0.0))


def _one_batch(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """One batch, that of 10 to 15 %, was mixed wrongly."""
    batch = (conditions.degradation > 9.0) & (conditions.degradation < 17.0)
    factor = np.exp(effect["log_ratio"] * batch)
    return replace(inputs, c1=inputs.c1 * factor, c2=inputs.c2 * factor, c3=inputs.c3 * factor)


def _slipping(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """The clamp slips at a middle pressure: curvature read jumps and stays off."""
    slipped = effect["share"] * (np.abs(conditions.pressure - 90.0) < 35.0)
    return replace(
        prediction,
        curvature=prediction.curvature * (1.0 + slipped),
        bend_angle=prediction.bend_angle * (1.0 + slipped),
    )


def _effect(name: str, unit: str, size: float, stage: Stage) -> dict[str, object]:
    parameter = Parameter(name, Normal(0.0, 10.0 * size), unit, "of a made-up effect", 0.0)
    return {"stage": stage, "parameters": (parameter,), "typical": {name: size}}


OUTSIDE = (
    Cause(
        name="outside_gauge_wave",
        mechanism="the gauge's error swings along its range",
        revealed_by="nothing in the catalogue",
        on_inputs=_gauge_wave,
        **_effect("amplitude", "kPa", 9.0, Stage.LOAD),
    ),
    Cause(
        name="outside_one_batch",
        mechanism="one batch of material was mixed wrongly",
        revealed_by="nothing in the catalogue",
        on_inputs=_one_batch,
        **_effect("log_ratio", "–", 0.4, Stage.MATERIAL),
    ),
    Cause(
        name="outside_slipping",
        mechanism="the camera's picture is distorted in the middle of its field",
        revealed_by="nothing in the catalogue",
        on_reading=_slipping,
        **_effect("share", "–", 0.2, Stage.READING),
    ),
)
