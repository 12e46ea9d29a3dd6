"""The planted studies of ``tests/hidden_effects``, from the fine finite element model itself.

    uv run python benchmarks/planted_studies.py --workers 2

solves their curves, half a minute each, and writes the folders; numbers choose some of them, places
in `PLANTED`. What was hidden goes to ``truths``, apart from what a pipeline reads, which bears the
number alone. What stands there is left alone.
"""

import argparse
import json
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hidden_studies import LARGEST_PRESSURE, OUTSIDE, HiddenStudy, designs, made
from numpy.typing import NDArray
from physical_effects import (
    DENSE,
    HAPPENS,
    MIDDLE,
    OF_FILMS,
    Met,
    Tests,
    elastic,
    from_surfaces,
    misgauged,
    off_end,
    on_dry_basis,
    softened,
    viscous,
)
from physics.fields import (
    FieldActuator,
    FieldMap,
    Memory,
)
from physics.mounting import Mounting

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction
from bayesdeg.actuator.mesh import COARSE, FINE
from bayesdeg.causes.catalogue import find
from bayesdeg.causes.cause import Cause
from bayesdeg.causes.flaw_embrittlement import SMOOTH
from bayesdeg.data.settings import Dimensions
from bayesdeg.display import shown
from bayesdeg.laboratory.experiment import Design
from bayesdeg.laboratory.truth import HiddenEffect, Three
from bayesdeg.surrogate.workers import pool

Floats = NDArray[np.float64]
Key = tuple[tuple[str, tuple[int, ...], bytes], ...]

FOLDER = Path("tests/hidden_effects")
SEED = 1
LEVELS = (0.0, 10.0, 25.0)  # of the actuators of most studies; films are tested at six
EVERY_LEVEL = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0)
FLAWS = "flaw_embrittlement"
COPIES = {0.0: 2, 10.0: 2, 22.5: 3, 25.0: 5}  # of actuators that are inflated until they burst
STEP, LARGEST_OF_STIFF = 40.0, 520.0  # kPa; of those, and of what is degraded beyond `SMOOTH`
BRITTLE = (209.8, 75.0, 16.0)  # elongation at break of films that break early [%]


@dataclass(frozen=True)
class Planted:
    """What is hidden in a study, and how it was tested; all else is drawn from its number.

    Parameters
    ----------
    design : str
        As in `hidden_studies.designs`; fewer actuators are tested.
    hidden : dict
        Sizes by cause and parameter.
    copies : int
        Actuators a level.
    levels : tuple of float
        Their degradation rates [%].
    bursts : bool
        Whether actuators are inflated until they burst, see `until_burst`.
    twin : str
        The study whose actuators it tests anew, with curves that are solved once; empty if none.
    elongation : tuple of float, optional
        At break, of films [%].
    memory : callable, optional
        Of an actuator at a degradation rate [%]: what is hidden is this physics, and ``hidden``
        only says what its sizes are.
    mounting : callable, optional
        How an actuator is made and held at a degradation rate [%]: another physics.
    met : callable, optional
        What the mechanics meets of what was set and cast, given the tests:
        another physics.
    recorded : callable, optional
        The degradation rates that are written down of actuators with these [%]: another slip.
    noted : mapping, optional
        Further columns of tests of actuators, each with its values by the number of the copy.
    noted_of_films : mapping, optional
        Further columns of tests of films, each with its value.
    """

    design: str
    hidden: dict[str, dict[str, float]]
    copies: int = 2
    levels: tuple[float, ...] = LEVELS
    bursts: bool = False
    twin: str = ""
    elongation: Three | None = None
    memory: Callable[[FieldActuator, float], Memory] | None = None
    mounting: Callable[[float], Mounting] | None = None
    met: Met | None = None
    recorded: Callable[[Floats], Floats] | None = None
    noted: Mapping[str, tuple[object, ...]] = field(default_factory=dict)
    noted_of_films: Mapping[str, Any] = field(default_factory=dict)

    @property
    def by_physics(self) -> bool:
        """Whether no function of a cause plants it."""
        return any((self.memory, self.mounting, self.met, self.recorded))

    def effects(self) -> tuple[HiddenEffect, ...]:
        """Return the functions by which it is hidden; none where it is a physics of its own."""
        if self.by_physics:
            return ()
        return tuple(HiddenEffect(_cause(name), values) for name, values in self.hidden.items())

    def tests(self) -> Design:
        """Return the design with fewer actuators."""
        whole = designs()[self.design]
        if self.bursts:
            return replace(whole, actuator=until_burst())
        table = whole.actuator
        copy = table["specimen_id"].str[-1].astype(int)
        kept = table["degradation_pct"].isin(self.levels) & (copy <= self.copies)
        noted = {name: copy.map(lambda k, of=v: of[k - 1]) for name, v in self.noted.items()}
        return replace(
            whole,
            actuator=table.assign(**noted)[kept].reset_index(drop=True),
            tensile=whole.tensile.assign(**self.noted_of_films),
        )


