"""Effects outside the catalogue: how often they are named as an entry, and how well described.

    uv run python benchmarks/unknown_effects.py --studies 60 --none 30 --json

makes studies in which something acts that no cause of the catalogue is, each of a form of physics
of its own, with the second surrogate of the fine finite element model (see ``fine_library.py``),
judges each from its folder alone as ``bayesdeg run`` does at quick effort, and holds what is said
against what was hidden: the outcome, and the term that the misfit asks for. It is right if it is a
function of the columns on which the effect depends, and changes the readings the same way. Studies
with nothing hidden say how often a term is given by chance.

Finished studies are kept in ``.cache/unknown_effects`` and not judged again.
"""

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from hidden_effects import _column, library
from hidden_studies import OUTSIDE, HiddenStudy, made
from hidden_summary import share
from physics.imitations import outside_effect
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import JUDGE_EFFORTS, Judgement, judge
from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.cause import Cause, Conditions, Effect, Stage
from bayesdeg.criticism.checks.missing_terms import MissingTerms, missing_terms
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.truth import HiddenEffect
from bayesdeg.pages.wording import worded

Json = dict[str, Any]

STORE = Path(".cache/unknown_effects")
SEED = 41
TOP = 200.0  # kPa, the largest pressure of the designs
PRESSURE, SIZE, LOAD = "pressure", "size", "pressure over modulus"
RATE, LEVEL, BRANCH, CYCLE, MOUNT = "degradation rate", "level", "branch", "cycle", "mount"
LAG, TIME = "largest load so far", "time"


