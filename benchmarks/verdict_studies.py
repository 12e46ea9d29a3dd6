"""Studies on which the time of a verdict is measured, each made from a name and a seed.

    uv run python benchmarks/verdict_studies.py --out FOLDER

writes their folders: ``cycle`` with creep hidden in it, ``cycle_none`` with nothing,
``cycle_outside`` with an effect that no cause of the catalogue describes and that bends the fit
far, ``edge`` with fresh actuators that are about to balloon, ``specimens_100`` with many actuators.
What was hidden goes to ``truths`` beside them. Curvatures are those of the second surrogate of the
fine finite element model, ``fine_library.py``.
"""

import argparse
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from fine_library import shipped_library
from forward_case import say
from hidden_studies import OUTSIDE, TRIES, complete, write_folder

from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.mesh import FINE
from bayesdeg.causes.catalogue import find
from bayesdeg.data.settings import CauseOptions, Settings
from bayesdeg.laboratory.experiment import LEVELS, Design, run_experiment
from bayesdeg.laboratory.truth import HiddenEffect, Truth, drawn_truth
from bayesdeg.laboratory.writing import TRUTH_FILE, Provenance

SEED = 11
TOP, STEP = 240.0, 20.0  # of a cycle [kPa]
ROWS = 23  # of a cycle: twelve steps up, eleven down
HOLDS = (8.0, 45.0, 150.0)  # s at each pressure, in turn: creep is not the same in all
HUMIDITY = 60.0
LARGEST_DEGRADATION = 25.0
# C1 at 0 % [MPa]. At 240 kPa the emulator answers down to some 0.265, the finer map to 0.24: near
# the edge all was read, and many plausible draws are refused
USUAL_C1, EDGE_C1 = (0.30, 0.40), (0.25, 0.27)
CREEP = {"amount": 0.1, "time_constant": 30.0}
# of which a catalogue that is cut short has the first: `creep`, which is hidden, and its rivals
CAUSES = (
    *("creep", "pressure_offset", "film_mismatch", "wall_thickness", "curvature_reading"),
    *("mullins", "humidity_drift", "pressure_loss", "paper_softening", "shrinkage_reading"),
    *("degradation_misread", "degraded_skin", "erosion", "paper_slack", "gravity"),
    *("initial_curvature", "stress_measure", "second_invariant", "flaw_embrittlement"),
    "dry_embrittlement",
)
READINGS, SPECIMENS, CATALOGUES = (200, 400, 800, 1600), (6, 18, 50, 100), (5, 10, 20)
LOW_READINGS, USUAL_SPECIMENS = 12, 18


@dataclass(frozen=True)
class TimedStudy:
    """One study: its tests, what is hidden in it, and of what material.

    Parameters
    ----------
    design : Design
        What is tested.
    hidden : mapping
        Sizes by cause and parameter.
    fresh : tuple of float
        Range of C1 at 0 % [MPa].
    causes : tuple of str, optional
        Candidates; all by default.
    number : int
        Of the draw of material, specimens and errors.
    """

    design: Design
    hidden: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    fresh: tuple[float, float] = USUAL_C1
    causes: tuple[str, ...] | None = None
    number: int = 0

    def effects(self) -> tuple[HiddenEffect, ...]:
        """Return what is hidden."""
        made_up = {cause.name: cause for cause in OUTSIDE}
        return tuple(HiddenEffect(made_up.get(n) or find(n), v) for n, v in self.hidden.items())