TRUE_WEIGHT, STATED_WEIGHT = 26.0, 25.0  # of the dead-weight tester, N
SHARE, RELAXATION = 0.11, 27.0  # of the stress that relaxes, and its time [s]
SOFTENED = 0.16  # in the end
REACH = 1.5  # mm that what degrades comes into the walls
OFF = 0.5  # of the length, of the paper at 25 %


RUBBING = 1.5  # friction of a regulator set by hand, over the usual one


def _met(name: str, size: float = 1.0) -> Met | None:
    """Return what the mechanics meets of an effect, by default of the usual size."""
    return HAPPENS[name](size, np.random.default_rng(0)).met


PLANTED = {
    "degradation_misread": Planted(
        "careful", {"degradation_misread": {"shift": 3.0, "scatter": 0.2}}
    ),
    "degraded_skin": Planted("careful", {"degraded_skin": {"skin_stiffening": 1.1}}, 3),
    "film_mismatch": Planted("careful", {"film_mismatch": {"log_ratio": -0.15}}),
    "paper_softening": Planted(
        "careful", {"paper_softening": {"softening": 1.8, "growth": 1.0}}, 3
    ),
    "second_invariant": Planted("careful", {"second_invariant": {"ratio": 0.5}}),
    "erosion": Planted("careful", {"erosion": {"lost_share": 0.12, "growth": 1.0}}),
    "initial_curvature": Planted("careful", {"initial_curvature": {"mismatch": 0.026}}, 3),
    "paper_slack": Planted("careful", {"paper_slack": {"slack": 0.015}}),
    "shrinkage_reading": Planted("careful", {"shrinkage_reading": {"scale_error": -0.18}}),
    "wall_thickness": Planted("careful", {"wall_thickness": {"excess": 0.08}}),
    "gravity": Planted("mounts", {"gravity": {"density": 1500.0}}),
    "pressure_loss": Planted(
        "careful", {"pressure_loss": {"fraction": 0.15}}, met=_met("pressure_loss")
    ),
    "creep": Planted(
        "history",
        {"creep": {"amount": SHARE / (1.0 - SHARE), "time_constant": RELAXATION / (1.0 - SHARE)}},
        memory=viscous(SHARE, RELAXATION),
    ),
    "humidity_drift": Planted(
        "history", {"humidity_drift": {"stiffening": 0.15, "time_constant": 900.0}}
    ),
    "mullins": Planted("history", {"mullins": {"softening": SOFTENED}}, memory=softened(SOFTENED)),
    "offset_and_curvature_reading": Planted(
        "careful",
        {
            "pressure_offset": {"offset": 9.0},
            "curvature_reading": {"fibre_height": 6.0, "magnification": 0.0},
        },
    ),
    "nothing": Planted("careful", {}),
    "outside_slipping": Planted("angle", {"outside_slipping": {"share": 0.2}}),
    FLAWS: Planted("careful", {FLAWS: {"cut": 1.5, "widening": 0.4, "onset": 20.0}}, bursts=True),
    "brittle_films": Planted("careful", {}, bursts=True, twin=FLAWS, elongation=BRITTLE),
    "stress_measure": Planted(
        "careful", {"stress_measure": {"confusion": 1.0}}, bursts=True, twin=FLAWS
    ),
    "outside_one_batch": Planted(
        "angle", {"outside_one_batch": {"log_ratio": 0.4}}, levels=EVERY_LEVEL
    ),
    "degraded_from_surfaces": Planted(
        "careful", {"degraded_skin": {}}, 3, memory=from_surfaces(REACH)
    ),
    "delamination": Planted(
        "careful", {"delamination": {"looseness": 1.0}}, 3, mounting=off_end(OFF)
    ),
    "degraded_shrinkage": Planted(
        "careful", {"degraded_shrinkage": {"lost_volume": 0.307}}, met=_met("degraded_shrinkage")
    ),
    "degradation_scale": Planted(
        "careful",
        {"degradation_scale": {"excess": -0.16}},
        levels=EVERY_LEVEL,
        recorded=on_dry_basis,
    ),
    "gauge_gain": Planted(
        "careful", {"gauge_gain": {"gain": 0.04}}, met=misgauged(TRUE_WEIGHT, STATED_WEIGHT)
    ),
    "batch_stiffness": Planted(
        "careful",
        {"batch_stiffness": {"second": 0.189}},
        3,
        met=_met("batch_stiffness"),
        noted={"batch": ("A", DENSE, "A")},
        noted_of_films={"batch": "A"},
    ),
    "temperature_softening": Planted(
        "careful",
        {"temperature_softening": {"softening": 0.035}},
        3,
        (0.0, 25.0),
        met=_met("temperature_softening"),
        noted={"temperature_C": (19.0, 22.0, 27.0)},
        noted_of_films={"temperature_C": OF_FILMS},
    ),
    "hysteresis": Planted(
        "history", {"hysteresis": {"friction": 6.0 * RUBBING}}, met=_met("hysteresis", RUBBING)
    ),
}


