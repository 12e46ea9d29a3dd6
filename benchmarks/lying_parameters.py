"""Parameters that absorb a hidden effect: how often they are found, and how often others accused.

    uv run python benchmarks/lying_parameters.py --studies 60 --without 60 --json

draws studies anew, with an effect hidden in them and without, makes their curvatures with the
second surrogate of the fine finite element model (``fine_library.py``), calibrates the base model,
and holds the parameters that it puts in question against the truth. A parameter has absorbed an
effect where the base posterior is more than `PUSHED` standard deviations of all else off the true
value, and as far off the posterior of a refit that knows the effect: the rest may be chance of the
films. Where all else itself is as far off the truth, a film that was read wrongly misleads both,
which nothing in the study contradicts; such parameters are counted apart. One that is accused
wrongly has a base posterior within the 90 % interval about the truth.

``lying_found`` is the share of the first kind that is in question, ``lying_false`` the share of
studies without an effect in which any parameter is. ``--causes`` searches for causes too, and says
how often the one that is said to have pushed a parameter is hidden there. Finished studies are kept
in ``.cache/lying_parameters``.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fine_library import shipped_library
from hidden_studies import HiddenStudy, designs, drawn_study, made
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.assembly.assemble import assemble
from bayesdeg.criticism.checks.absorption import Absorption, Split, absorption, split
from bayesdeg.criticism.fit.linear import columns_of, with_neutral
from bayesdeg.criticism.fit.search import Search, SearchEffort, run_search
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.data.study import read_study
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import approximate
from bayesdeg.inference.model import JointModel
from bayesdeg.laboratory.truth import Truth
from bayesdeg.material.degradation import bernstein_weights
from bayesdeg.observations.specimens import control_name
from bayesdeg.priors import Normal

Floats = NDArray[np.float64]
Json = dict[str, Any]

STORE = Path(".cache/lying_parameters")
SEED = 53
PUSHED = 3.0  # standard deviations of all else by which a base posterior is off the truth
STRICTER = (4.0, 5.0)
NORMAL = 1.645  # up to which it is as it should be
FIRST_WITHOUT = 10_000  # numbers of studies without an effect
PLAIN = ("curvature", "angle", "history", "careful")  # their designs, in turn
KNOWN = 1e-3  # relative standard deviation of an effect that is known
DRAWS = 4000
EFFORT = SearchEffort(replicates=100, fitted=3, pairs=1)


@cache
def library() -> ForwardMap:
    """Return the second surrogate, loaded once."""
    return shipped_library()


def studies(count: int, without: int, *, seed: int) -> Iterator[HiddenStudy]:
    """Yield studies with something hidden, then those with nothing."""
    found = 0
    for number in range(FIRST_WITHOUT):
        if found == count:
            break
        study = drawn_study(number, seed=seed)
        if study.effects:
            found += 1
            yield study
    for k in range(without):
        assert PLAIN[k % len(PLAIN)] in designs()
        yield HiddenStudy(FIRST_WITHOUT + k, "none", PLAIN[k % len(PLAIN)], (), 0.0)


def true_values(model: JointModel, truth: Truth) -> dict[str, float]:
    """Return the true values of the parameters that have one, on the sampler's scale.

    Errors of the emulator are in their own standard errors about zero: none is the value for which
    the data speak where nothing is hidden.
    """
    nodes = model.world.nodes
    weights = bernstein_weights(list(nodes), nodes)
    c1, c2, c3 = np.linalg.solve(weights, truth.constants(list(nodes))).T
    named = truth.named()
    known = {name: named[name] for name in ("volume_ratio", "paper_stiffness")}
    known |= {name: value for name, value in named.items() if name.startswith("elongation_at")}
    with np.errstate(invalid="ignore"):
        ratio = c2 / np.sqrt(3.0 * c1 * c3)
    for k in range(len(nodes)):
        for quantity, values in (("c1", c1), ("c2_ratio", ratio), ("c3", c3)):
            known[control_name(quantity, nodes, k)] = float(values[k])
    found = {}
    for parameter in model.base:
        if parameter.name.startswith("emulator_error"):
            found[parameter.name] = 0.0
        elif parameter.name in known:
            value = float(parameter.law.to_unconstrained(known[parameter.name]))
            if np.isfinite(value):
                found[parameter.name] = value
    return found


def refitted(base: CandidateFit, start: Floats, study: HiddenStudy) -> Floats:
    """Return the posterior's mean of the base parameters where the hidden effect is known."""
    known = []
    for hidden in study.effects:
        laws = [
            replace(
                p, law=Normal(hidden.values[p.name], KNOWN * max(abs(hidden.values[p.name]), KNOWN))
            )
            for p in hidden.cause.parameters
        ]
        known.append(replace(hidden.cause, parameters=tuple(laws)))
    model, generator = base.subject.extended(*known), np.random.default_rng(0)
    climbs = []
    for point in (base.mode, start):
        vector = with_neutral(point, base.subject, model)
        for cause, hidden in zip(known, study.effects, strict=True):
            vector[columns_of(model, cause)] = [hidden.values[p.name] for p in cause.parameters]
        climbs.append(approximate(model, generator, start=vector))
    best = max(climbs, key=lambda climbed: climbed.log_density)
    draws = about_mode(model, best, generator).resample(generator, DRAWS)
    there = dict(zip(model.table.names, np.mean(draws, axis=0), strict=True))
    return np.array([there[name] for name in base.subject.table.names])


