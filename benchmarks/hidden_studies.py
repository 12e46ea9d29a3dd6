"""Studies with hidden effects: causes, sizes and test designs.

Everything is drawn for each study: material laws, specimens, degradation rates, reading errors
correlated along a curve, and the hidden effect.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from physics.imitations import CONTACT, IMITATIONS, TOUCHING, WARM_DAY, bent, outside_effect

from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.actuator.mesh import FINE
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.data.settings import Settings
from bayesdeg.laboratory.experiment import PRESSURES, Design, VirtualExperiment, run_experiment
from bayesdeg.laboratory.truth import HiddenEffect, Three, Truth, drawn_truth
from bayesdeg.laboratory.writing import Provenance, study_files
from bayesdeg.priors import Choice, Distribution, LogNormal

SIZES = (0.6, 1.0, 1.4, 1.8)
LARGEST_PRESSURE = 200.0  # kPa; beyond, soft draws of the material balloon
SOFTEST = 0.26  # C1 at 0 % [MPa]: actuators of softer ones are about to balloon at that pressure
HELD = {"1": 8.0, "2": 45.0, "3": 150.0}  # s at each pressure, by the number of the specimen
CYCLES, HUMIDITY = 2, 60.0
MOUNTS = ("horizontal", "hanging", "bending_up")
LOW_PRESSURES = (4.0, 8.0, 12.0, 20.0, 40.0, 80.0)
TRIES = 200
# specimens cast and read with care, for effects that the usual scatter hides
CAREFUL: Mapping[str, Any] = {
    "stiffness_scatter": 0.01,
    "degradation_sd": 0.1,
    "curvature_noise": 0.005,
    "curvature_noise_floor": 0.03,
    "bend_angle_noise": 0.005,
    "bend_angle_noise_floor": 0.08,
    "tensile_noise": 0.005,
    "tensile_noise_floor": 0.002,
}
CAREFULLY = ("careful", "mounts")
PAPER_TEST = 0.05  # sd of ln stiffness of the paper, which is then measured too
# sizes that count as 1: most are some 5 to 10 standard deviations in their designs
USUAL: Mapping[str, Mapping[str, float]] = {
    "degradation_misread": {"shift": 3.0, "scatter": 0.5},
    "degraded_skin": {"skin_stiffening": 0.8},
    "film_mismatch": {"log_ratio": 0.15},
    "paper_softening": {"softening": 1.3, "growth": 1.0},
    "second_invariant": {"ratio": 0.4},
    "delamination": {"looseness": 1.0},
    "initial_curvature": {"mismatch": 0.017},
    "paper_slack": {"slack": 0.015},
    "shrinkage_reading": {"scale_error": -0.12},
    "pressure_loss": {"fraction": 0.12},
    "pressure_offset": {"offset": 8.0},
    "creep": {"amount": 0.06, "time_constant": 30.0},
    "humidity_drift": {"stiffening": 0.08, "time_constant": 900.0},
    "mullins": {"softening": 0.08, "onset": 0.1},
    "curvature_reading": {"fibre_height": 5.0, "magnification": 0.0},
}
# not on the bounds of the priors, which no interval of the size could hold
LARGEST: Mapping[str, float] = {
    "degraded_skin": 1.1,
    "paper_softening": 2.0,
    "delamination": 1.3,
    "erosion": 0.18,
    "initial_curvature": 0.027,
    "gravity": 1800.0,
}
RISING = ("pressure_offset", "initial_curvature")  # hardly visible with the other sign


@dataclass(frozen=True)
class HiddenStudy:
    """One study with its hidden effects.

    Parameters
    ----------
    number : int
        Of the study; all randomness comes from it and the seed.
    kind : str
        ``single``, ``pair``, ``triple``, ``none`` or ``outside``.
    design : str
        One of `DESIGNS`.
    effects : tuple of HiddenEffect
        What is hidden.
    size : float
        Over the usual size.
    drawn_as : int, optional
        Number of the study whose material, specimens and errors it shares; by default its own.
    """

    number: int
    kind: str
    design: str
    effects: tuple[HiddenEffect, ...]
    size: float
    drawn_as: int | None = None

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
    """Every specimen in every mount, at low pressures, where weight shows."""
    specimens = Design().actuator.drop(columns="pressure_kPa").drop_duplicates()
    steps = pd.DataFrame(
        [
            {"pressure_kPa": pressure, "cycle": cycle, "mount": mount}
            for cycle, mount in enumerate(MOUNTS, start=1)
            for pressure in LOW_PRESSURES
        ]
    )
    return replace(Design(), actuator=specimens.merge(steps, how="cross"))


def designs() -> dict[str, Design]:
    """Return the designs by name; those in `CAREFULLY` have less scatter and noise."""
    return {
        "curvature": replace(_bare(), bend_angle=False),
        "angle": _bare(),
        "history": _history(),
        "careful": _bare(),
        "mounts": _mounts(),
    }


ONLY_IN = {
    "creep": "history",
    "humidity_drift": "history",
    "mullins": "history",
    "gravity": "mounts",
    "degraded_skin": "careful",
    "paper_softening": "careful",
    "second_invariant": "careful",
    "initial_curvature": "careful",
    "delamination": "careful",
}
REFUSED = ({"paper_slack", "initial_curvature"}, {"paper_slack", "gravity"})  # by the library
# what is drawn, in this order, so that a later cause changes no study. Not what shows in ruptures
# alone or where a study states how curvature was read; nor delamination, which by its rule is soft
# paper to any reading: it is planted by physics, in a study of tests/hidden_effects
HIDDEN = (
    *("degradation_misread", "degraded_skin", "film_mismatch", "paper_softening"),
    *("second_invariant", "erosion", "initial_curvature", "paper_slack", "shrinkage_reading"),
    *("wall_thickness", "gravity", "pressure_loss", "pressure_offset", "creep", "humidity_drift"),
    *("mullins", "curvature_reading", "stress_measure"),
)
# the first 300 studies are too few to bound what is rarely said: of 20 further ones 9 hide an
# effect outside the catalogue, 6 none, 4 two causes and 1 one
SECOND_DRAW = 300
SECOND_KINDS = (
    *("outside", "none", "outside", "pair", "outside", "none", "outside", "none", "outside"),
    *("pair", "outside", "none", "outside", "pair", "outside", "none", "single", "outside"),
    *("none", "pair"),
)
THIRD_DRAW = 510
# causes that came after the first three draws, in turn, one a study
FOURTH_DRAW = 600
LATER = ("degraded_shrinkage", "degradation_scale", "gauge_gain")
OUTSIDE_SIZES = (0.6, 1.6)  # over the usual size
# effects outside the catalogue that imitate entries, in turn, beyond all numbers by physics
IMITATING_DRAW = 3000


def drawn_study(number: int, *, seed: int) -> HiddenStudy:
    """Draw what is hidden in a study: 60 % one cause, 15 % two, 15 % none, 10 % another effect.

    From number `SECOND_DRAW` on most have none, two, or an effect outside the catalogue, which
    then are of more kinds and sizes; from `THIRD_DRAW` on all have three, from `FOURTH_DRAW` on one
    of `LATER`; from `IMITATING_DRAW` on one of `IMITATIONS`.
    """
    generator = np.random.default_rng((seed, number))
    if number >= IMITATING_DRAW:
        return _imitating(number, generator)
    more, kind = number >= SECOND_DRAW, _kind(number, generator)
    if kind == "none":
        return HiddenStudy(number, kind, str(generator.choice(list(designs()))), (), 0.0)
    if kind == "outside":
        size = float(generator.uniform(*OUTSIDE_SIZES)) if more else 1.0
        effect = _outside(generator, (*OUTSIDE, *MORE_OUTSIDE) if more else OUTSIDE, size)
        return HiddenStudy(
            number, kind, str(generator.choice(["curvature", "angle"])), (effect,), size
        )
    names = HIDDEN if number < FOURTH_DRAW else LATER
    # every cause in turn, so that the matrix is filled evenly
    first = names[number % len(names)]
    design = ONLY_IN.get(first, str(generator.choice(["angle", "angle", "curvature"])))
    size = float(generator.choice(SIZES))
    chosen = [first]
    for _ in range({"pair": 1, "triple": 2}.get(kind, 0)):
        fitting = [
            n
            for n in names
            if n not in chosen
            and ONLY_IN.get(n, design) == design
            and not any({n, other} in REFUSED for other in chosen)
        ]
        chosen.append(str(generator.choice(fitting)))
        size = max(size, 1.0)
    return HiddenStudy(
        number, kind, design, tuple(_sized(n, size, generator) for n in chosen), size
    )


def _imitating(number: int, generator: np.random.Generator) -> HiddenStudy:
    """Return a study with one of `IMITATIONS`, each in turn."""
    cause, fitting = IMITATIONS[(number - IMITATING_DRAW) % len(IMITATIONS)]
    size = float(generator.uniform(*OUTSIDE_SIZES))
    values = {name: value * size for name, value in cause.typical.items()}
    hidden = HiddenEffect(cause, values)
    return HiddenStudy(number, "outside", str(generator.choice(fitting)), (hidden,), size)


def _kind(number: int, generator: np.random.Generator) -> str:
    drawn = str(generator.choice(["single", "pair", "none", "outside"], p=[0.6, 0.15, 0.15, 0.1]))
    if number < SECOND_DRAW:
        return drawn
    if number < THIRD_DRAW:
        return SECOND_KINDS[number % len(SECOND_KINDS)]
    return "triple" if number < FOURTH_DRAW else "single"


def _sized(name: str, size: float, generator: np.random.Generator) -> HiddenEffect:
    """Return a cause at a multiple of its usual size, of either sign where both can be."""
    cause = CATALOGUE[name]
    values = dict(USUAL.get(name, cause.typical))
    first = cause.parameters[0]
    if isinstance(first.law, Choice):
        return HiddenEffect(cause, values)
    scaled = min(values[first.name] * size, LARGEST.get(name, np.inf))
    either = np.isfinite(float(first.law.log_density(-scaled))) and name not in RISING
    values[first.name] = -scaled if either and generator.random() < 0.5 else scaled
    return HiddenEffect(cause, values)


def _outside(
    generator: np.random.Generator, causes: tuple[Cause, ...], size: float
) -> HiddenEffect:
    cause = causes[int(generator.integers(len(causes)))]
    return HiddenEffect(cause, {name: value * size for name, value in cause.typical.items()})


def is_stiff(truth: Truth) -> bool:
    """Return whether fresh actuators are far from ballooning at `LARGEST_PRESSURE`."""
    return truth.c1[0] >= SOFTEST


@dataclass(frozen=True)
class MadeStudy:
    """A study as it was recorded, and what is true of it.

    Parameters
    ----------
    experiment : VirtualExperiment
        Tables and what was hidden.
    truth : Truth
        Material and errors.
    priors : mapping of str to Distribution
        What the study knows of a test of its own, as that of the paper.
    """

    experiment: VirtualExperiment
    truth: Truth
    priors: Mapping[str, Distribution]


def experimented(
    study: HiddenStudy,
    *,
    forward: ForwardMap,
    seed: int,
    design: Design | None = None,
    bursts: bool = False,
    elongation: Three | None = None,
    fits: Callable[[Truth], bool] = is_stiff,
) -> MadeStudy:
    """Run the experiment; redraw the material if it does not qualify or an actuator balloons.

    The design is the one that the study names, or a given one instead. Where actuators are meant to
    burst, theirs may; the elongation at break is that of `Truth`, or a given one [%].
    """
    design = designs()[study.design] if design is None else design
    drawn_as = study.number if study.drawn_as is None else study.drawn_as
    for attempt in range(TRIES):
        generator = np.random.default_rng((seed, drawn_as, attempt))
        material = drawn_truth(generator)
        if not fits(material):
            continue
        truth = replace(
            material,
            **(CAREFUL if study.design in CAREFULLY else {}),
            curvature_noise_length=float(generator.uniform(5.0, 24.0)),
            tensile_noise_length=0.1,
            reading_correlation=0.3,
            elongation=material.elongation if elongation is None else elongation,
        )
        experiment = run_experiment(
            design, truth, forward=forward, generator=generator, effects=study.effects
        )
        solved = bool((experiment.actuators["status"] == "converged").all())
        if complete(experiment, design) or (bursts and solved):
            break
    else:
        raise RuntimeError(f"study {study.number}: no material stays in range in {TRIES} draws")
    priors = {}
    if study.design in CAREFULLY:
        known = truth.paper_stiffness * float(np.exp(PAPER_TEST * generator.standard_normal()))
        priors["paper_stiffness"] = LogNormal(known, PAPER_TEST)
    return MadeStudy(experiment, truth, priors)


def made(
    study: HiddenStudy,
    folder: Path,
    *,
    forward: ForwardMap,
    seed: int,
    command: str,
    design: Design | None = None,
    bursts: bool = False,
    elongation: Three | None = None,
) -> tuple[VirtualExperiment, Truth]:
    """Make the experiment, as `experimented`, and write its folder."""
    found = experimented(
        study, forward=forward, seed=seed, design=design, bursts=bursts, elongation=elongation
    )
    title = f"hidden effect {study.number}"
    settings = Settings(title=title, seed=study.number, priors=found.priors)
    provenance = Provenance(command=command, seed=seed, mesh=vars(FINE))
    write_folder(found.experiment, settings, folder, provenance=provenance)
    return found.experiment, found.truth


def complete(experiment: VirtualExperiment, design: Design) -> bool:
    """Return whether every specimen was read to its end: nothing ballooned, nothing burst."""
    solved = bool((experiment.actuators["status"] == "converged").all())
    return solved and len(experiment.tables["actuator"]) == len(design.actuator)


def write_folder(
    experiment: VirtualExperiment, settings: Settings, folder: Path, *, provenance: Provenance
) -> None:
    """Write all files of a virtual experiment, ``truth.json`` among them."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in study_files(experiment, settings, provenance=provenance).items():
        (folder / name).write_text(text, encoding="utf-8")


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
    return bent(prediction, 1.0 + slipped)


