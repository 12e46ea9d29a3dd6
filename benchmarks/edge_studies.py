"""Studies whose fresh actuators are read to where they are about to balloon.

    uv run python benchmarks/edge_studies.py --studies 120 --record FILE --json

The material of each is drawn so that its fresh actuators reach 85 to 99 % of the last pressure that
the finer map answers, where curvature grows by some 2.7 % per percent of pressure. Of four studies
one has nothing hidden, one a mishap of `physics.mishaps`, two a cause that is planted by physics
(``physical_effects.py``).
They are made with the second surrogate of the fine finite element model (``fine_library.py``) and
judged from their folders alone at quick effort, without what is beyond doubt a mishap, as
``bayesdeg run`` does. Studies in the record are not judged again.

Keys: those of ``hidden_effects.py``; ``p_value_known``, the share of studies with one;
``named_without_p_value``, the number of those named although it is not known; ``mishap_found`` and
``mishap_named``, the shares of studies with a mishap in which what is at fault is a suspect, and in
which a cause is named; ``sound_aside``, that of the others in which something is set aside;
``seconds``, processor time a study, median and 95th percentile.
"""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hidden_effects import Json, examined, library
from hidden_record import judged_studies
from hidden_studies import designs
from hidden_summary import share, summary
from mishaps import TOLD, was_found
from physical_effects import DESIGN_OF, HAPPENS, PhysicalStudy, made_by_physics
from physics.mishaps import MISHAPS, happen
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.suspects import assemble_screened
from bayesdeg.causes.catalogue import find
from bayesdeg.data.plausibility import doubts
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.experiment import Design
from bayesdeg.laboratory.truth import HiddenEffect, Truth

STORE = Path(".cache/edge_studies")
SEED = 83
TOP = 240.0  # kPa
REACHED = (0.85, 0.99)  # of the last pressure that the map answers for fresh actuators
KINDS = ("none", "single", "mishap", "single")
SIZES = (1.0, 1.4)  # over the usual size
# low pressures do not come near; what is solved for each actuator would take hours
CAUSES = tuple(
    name
    for name, happens in HAPPENS.items()
    if DESIGN_OF.get(name) != "mounts" and not happens(1.0, np.random.default_rng(0)).is_solved
)
UNTOLD = tuple(name for name in MISHAPS if name not in TOLD)


def to_edge(design: Design) -> Design:
    """Return a design with pressures up to `TOP`."""
    table = design.actuator
    scaled = (table["pressure_kPa"] * (TOP / table["pressure_kPa"].max())).round(1)
    return replace(design, actuator=table.assign(pressure_kPa=scaled))


def is_near(truth: Truth) -> bool:
    """Return whether fresh actuators reach that share of their last pressure which is wanted."""
    c1, c2, c3 = truth.constants(0.0)[..., None]
    pressure = np.arange(TOP, TOP / REACHED[0] + 1.0)
    scale, paper = np.cbrt([truth.volume_ratio]), np.array([truth.paper_stiffness])
    inputs = Inputs(
        pressure, c1, c2, c3, scale, paper, paper_thickness=np.array([truth.paper_thickness])
    )
    answered = int(np.sum(np.cumprod(library()(inputs).status.ravel() == 0)))
    last = pressure[max(answered - 1, 0)]
    return bool(answered and REACHED[0] <= TOP / last <= REACHED[1])


def drawn(number: int, *, seed: int) -> tuple[PhysicalStudy, str]:
    """Return a study, with its mishap or an empty word."""
    generator = np.random.default_rng((seed, number))
    kind, turn = KINDS[number % len(KINDS)], number // len(KINDS)
    if kind != "single":
        mishap = UNTOLD[turn % len(UNTOLD)] if kind == "mishap" else ""
        design = "angle" if mishap or turn % 2 else "curvature"
        return PhysicalStudy(number, "none", design, (), 0.0), mishap
    name = CAUSES[(number // 2) % len(CAUSES)]
    size = float(generator.uniform(*SIZES))
    one = HAPPENS[name](size, generator)
    design = DESIGN_OF.get(name, str(generator.choice(["angle", "careful", "curvature"])))
    hidden = (HiddenEffect(find(one.cause), one.values),)
    return PhysicalStudy(number, kind, design, hidden, size, physics=(one,)), ""


def judged(number: int, folder: Path, seed: int) -> Json:
    """Make a study and judge it; return what was found beside the truth."""
    study, mishap = drawn(number, seed=seed)
    command = f"benchmarks/edge_studies.py, study {number}"
    how: dict[str, Any] = {"forward": library(), "seed": seed, "command": command}
    tests = to_edge(designs()[study.design])
    truth, changes = made_by_physics(study, folder, **how, tests=tests, fits=is_near)
    happened = None
    if mishap:
        path = folder / "actuator.csv"
        table = pd.read_csv(path, comment="#")
        table, happened = happen(mishap, table, np.random.default_rng((seed, number, 1)))
        table.to_csv(path, index=False)
    begun, whole = time.process_time(), read_study(folder)
    with threadpool_limits(limits=1):
        assembly = assemble_screened(whole)
    known = [str(one.fault.problem) for one in doubts(whole, outline(whole).expected)]
    if assembly.sets_aside:  # the changes are those of all readings: the entry's rule stands in
        changes = {}
    found = examined(study, folder, truth, changes, effort="quick", seed=seed, assembly=assembly)
    return found | {
        "kind": "mishap" if mishap else study.kind,
        "mishap": mishap,
        "found": happened and was_found(happened, whole, assembly.aside, known),
        "aside": sorted({name for one in assembly.aside if one.is_out for name in one.specimens}),
        "seconds": time.process_time() - begun,
    }


def figures(found: list[Json]) -> Json:
    """Return the figures of the benchmark."""
    spoilt = [one for one in found if one["mishap"]]
    sound = [one for one in found if not one["mishap"]]
    unknown = [one for one in found if np.isnan(one["p_value"])]
    seconds = [one["seconds"] for one in found]
    return {
        **summary(found, []),
        "p_value_known": 1.0 - len(unknown) / len(found),
        "named_without_p_value": sum(one["outcome"] == "named" for one in unknown),
        "mishap_studies": len(spoilt),
        "mishap_found": share(one["found"] for one in spoilt),
        "mishap_named": share(one["outcome"] == "named" for one in spoilt),
        "sound_aside": share(bool(one["aside"]) for one in sound),
        "seconds": {"median": np.median(seconds), "p95": np.quantile(seconds, 0.95)},
    }


def main() -> None:
    """Run the benchmark."""
    found = judged_studies(judged, STORE, studies=120, seed=SEED, about=str(__doc__))
    print(json.dumps(figures(found), indent=1))


if __name__ == "__main__":
    main()