def judged(study: HiddenStudy, folder: Path, *, seed: int, causes: bool) -> Json:
    """Make one study, calibrate it, and return its parameters beside the truth."""
    command = f"benchmarks/lying_parameters.py, study {study.number}"
    _, truth = made(study, folder, forward=library(), seed=seed, command=command)
    (folder / "truth.json").unlink()
    with threadpool_limits(limits=1):
        assembly = assemble(read_study(folder))
        fitting, judging = np.random.SeedSequence(study.number).spawn(2)
        base = base_without_chain(assembly.model, fitting)
        here, found, chosen = split(base), None, frozenset[str]()
        if causes and any(one.in_question for one in here.displacements):
            search = Search(base, assembly.candidates, EFFORT, judging)
            chosen = run_search(search)
            found = absorption(search, chosen)
        knowing = refitted(base, here.known.mean, study) if study.effects else base.mode
    return {
        "number": study.number,
        "kind": study.kind,
        "design": study.design,
        "hidden": {one.cause.name: dict(one.values) for one in study.effects},
        "searched": found is not None,
        "chosen": sorted(chosen),
        "parameters": _rows(here, found, true_values(assembly.model, truth), knowing),
    }


def _rows(
    here: Split, found: Absorption | None, true: dict[str, float], knowing: Floats
) -> list[Json]:
    names, rows = here.model.table.names, []
    middle = np.mean(here.draws, axis=0)
    for one in here.displacements:
        name = one.parameter
        if name not in true:
            continue
        k = names.index(name)
        sd = float(here.known.sd[k])
        pushes = found.pushed_by(one) if found is not None and one.in_question else ()
        after = None if found is None else found.returned(one)
        rows.append(
            {
                "parameter": name,
                "off": (float(middle[k]) - true[name]) / sd,
                "pushed": (float(middle[k]) - float(knowing[k])) / sd,
                "all_else_off": (float(here.known.mean[k]) - true[name]) / sd,
                "moved": one.moved_sd,
                "score": one.score_sd,
                "adjusted": one.p_adjusted,
                "in_question": one.in_question,
                "pushed_by": [list(push.causes) for push in pushes],
                "after_moved": None if after is None else after.moved_sd,
            }
        )
    return rows


def summary(found: list[Json]) -> Json:
    """Return the shares over all studies, with what they are of."""
    hidden = [one for one in found if one["kind"] != "none"]
    plain = [one for one in found if one["kind"] == "none"]
    rows = [(one, row) for one in hidden for row in one["parameters"]]
    right = [(one, row) for one, row in rows if abs(row["all_else_off"]) <= PUSHED]
    misled = [row for _, row in rows if abs(row["all_else_off"]) > PUSHED < abs(row["off"])]
    planted = [(one, row) for one, row in right if _by(row) > PUSHED]
    off = [row["in_question"] for _, row in right if abs(row["off"]) > PUSHED]
    flagged = [(one, row) for one, row in planted if row["in_question"]]
    accused = [row for _, row in rows if row["in_question"]]
    normal = [row for _, row in rows if abs(row["off"]) <= NORMAL]
    false = [any(row["in_question"] for row in one["parameters"]) for one in plain]
    named = [  # none where causes were not searched for
        (any(set(causes) & set(one["hidden"]) for causes in row["pushed_by"]), row["pushed_by"])
        for one, row in flagged
        if one["kind"] != "outside" and one["searched"]
    ]
    back = [
        abs(row["after_moved"]) < NORMAL for _, row in flagged if row["after_moved"] is not None
    ]
    return {
        "studies_with": len(hidden),
        "studies_without": len(plain),
        "lying_found": _share([row["in_question"] for _, row in planted]),
        "planted": len(planted),
        "planted_in_studies": len({one["number"] for one, _ in planted}),
        **{
            f"lying_found_{size:.0f}_sd": _share(
                [row["in_question"] for _, row in planted if _by(row) > size]
            )
            for size in STRICTER
        },
        "off_truth_found": _share(off),
        "lying_false": _share(false),
        "false_studies": sum(false),
        "accused": len(accused),
        "accused_within_normal_range": _share([abs(row["off"]) <= NORMAL for row in accused]),
        "normal_accused": _share([row["in_question"] for row in normal]),
        "cause_right": _share([is_right for is_right, _ in named]),
        "cause_none_said": _share([not said for _, said in named]),
        "returned": _share(back),
        "all_else_misled": len(misled),
        "all_else_misled_found": _share([row["in_question"] for row in misled]),
    }


def _by(row: Json) -> float:
    """Return how far an effect has pushed a parameter, off the truth and off the refit [sd]."""
    return float(min(abs(row["off"]), abs(row["pushed"])))


def _share(found: list[bool]) -> float | None:
    return float(np.mean(found)) if found else None


def run_all(count: int, without: int, *, seed: int, causes: bool) -> Iterator[Json]:
    """Judge studies one after another; those in the store are read."""
    store = STORE / f"seed-{seed}{'-causes' * causes}"
    store.mkdir(parents=True, exist_ok=True)
    for study in studies(count, without, seed=seed):
        path = store / f"{study.number}.json"
        if not path.exists():
            found = judged(study, store / str(study.number), seed=seed, causes=causes)
            part = path.with_suffix(".part")
            part.write_text(json.dumps(found), encoding="utf-8")
            part.replace(path)
        yield json.loads(path.read_text(encoding="utf-8"))


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=40, help="with an effect")
    parser.add_argument("--without", type=int, default=40, help="without one")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--causes", action="store_true", help="search for causes, which takes long")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = []
    how = {"seed": options.seed, "causes": options.causes}
    for one in run_all(options.studies, options.without, **how):
        found.append(one)
        if not options.json:
            said = [
                (row["parameter"], round(row["off"], 1), row["pushed_by"])
                for row in one["parameters"]
                if row["in_question"]
            ]
            print(len(found), one["kind"], list(one["hidden"]), "->", said, flush=True)
    print(json.dumps(summary(found), indent=1))


if __name__ == "__main__":
    main()