def until_burst() -> pd.DataFrame:
    """Return tests of actuators of which those with flaws burst: ``Design.actuator``.

    Beyond the pressures of the other studies, where films of the published elongation would not
    let any burst yet.
    """
    rows = [
        {"specimen_id": f"A{level:04.1f}-{copy + 1}", "degradation_pct": level, "pressure_kPa": p}
        for level, copies in COPIES.items()
        for copy in range(copies)
        for p in _steps(level)
    ]
    return pd.DataFrame(rows).assign(degradation_sd_pct=np.nan)


def _steps(level: float) -> list[float]:
    largest = LARGEST_PRESSURE if level < SMOOTH else LARGEST_OF_STIFF
    return np.arange(STEP, largest + 1.0, STEP).tolist()


def _cause(name: str) -> Cause:
    outside = {cause.name: cause for cause in OUTSIDE}
    return outside[name] if name in outside else find(name)


def plant(number: int, folder: Path, truths: Path, *, forward: ForwardMap) -> None:
    """Make one study; what was hidden in it is written elsewhere."""
    name, planted = list(PLANTED.items())[number - 1]
    drawn_as = list(PLANTED).index(planted.twin or name) + 1
    if planted.memory is not None or planted.mounting is not None:
        forward = with_physics(planted, forward)
    if planted.met is not None:
        forward = meeting(planted.met, planted.tests().actuator, forward)
    study = HiddenStudy(number, name, planted.design, planted.effects(), 1.0, drawn_as)
    made(
        study,
        folder,
        forward=forward,
        seed=SEED,
        command=f"python benchmarks/planted_studies.py {number}",
        design=planted.tests(),
        bursts=planted.bursts,
        elongation=planted.elongation,
    )
    if planted.recorded is not None:
        rewrite(folder / "actuator.csv", planted.recorded)
    truths.mkdir(parents=True, exist_ok=True)
    written = folder / "truth.json"
    if planted.by_physics:
        truth = json.loads(written.read_text(encoding="utf-8")) | {"causes": planted.hidden}
        written.write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")
    written.replace(truths / f"{number:02d}.json")


def rewrite(path: Path, recorded: Callable[[Floats], Floats]) -> None:
    """Write other degradation rates into a file of actuators; its comments stay."""
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    comments = "".join(line for line in lines if line.startswith("#"))
    table = pd.read_csv(path, comment="#")
    rates = recorded(table["degradation_pct"].to_numpy(float))
    text = table.assign(degradation_pct=rates.round(2)).to_csv(index=False)
    path.write_text(comments + text, encoding="utf-8")


def meeting(met: Met, table: pd.DataFrame, forward: ForwardMap) -> ForwardMap:
    """Return a map of mechanics that meets something else than what was set and cast."""
    tests = Tests(table)
    return lambda inputs: forward(met(inputs, tests))


def with_physics(planted: Planted, forward: ForwardMap) -> ForwardMap:
    """Return a map on which specimens have the memory that is planted, and are mounted so."""
    memory, table = planted.memory or elastic, planted.tests().actuator
    mounting = planted.mounting or (lambda level: Mounting())
    tests = [test for _, test in table.groupby("specimen_id", sort=False)]
    levels = [float(test["degradation_pct"].iloc[0]) for test in tests]
    held = np.zeros((len(tests), len(tests[0])))
    if "time_s" in table:
        held = np.stack([np.diff(test["time_s"], prepend=0.0) for test in tests])
    return FieldMap(
        Geometry(Dimensions()),
        COARSE if planted.mounting is None else MIDDLE,
        held,
        lambda actuator, place: memory(actuator, levels[place]),
        mounting=lambda place: mounting(levels[place]),
        finer=forward,
    )


def fine(
    executor: Executor | None, on_start: Callable[[int], None], on_curve: Callable[[], None]
) -> ForwardMap:
    """Return the finite element model on a mesh finer than any emulator's."""
    return ExactMap(
        Geometry(Dimensions()), FINE, executor=executor, on_start=on_start, on_curve=on_curve
    )


def remembering(forward: ForwardMap, known: dict[Key, Prediction]) -> ForwardMap:
    """Return a map that asks another only for what is not known yet, and then knows it."""

    def answered(inputs: Inputs) -> Prediction:
        given = {name: np.asarray(v) for name, v in vars(inputs).items() if v is not None}
        key = tuple((name, v.shape, v.tobytes()) for name, v in given.items())
        if key not in known:
            known[key] = forward(inputs)
        return known[key]

    return answered


def main() -> None:
    """Plant the studies that are missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    every = range(1, len(PLANTED) + 1)
    parser.add_argument("numbers", nargs="*", type=int, choices=every, help="by default all")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    truths = FOLDER / "truths"
    missing = [n for n in options.numbers or every if not (truths / f"{n:02d}.json").exists()]
    known: dict[Key, Prediction] = {}
    with pool(options.workers) as executor, shown(quiet=False) as progress:
        for number in missing:
            forward = fine(executor, partial(progress.stage, f"study {number}"), progress.advance)
            shared = remembering(forward, known)
            plant(number, FOLDER / "studies" / f"{number:02d}", truths, forward=shared)


if __name__ == "__main__":
    main()