def _second_gauge(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Every third actuator hung on another gauge, which reads too much."""
    other = np.arange(conditions.pressure.shape[-2])[:, None] % 3 == 1
    return replace(inputs, pressure=inputs.pressure * (1.0 - effect["excess"] * other))


OUTSIDE = (
    Cause(
        name="outside_gauge_wave",
        mechanism="the gauge's error swings along its range",
        revealed_by="nothing in the catalogue",
        on_inputs=_gauge_wave,
        **outside_effect("amplitude", "kPa", 9.0, Stage.LOAD),
    ),
    Cause(
        name="outside_one_batch",
        mechanism="one batch of material was mixed wrongly",
        revealed_by="nothing in the catalogue",
        on_inputs=_one_batch,
        **outside_effect("log_ratio", "–", 0.4, Stage.MATERIAL),
    ),
    Cause(
        name="outside_slipping",
        mechanism="the camera's picture is distorted in the middle of its field",
        revealed_by="nothing in the catalogue",
        on_reading=_slipping,
        **outside_effect("share", "–", 0.2, Stage.READING),
    ),
    CONTACT,
    Cause(
        name="outside_second_gauge",
        mechanism="every third actuator hung on a gauge that reads too much",
        revealed_by="nothing in the catalogue",
        on_inputs=_second_gauge,
        **outside_effect("excess", "–", 0.15, Stage.LOAD),
    ),
)


def _bent_gauge(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A gauge that reads too little, the more the higher the pressure."""
    share = effect["bend"] * inputs.pressure / LARGEST_PRESSURE
    return replace(inputs, pressure=inputs.pressure * (1.0 + share))


def _stiff_at_large_strain(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Cast walls stiffen with strain earlier than films do: C2 and C3, not C1."""
    factor = np.exp(effect["log_ratio"])
    return replace(inputs, c2=inputs.c2 * factor, c3=inputs.c3 * factor)


def _wavy_course(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Walls stiffen early and then soften again as they degrade; films do not."""
    factor = np.exp(effect["log_ratio"] * np.sin(np.pi * conditions.degradation / 12.5))
    return replace(inputs, c1=inputs.c1 * factor, c2=inputs.c2 * factor, c3=inputs.c3 * factor)


def _lens(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """A lens that shows what bends far less bent."""
    share = 1.0 - effect["lost"] * np.minimum(prediction.curvature / TOUCHING, 1.5)
    return bent(prediction, share)


MORE_OUTSIDE = (
    Cause(
        name="outside_bent_gauge",
        mechanism="the gauge reads too little, the more the higher the pressure",
        revealed_by="nothing in the catalogue",
        on_inputs=_bent_gauge,
        **outside_effect("bend", "–", 0.25, Stage.LOAD),
    ),
    Cause(
        name="outside_stiff_at_large_strain",
        mechanism="cast walls stiffen with strain earlier than films",
        revealed_by="nothing in the catalogue",
        on_inputs=_stiff_at_large_strain,
        **outside_effect("log_ratio", "–", 0.5, Stage.MATERIAL),
    ),
    Cause(
        name="outside_wavy_course",
        mechanism="walls stiffen early and soften again as they degrade",
        revealed_by="nothing in the catalogue",
        on_inputs=_wavy_course,
        **outside_effect("log_ratio", "–", 0.2, Stage.MATERIAL),
    ),
    WARM_DAY,
    Cause(
        name="outside_lens",
        mechanism="the lens shows what bends far less bent",
        revealed_by="nothing in the catalogue",
        on_reading=_lens,
        **outside_effect("lost", "–", 0.2, Stage.READING),
    ),
)