def cycling(specimens: int, rows: int) -> Design:
    """Return a design of loading and unloading, with times and humidity.

    Parameters
    ----------
    specimens : int
        Actuators, in equal parts at the six degradation rates of `LEVELS`.
    rows : int
        Readings of each, at least; cycles of up to `ROWS` to 240 kPa, all alike.
    """
    cycles = max(1, round(rows / ROWS))
    steps = min(ROWS, -(-rows // cycles)) // 2 + 1
    up = [float(p) for p in np.linspace(TOP / steps, TOP, steps).round(1)]
    path = [("loading", p) for p in up] + [("unloading", p) for p in up[-2::-1]]
    plan = [(cycle + 1, branch, p) for cycle in range(cycles) for branch, p in path]
    levels = np.repeat(LEVELS, -(-specimens // len(LEVELS)))[:specimens]
    tables = [
        pd.DataFrame(plan, columns=["cycle", "branch", "pressure_kPa"]).assign(
            specimen_id=f"A{k:03d}",
            degradation_pct=float(level),
            degradation_sd_pct=np.nan,
            time_s=HOLDS[k % len(HOLDS)] * np.arange(1, len(plan) + 1),
            humidity_pct=HUMIDITY,
        )
        for k, level in enumerate(levels)
    ]
    return replace(Design(), actuator=pd.concat(tables, ignore_index=True))


def loading(specimens: int, readings: int = LOW_READINGS) -> Design:
    """Return a design of loading alone, curvature alone: every actuator at a rate of its own."""
    levels = np.linspace(0.0, LARGEST_DEGRADATION, specimens).round(2)
    pressures = pd.DataFrame({"pressure_kPa": np.linspace(TOP / readings, TOP, readings).round(1)})
    table = pd.DataFrame(
        {
            "specimen_id": [f"A{k:03d}" for k in range(specimens)],
            "degradation_pct": levels,
            "degradation_sd_pct": np.nan,
        }
    )
    return replace(Design(), actuator=table.merge(pressures, how="cross"), bend_angle=False)


def studies() -> dict[str, TimedStudy]:
    """Return the studies of the benchmark by name."""
    cycle = cycling(USUAL_SPECIMENS, ROWS)
    return {
        "cycle": TimedStudy(cycle, {"creep": CREEP}),
        "cycle_none": TimedStudy(cycle),
        "cycle_outside": TimedStudy(cycle, {"outside_gauge_wave": {"amplitude": 22.0}}, number=1),
        "edge": TimedStudy(cycle, {"pressure_offset": {"offset": 6.0}}, EDGE_C1, number=2),
        "specimens_100": TimedStudy(loading(100), {"film_mismatch": {"log_ratio": 0.15}}, number=3),
    }


def of_size() -> dict[str, dict[int, TimedStudy]]:
    """Return studies that differ in one number each, by what it counts and by that number."""
    usual = cycling(USUAL_SPECIMENS, ROWS)
    creep = {"creep": CREEP}
    return {
        "readings": {
            n: TimedStudy(cycling(USUAL_SPECIMENS, n // USUAL_SPECIMENS), creep) for n in READINGS
        },
        "specimens": {
            n: TimedStudy(loading(n), {"film_mismatch": {"log_ratio": 0.15}}, number=3)
            for n in SPECIMENS
        },
        "causes": {n: TimedStudy(usual, creep, causes=CAUSES[:n]) for n in CATALOGUES},
    }


def write(study: TimedStudy, name: str, folder: Path, *, forward: ForwardMap, seed: int) -> Truth:
    """Make a study and write its folder; return what was true.

    Materials outside the range, or whose actuators balloon or burst, are drawn anew.
    """
    low, high = study.fresh
    for attempt in range(TRIES * TRIES):
        generator = np.random.default_rng((seed, study.number, attempt))
        material = drawn_truth(generator)
        if not low < material.c1[0] < high:
            continue
        truth = replace(
            material,
            curvature_noise_length=float(generator.uniform(5.0, 24.0)),
            tensile_noise_length=0.1,
            reading_correlation=0.3,
        )
        experiment = run_experiment(
            study.design, truth, forward=forward, generator=generator, effects=study.effects()
        )
        if complete(experiment, study.design):
            break
    else:
        raise RuntimeError(f"{name}: no material stays in range in {TRIES} draws")
    provenance = Provenance(f"benchmarks/verdict_studies.py {name}", seed, vars(FINE))
    settings = Settings(title=name, causes=CauseOptions(study.causes))
    write_folder(experiment, settings, folder, provenance=provenance)
    return truth


def write_all(out: Path, names: Iterable[str], *, forward: ForwardMap, seed: int) -> None:
    """Write studies below a folder, and what was true to its ``truths``."""
    truths = out / "truths"
    truths.mkdir(parents=True, exist_ok=True)
    for name in names:
        truth = write(studies()[name], name, out / name, forward=forward, seed=seed)
        (out / name / TRUTH_FILE).replace(truths / f"{name}.json")
        say(f"{name}: C1 {truth.c1[0]:.3f} MPa at 0 %")


def main() -> None:
    """Write the studies."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", choices=(*studies(),), help="by default all")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=SEED)
    options = parser.parse_args()
    names = options.names or list(studies())
    write_all(options.out, names, forward=shipped_library(), seed=options.seed)


if __name__ == "__main__":
    main()