def _droop(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A regulator that gives way at high pressure."""
    lost = effect["lost"] * np.square(inputs.pressure / TOP)
    return replace(inputs, pressure=inputs.pressure * (1.0 - lost))


def _lens(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """A lens that stretches the edge of the picture, where the part is when it is bent far."""
    gain = 1.0 + effect["gain"] * np.square(prediction.curvature / 20.0)
    return replace(prediction, curvature=gain * prediction.curvature)


def _cross_links(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A reaction that stiffens the walls, not the films, once enough has degraded."""
    beyond = np.maximum(conditions.degradation - 12.0, 0.0) / 13.0
    factor = np.exp(effect["log_ratio"] * beyond)
    return replace(inputs, c1=inputs.c1 * factor, c2=inputs.c2 * factor, c3=inputs.c3 * factor)


def _another_day(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """The picture of the unloaded part was taken of another one on the day of one rate."""
    that_day = np.abs(conditions.degradation - 20.0) < 3.0
    return replace(
        prediction,
        curvature=prediction.curvature + effect["shift"] * that_day,
        bend_angle=prediction.bend_angle + 2.0 * effect["shift"] * that_day,
    )


def _sticking_valve(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """A valve that holds some pressure back on the way down."""
    return replace(inputs, pressure=inputs.pressure + effect["held"] * conditions.unloading)


def _second_camera(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """The second cycle was filmed by another camera, of another scale."""
    gain = 1.0 + effect["gain"] * (conditions.cycle > 1)
    return replace(
        prediction, curvature=gain * prediction.curvature, bend_angle=gain * prediction.bend_angle
    )


def _loose_clamp(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """The clamp of one mount gives way in proportion to the load."""
    given = 1.0 - effect["given"] * (conditions.mount == "hanging")
    return replace(
        prediction, curvature=given * prediction.curvature, bend_angle=given * prediction.bend_angle
    )


def _friction(prediction: Prediction, conditions: Conditions, effect: Effect) -> Prediction:
    """The part rubs on the table until it lifts off."""
    held = effect["held"] * np.exp(-conditions.pressure / 30.0)
    return replace(
        prediction,
        curvature=prediction.curvature * (1.0 - held),
        bend_angle=prediction.bend_angle * (1.0 - held),
    )


#: By form: what acts, on what stage, its size, in which designs, and on which columns it depends.
FORMS = {
    "droop": (_droop, Stage.LOAD, {"lost": 0.15}, ("curvature", "angle"), {PRESSURE}),
    "lens": (_lens, Stage.READING, {"gain": 0.15}, ("curvature", "angle"), {SIZE, LOAD}),
    "cross_links": (
        *(_cross_links, Stage.MATERIAL, {"log_ratio": 0.45}),
        *(("curvature", "angle"), {RATE, LEVEL}),
    ),
    "another_day": (
        *(_another_day, Stage.READING, {"shift": 1.2}),
        *(("curvature", "angle"), {RATE, LEVEL}),
    ),
    "sticking_valve": (
        *(_sticking_valve, Stage.LOAD, {"held": 6.0}),
        *(("history",), {BRANCH, LAG}),
    ),
    "second_camera": (
        *(_second_camera, Stage.READING, {"gain": -0.08}),
        *(("history",), {CYCLE, TIME}),
    ),
    "loose_clamp": (_loose_clamp, Stage.READING, {"given": 0.06}, ("mounts",), {MOUNT}),
    "friction": (_friction, Stage.READING, {"held": 0.5}, ("curvature", "angle"), {PRESSURE}),
}
#: Columns of the forms that studies with hidden effects have too; of a second gauge there is none.
OF_OUTSIDE = {
    "outside_gauge_wave": {PRESSURE},
    "outside_one_batch": {RATE, LEVEL},
    "outside_slipping": {PRESSURE},
    "outside_contact": {SIZE, LOAD},
    "outside_second_gauge": set(),
}


def _cause(form: str) -> Cause:
    act, stage, typical, _, _ = FORMS[form]
    [(name, size)] = typical.items()
    hook = "on_reading" if stage is Stage.READING else "on_inputs"
    hooks: dict[str, Any] = {hook: act}
    return Cause(
        name=form,
        mechanism=str(act.__doc__),
        revealed_by="nothing in the catalogue",
        **hooks,
        **outside_effect(name, "–", abs(size), stage) | {"typical": typical},
    )


def drawn(number: int, *, seed: int, none: bool) -> HiddenStudy:
    """Draw a study: every form in turn, of a size and in a design by chance."""
    generator = np.random.default_rng((seed, number, none))
    if none:
        design = str(generator.choice(["curvature", "angle", "history", "mounts"]))
        return HiddenStudy(number, "none", design, (), 0.0)
    causes = {**{form: _cause(form) for form in FORMS}, **{one.name: one for one in OUTSIDE}}
    name = list(causes)[number % len(causes)]
    designs = FORMS[name][3] if name in FORMS else ("curvature", "angle")
    size = float(generator.choice([1.0, 1.5]))
    values = {key: size * value for key, value in causes[name].typical.items()}
    hidden = HiddenEffect(causes[name], values)
    return HiddenStudy(number, "outside", str(generator.choice(designs)), (hidden,), size)


def judged(study: HiddenStudy, folder: Path, *, seed: int) -> Json:
    """Make one study, judge it from its folder, and return what was said beside the truth."""
    made(study, folder, forward=library(), seed=seed, command="benchmarks/unknown_effects.py")
    (folder / "truth.json").unlink()
    start = time.perf_counter()
    with threadpool_limits(limits=1):
        assembly = assemble(read_study(folder))
        fitting, judging = np.random.SeedSequence(study.number).spawn(2)
        base = base_without_chain(assembly.model, fitting)
        judgement = judge(assembly, base, effort=JUDGE_EFFORTS["quick"], seed=judging)
    found = _terms(judgement)
    return {
        "seed": seed,
        "number": study.number,
        "kind": study.kind,
        "design": study.design,
        "size": study.size,
        "hidden": list(study.names),
        "outcome": str(judgement.decision.outcome),
        "causes": list(judgement.decision.causes),
        "reasons": [worded(one) for one in judgement.decision.reasons],
        "p_value": judgement.misfit.p_value,
        "terms": [one.term.formula for one in found.terms],
        "p_terms": found.p_value,
        **_held_against(judgement, study, found),
        "seconds": time.perf_counter() - start,
    }


def _terms(judgement: Judgement) -> MissingTerms:
    """Return the terms of the base model's misfit, whatever the outcome."""
    step = judgement.steps[0]
    return missing_terms(step.trial.linear, step.simulated, step.misfit)


def _held_against(judgement: Judgement, study: HiddenStudy, found: MissingTerms) -> Json:
    """Return whether the terms have the columns of the effect, and its sign."""
    if not study.effects:
        return {}
    [hidden] = study.effects
    name, linear = hidden.cause.name, judgement.steps[0].trial.linear
    wanted = FORMS[name][4] if name in FORMS else OF_OUTSIDE[name]
    column = _column(linear, hidden)
    said: Json = {"visible": float(np.linalg.norm(column)), "wanted": sorted(wanted)}
    if not found.terms:
        return said | {"columns_right": False, "sign_right": False, "among_alike": False}
    first = found.terms[0]
    own = linear.whiten_columns(first.change[:, None])[:, 0]
    alike = [set(one.term.columns) for one in first.alike]
    return said | {
        "columns_right": bool(wanted & set(first.term.columns)),
        "among_alike": any(wanted & columns for columns in (set(first.term.columns), *alike)),
        "sign_right": bool(own @ column > 0.0),
    }


def summary(found: list[Json]) -> Json:
    """Return the figures of the benchmark."""
    outside = [one for one in found if one["kind"] == "outside"]
    none = [one for one in found if one["kind"] == "none"]
    described = [one for one in outside if one["wanted"] and one["outcome"] == "unexplained"]
    return {
        "outside_studies": len(outside),
        "outside_catalogue_named": share(one["outcome"] == "named" for one in outside),
        "outside_unexplained": share(one["outcome"] == "unexplained" for one in outside),
        "outside_adequate": share(one["outcome"] == "adequate" for one in outside),
        "described_studies": len(described),
        "described": share(one["columns_right"] and one["sign_right"] for one in described),
        "described_or_as_good": share(
            one["among_alike"] and one["sign_right"] for one in described
        ),
        "with_a_term": share(bool(one["terms"]) for one in described),
        "none_studies": len(none),
        "false_terms": share(bool(one["terms"]) for one in none),
        "none_named": share(one["outcome"] == "named" for one in none),
        "seconds_per_study": float(np.median([one["seconds"] for one in found])),
        "by_form": {
            name: [_line(one) for one in outside if one["hidden"] == [name]]
            for name in dict.fromkeys(one["hidden"][0] for one in outside)
        },
    }


def _line(one: Json) -> str:
    said = "+".join(one["causes"]) or one["outcome"]
    return f"{said}: {'; '.join(one['terms']) or 'no term'}"


def _one(number: int, *, seed: int, none: bool) -> Json:
    name = f"{'none' if none else 'outside'}-{number}"
    path = STORE / f"seed-{seed}" / f"{name}.json"
    if path.exists():
        return dict(json.loads(path.read_text(encoding="utf-8")))
    found = judged(drawn(number, seed=seed, none=none), path.with_suffix(""), seed=seed)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(found), encoding="utf-8")
    part.replace(path)
    return found


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=60)
    parser.add_argument("--none", type=int, default=30)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    (STORE / f"seed-{options.seed}").mkdir(parents=True, exist_ok=True)
    plans = [(n, False) for n in range(options.studies)] + [(n, True) for n in range(options.none)]
    found = []
    for number, none in plans:
        found.append(_one(number, seed=options.seed, none=none))
        if not options.json:
            print(found[-1]["hidden"], _line(found[-1]), flush=True)
    print(json.dumps(summary(found), indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
