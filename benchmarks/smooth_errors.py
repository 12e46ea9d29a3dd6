"""Studies that the simulation misses smoothly, by a tenth of the largest reading or more.

    uv run python benchmarks/smooth_errors.py --studies 80 --record FILE --json

Made with the second surrogate of the fine finite element model (``fine_library.py``), changed in
the files alone, and judged from these at quick effort as ``bayesdeg run`` does. Of four studies

- ``single_specimen`` has one actuator, whose curvature differs from the simulation by a smooth
  function of pressure,
- ``both_branches`` has films that were pulled and let back, in one curve that does not say so,
- ``wrong_stiffness`` has one to three actuators cast stiffer or softer than the films, their
  curvature smaller or larger throughout,
- ``sound`` has the same tests as one of these, and nothing wrong.

Keys by kind, that of sound ones with their tests: ``studies``; ``adequate``, the share called so,
which only sound ones with several specimens may be;
``outcomes``, how often each, ``refused`` if the study is not read.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hidden_effects import Json, examined, library
from hidden_record import judged_studies
from hidden_studies import HiddenStudy, designs, made
from hidden_summary import share
from numpy.typing import NDArray

from bayesdeg.assembly.suspects import assemble_screened
from bayesdeg.data.study import read_study
from bayesdeg.errors import StudyError
from bayesdeg.laboratory.experiment import Design

Floats = NDArray[np.float64]
Spoil = Callable[[Path, np.random.Generator], None]

STORE = Path(".cache/smooth_errors")
SEED = 97
ERROR = (0.1, 0.3)  # largest error over the largest curvature
#: Courses over p/p_max, at most 1.
SHAPES: tuple[Callable[[Floats], Floats], ...] = (
    lambda x: x,
    lambda x: x**2,
    np.sqrt,
    lambda x: np.sin(np.pi * x),
    lambda x: 4.0 * x * (1.0 - x) - 0.5 * x,
)
LOOP = (0.3, 0.6)  # of the stress in the middle of a curve that is lost on the way back
STIFFNESS = (0.3, 0.5)  # ln ratio of the curvature


def few(design: Design, specimens: int, levels: tuple[float, ...]) -> Design:
    """Return a design with so many actuators at each of these degradation rates, and its films."""
    table = design.actuator[design.actuator["degradation_pct"].isin(levels)]
    names = table.groupby("degradation_pct")["specimen_id"].unique()
    kept = [name for of_level in names for name in of_level[:specimens]]
    films = design.tensile[design.tensile["degradation_pct"].isin(levels)]
    return replace(design, actuator=table[table["specimen_id"].isin(kept)], tensile=films)


def bent(folder: Path, generator: np.random.Generator) -> None:
    """Add a smooth function of pressure to the curvature."""
    table = pd.read_csv(folder / "actuator.csv", comment="#")
    shape = SHAPES[int(generator.integers(len(SHAPES)))]
    course = shape(table["pressure_kPa"].to_numpy() / table["pressure_kPa"].max())
    size = generator.choice([-1.0, 1.0]) * generator.uniform(*ERROR)
    change = size * course / np.abs(course).max() * table["curvature_per_m"].max()
    # small readings stay positive
    table["curvature_per_m"] *= np.maximum(1.0 + change / table["curvature_per_m"], 0.3)
    table.to_csv(folder / "actuator.csv", index=False)


def let_back(folder: Path, generator: np.random.Generator) -> None:
    """Add to each film's curve what it reads on the way back; half of the files are sorted."""
    table = pd.read_csv(folder / "tensile.csv", comment="#")
    loss, is_sorted, parts = generator.uniform(*LOOP), generator.random() < 0.5, []
    for _, film in table.groupby("specimen_id", sort=False):
        x = (film["stretch"] - 1.0) / (film["stretch"].max() - 1.0)
        back = film.assign(stress_MPa=film["stress_MPa"] * (1.0 - 4.0 * loss * x * (1.0 - x)))
        whole = pd.concat([film, back.iloc[-2::-1]])
        parts.append(whole.sort_values("stretch") if is_sorted else whole)
    pd.concat(parts).to_csv(folder / "tensile.csv", index=False)


def scaled(folder: Path, generator: np.random.Generator) -> None:
    """Read curvatures of actuators that are cast stiffer or softer than films."""
    table = pd.read_csv(folder / "actuator.csv", comment="#")
    size = generator.choice([-1.0, 1.0]) * generator.uniform(*STIFFNESS)
    table["curvature_per_m"] *= np.exp(size)
    table.to_csv(folder / "actuator.csv", index=False)


SPOILT: Mapping[str, Spoil] = {
    "single_specimen": bent,
    "both_branches": let_back,
    "wrong_stiffness": scaled,
}
KINDS = (*SPOILT, "sound")
LEVELS = ((0.0,), (10.0,), (25.0,), (0.0, 15.0, 25.0))


def tests_of(kind: str, turn: int, whole: Design) -> Design:
    """Return the tests of a study, without bend angles."""
    if kind == "both_branches":
        return few(whole, 2, LEVELS[-1])
    levels = LEVELS[turn % len(LEVELS)] if kind == "wrong_stiffness" else LEVELS[turn % 3]
    return few(whole, 1, levels)


def judged(number: int, folder: Path, seed: int) -> Json:
    """Make a study and judge it."""
    generator = np.random.default_rng((seed, number))
    kind, turn = KINDS[number % len(KINDS)], number // len(KINDS)
    tests_like = kind if kind in SPOILT else list(SPOILT)[turn % len(SPOILT)]
    study = HiddenStudy(number, "none", "curvature", (), 0.0)
    design = tests_of(tests_like, turn, designs()["curvature"])
    command = f"benchmarks/smooth_errors.py, study {number}"
    how: dict[str, Any] = {"forward": library(), "seed": seed, "command": command}
    _, truth = made(study, folder, **how, design=design)
    (folder / "truth.json").unlink()
    if kind in SPOILT:
        SPOILT[kind](folder, generator)
    try:
        assembly = assemble_screened(read_study(folder))
    except StudyError as refused:
        known = {"seed": seed, "number": number, "effort": "quick", "hidden": {}, "confusable": {}}
        found = known | {"outcome": "refused", "causes": [], "reasons": [str(refused)]}
    else:
        found = examined(study, folder, truth, {}, effort="quick", seed=seed, assembly=assembly)
    return found | {"kind": kind, "tests_like": tests_like}


def figures(found: list[Json]) -> Json:
    """Return the figures of the benchmark."""
    by_kind: dict[str, list[Json]] = {}
    for one in found:
        is_sound = one["kind"] == "sound"
        by_kind.setdefault(f"sound_{one['tests_like']}" if is_sound else one["kind"], []).append(
            one
        )
    return {
        kind: {
            "studies": len(some),
            "adequate": share(one["outcome"] == "adequate" for one in some),
            "outcomes": dict(Counter(one["outcome"] for one in some)),
        }
        for kind, some in sorted(by_kind.items())
    }


def main() -> None:
    """Run the benchmark."""
    found = judged_studies(judged, STORE, studies=80, seed=SEED, about=str(__doc__))
    print(json.dumps(figures(found), indent=1))


if __name__ == "__main__":
    main()
