"""Mishaps of a laboratory in virtual studies: found, taken for physics, or hiding a cause?

    uv run python benchmarks/mishaps.py --studies 120 --json

Studies are made with the second surrogate of the fine finite element model (``fine_library.py``),
as those of ``hidden_effects.py``: a third without anything, a third with a mishap of
`physics.mishaps`, a third with a mishap and a cause. A mishap changes the file that was
written; the study is then looked through, calibrated and judged from its folder alone, as
``bayesdeg run`` does at quick effort. With ``--record FILE`` studies in the file are not judged
again; ``--search`` looks for suspects and judges nothing, for what is found alone, in seconds a
study; ``--whole`` sets nothing aside, for what the verdicts would be; ``--causes`` looks for
suspects in the studies of ``hidden_effects.py``, which have causes and no mishaps.

Keys: ``mishap_named`` is the share of studies with a mishap alone in which a cause is named;
``mishap_found`` that in which the specimens or readings at fault are among the suspects: one of
them for a mishap of one specimen, half of them else; ``visible_mishap_found`` the same of those
that show by five standard deviations, to whoever knows what to look for (`shown_by`);
``cause_beside_mishap_named`` the share of studies with a cause beside a mishap in which that cause
alone is named, or stands in a set that cannot be told apart, of those in which the same study
without the mishap is judged so;
``false_suspects`` the share of studies without a mishap that have a suspect, ``sound_aside`` that
of those in which one is set aside; ``innocent_aside`` that of studies with a mishap in which a
sound specimen, or a reading of one, is set aside too.
"""

import argparse
import json
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hidden_effects import SEED as HIDDEN
from hidden_effects import _planted, library
from hidden_studies import HiddenStudy, _sized, drawn_study, made
from numpy.typing import NDArray
from physics.mishaps import MISHAPS, Mishap, happen
from threadpoolctl import threadpool_limits

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.analysis.judge import JUDGE_EFFORTS, judge
from bayesdeg.assembly.aside import Exclusion
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.suspects import assemble_screened
from bayesdeg.criticism.checks.suspects import parts_of
from bayesdeg.data.plausibility import doubts
from bayesdeg.data.settings import SuspectOptions
from bayesdeg.data.study import Study, read_study
from bayesdeg.inference.laplace import find_mode
from bayesdeg.inference.model import JointModel, near_films
from bayesdeg.laboratory.truth import Truth
from bayesdeg.observations.curvature import ANGLE, CURVATURE
from bayesdeg.progress import Silent

Json = dict[str, Any]
Floats = NDArray[np.float64]

STORE = Path(".cache/mishaps")
SEED = 41
KINDS = ("none", "mishap", "beside")
CAUSES = ("pressure_offset", "erosion", "curvature_reading", "shrinkage_reading")
"""Hidden beside mishaps: each is plain in these designs, and named where nothing else is wrong."""
CAUSE_SIZE = 1.8
WITH_ANGLE = ("short_lengths",)  # lengths show in curvature over bend angle alone
TOLD = ("duplicated_curve", "survivors_only")  # what columns alone say, and `check` already
IN_COLUMNS = (*TOLD, "other_unit")  # need no comparison with other specimens
HALF, VISIBLE = 0.5, 5.0
OF_ERRORS = ("noise", "noise_floor", "noise_length", "correlation", "scatter")


def drawn(number: int) -> tuple[str, str, str, str]:
    """Return kind, mishap, cause and design of a study, each in turn."""
    kind = KINDS[number % len(KINDS)]
    names = list(MISHAPS)
    mishap = "" if kind == "none" else names[(number // len(KINDS)) % len(names)]
    cause = CAUSES[(number // 7) % len(CAUSES)] if kind == "beside" else ""
    with_angle = mishap in WITH_ANGLE or cause == "shrinkage_reading" or number % 2 == 0
    return kind, mishap, cause, "angle" if with_angle else "curvature"


def written(number: int, folder: Path, *, spoilt: bool) -> tuple[Mishap | None, float | None]:
    """Write a study, with its mishap unless it is to be left out; return it, and how it shows.

    Of mistraced pictures those are kept in mind that are off by more than `VISIBLE` errors.
    """
    kind, name, cause, design = drawn(number)
    generator = np.random.default_rng((SEED, number))
    effects = (_sized(cause, CAUSE_SIZE, generator),) if cause else ()
    study = HiddenStudy(number, "single" if cause else "none", design, effects, CAUSE_SIZE)
    command = f"benchmarks/mishaps.py, study {number}"
    _, truth = made(study, folder, forward=library(), seed=SEED, command=command)
    (folder / "truth.json").unlink()
    if kind == "none" or not spoilt:
        return None, None
    path = folder / "actuator.csv"
    before, state = pd.read_csv(path, comment="#"), generator.bit_generator.state
    readings, mishap = happen(name, before, generator)
    generator.bit_generator.state = state
    shown = None if name in IN_COLUMNS else shown_by(name, read_study(folder), truth, generator)
    readings.to_csv(path, index=False)
    if name != "mistraced_pictures":
        return mishap, shown
    curvature = before["curvature_per_m"]
    error = np.hypot(truth.curvature_noise_floor, truth.curvature_noise * curvature)
    clear = np.abs(readings["curvature_per_m"] - curvature) > VISIBLE * error
    return replace(mishap, rows=tuple(row for row in mishap.rows if clear[row])), shown


def shown_by(name: str, sound: Study, truth: Truth, generator: np.random.Generator) -> float:
    """Return by how many standard deviations a mishap shows to whoever knows what to look for.

    That is the length of what it does to readings without error, on the scale on which errors of
    reading and scatter of specimens, both as they truly are, and all that specimens have in common
    are white.
    """
    with threadpool_limits(limits=1):
        model = assemble(sound).model
        start = near_films(model, np.random.default_rng(0))
        assert start is not None
        mode = find_mode(model, start)[0]
        values = {name: value[0] for name, value in model.table.named(mode[None]).items()}
        true = {n: getattr(truth, n) for n in values if n.endswith(OF_ERRORS) and hasattr(truth, n)}
        vector = model.table.vectors({n: np.array(value) for n, value in (values | true).items()})
        parts = parts_of(model, np.asarray(vector))
        whitening = parts.whitening(1.0, np.ones(len(parts.residual)))
        change = _change(name, sound, model, model.expected(mode[None])[0], generator)
        return float(np.linalg.norm(whitening.whitened(change)))


def _change(
    name: str, sound: Study, model: JointModel, expected: Floats, generator: np.random.Generator
) -> Floats:
    """Return what a mishap changes readings by that are as a model expects them, (n,)."""
    assert sound.actuator is not None
    table, places = sound.actuator.reset_index(drop=True), model.places
    column = {CURVATURE: "curvature_per_m", ANGLE: "bend_angle_deg"}
    row = {
        key: k
        for k, key in enumerate(zip(table["specimen_id"], table["pressure_kPa"], strict=True))
    }
    at = [
        (i, row[places.specimen[i], places.along[i]], column[places.kind[i]])
        for i in np.flatnonzero(np.isin(places.kind, list(column)))
    ]
    for i, k, one in at:
        table.loc[k, one] = expected[i]
    spoilt, _ = happen(name, table, generator)
    found = np.zeros(len(expected))
    for i, k, one in at:
        found[i] = spoilt[one].to_numpy(float)[k] - table[one].to_numpy(float)[k]
    return found


def judged(
    number: int, folder: Path, *, spoilt: bool = True, search: bool = False, whole: bool = False
) -> Json:
    """Make a study, look it through and judge it; return what was found beside the truth."""
    mishap, shown = written(number, folder, spoilt=spoilt)
    kind, name, cause, design = drawn(number)
    with threadpool_limits(limits=1):
        study = keeping_all(read_study(folder)) if whole else read_study(folder)
        begun = time.perf_counter()
        assembly = assemble_screened(study)
        seconds = time.perf_counter() - begun
        known = [str(one.fault.problem) for one in doubts(study, outline(study).expected)]
        found = {
            "number": number,
            "kind": kind,
            "mishap": name,
            "cause": cause,
            "design": design,
            "spoilt": spoilt,
            "size": None if mishap is None else mishap.size,
            "shown_by": shown,
            "found": None if mishap is None else was_found(mishap, study, assembly.aside, known),
            "innocent": innocent(mishap, assembly.aside),
            "aside": [_short(one) for one in assembly.aside],
            "doubts": known,
            "seconds_screened": seconds,
        }
        if search:
            return found
        fitting, judging = np.random.SeedSequence(number).spawn(2)
        base = base_without_chain(assembly.model, fitting)
        effort = JUDGE_EFFORTS["quick"]
        judgement = judge(assembly, base, effort=effort, seed=judging, progress=Silent())
    decision, confusable = judgement.decision, judgement.confusability
    rivals = confusable.rivals(cause) if cause in confusable.names else []
    return found | {
        "outcome": str(decision.outcome),
        "causes": list(decision.causes),
        "one_of": [list(names) for names in decision.one_of],
        "rivals": list(rivals),
        "seconds": time.perf_counter() - begun,
    }


def with_causes(number: int) -> Json:
    """Look through a study of ``hidden_effects.py``; return what was found."""
    folder = STORE / f"causes-{number}"
    study = drawn_study(number, seed=HIDDEN)
    _planted(study, folder, HIDDEN)
    with threadpool_limits(limits=1):
        begun = time.process_time()
        assembly = assemble_screened(read_study(folder))
    return {
        "number": number,
        "kind": study.kind,
        "hidden": list(study.names),
        "aside": [_short(one) for one in assembly.aside],
        "lost": innocent(None, assembly.aside),
        "seconds": time.process_time() - begun,
    }


def keeping_all(study: Study) -> Study:
    """Return a study that sets nothing aside."""
    settings = replace(study.settings, suspects=SuspectOptions(set_aside=False))
    return replace(study, settings=settings)


def _short(one: Exclusion) -> list[object]:
    suspect = one.suspect
    if suspect is None:
        return ["unit", list(one.specimens), None, None]
    way = str(suspect.hypothesis.oddity)
    return [way, list(one.specimens), suspect.size, suspect.score, suspect.p_value, one.is_out]


def was_found(
    mishap: Mishap, study: Study, aside: Iterable[Exclusion], known: Iterable[str]
) -> bool:
    """Return whether what is at fault is among the suspects.

    Of a mishap of one specimen that is the specimen, of mistraced or cut-off pictures at least half
    of them, of several specimens at least half. A pair is found if both are.
    """
    if mishap.name == "duplicated_curve":
        return any("to the last digit" in one for one in known)
    if mishap.name == "survivors_only":
        return any("survivors" in one for one in known)
    specimens, readings = set(), set()
    for one in aside:
        if one.readings:
            readings |= {(name, along) for name, along, *_ in one.readings}
        else:
            specimens |= set(one.specimens)
    assert study.actuator is not None
    table = study.actuator.iloc[list(mishap.rows)]
    if mishap.name in ("mistraced_pictures", "cut_off"):
        keys = list(zip(table["specimen_id"].astype(str), table["pressure_kPa"], strict=True))
        hits = [key[0] in specimens or key in readings for key in keys]
        return not hits or float(np.mean(hits)) >= HALF
    named = specimens | {name for name, _ in readings}
    share = len(named & set(mishap.specimens)) / len(mishap.specimens)
    return share == 1.0 if mishap.name == "exchanged_labels" else share >= HALF


def innocent(mishap: Mishap | None, aside: Iterable[Exclusion]) -> list[str]:
    """Return specimens that are set aside, or of which readings are, without any at fault."""
    wrong = set() if mishap is None else set(mishap.specimens)
    return sorted({name for one in aside if one.is_out for name in one.specimens} - wrong)


def right(one: Json) -> bool:
    """Return whether the hidden cause alone is named, or a set that the study cannot tell apart."""
    causes, cause = one["causes"], one["cause"]
    if one["outcome"] == "named":
        return causes == [cause] and not one["one_of"]
    inseparable = cause in causes and set(causes) <= {cause, *one["rivals"]}
    return one["outcome"] == "ambiguous" and inseparable


def is_judged(one: Json) -> bool:
    """Return whether a study has a verdict, not only suspects."""
    return "outcome" in one


def summary(found: list[Json]) -> Json:
    """Return the figures of the benchmark."""
    hidden = [one for one in found if one["cause"] and is_judged(one)]
    sound = {one["number"]: right(one) for one in hidden if not one["spoilt"]}
    none = [one for one in found if one["kind"] == "none"]
    alone = [one for one in found if one["kind"] == "mishap"]
    beside = [one for one in found if one["kind"] == "beside" and one["spoilt"]]
    comparable = [one for one in beside if is_judged(one) and sound.get(one["number"])]
    spoilt = [*alone, *beside]
    visible = [one for one in spoilt if one["shown_by"] is None or one["shown_by"] >= VISIBLE]
    clean = [one for one in found if not one["spoilt"] or one["kind"] == "none"]
    return {
        "studies": len(found),
        "mishap_named": _share(one["outcome"] == "named" for one in alone if is_judged(one)),
        "mishap_alone_studies": sum(map(is_judged, alone)),
        "mishap_found": _share(one["found"] for one in spoilt),
        "mishap_studies": len(spoilt),
        "visible_mishap_found": _share(one["found"] for one in visible),
        "visible_mishap_studies": len(visible),
        "innocent_aside": _share(bool(one["innocent"]) for one in spoilt),
        "cause_beside_mishap_named": _share(map(right, comparable)),
        "cause_beside_mishap_studies": len(comparable),
        "cause_beside_mishap_named_of_all": _share(right(one) for one in hidden if one["spoilt"]),
        "cause_beside_mishap_all_studies": sum(one["spoilt"] for one in hidden),
        "false_suspects": _share(bool(one["aside"]) for one in clean),
        "sound_aside": _share(bool(one["innocent"]) for one in clean),
        "studies_without_mishap": len(clean),
        "false_doubts": _share(bool(one["doubts"]) for one in clean),
        "none_named": _share(one["outcome"] == "named" for one in none if is_judged(one)),
        "found_by_mishap": {name: _of(spoilt, name, "found") for name in MISHAPS},
        "visible_found_by_mishap": {name: _of(visible, name, "found") for name in MISHAPS},
        "named_by_mishap": {name: _named(alone, name) for name in MISHAPS},
        "seconds_screened": _median(one["seconds_screened"] for one in clean),
        "seconds_screened_with_mishap": _median(one["seconds_screened"] for one in spoilt),
    }


def _of(studies: list[Json], name: str, key: str) -> list[int]:
    met = [bool(one[key]) for one in studies if one["mishap"] == name]
    return [sum(met), len(met)]


def _named(studies: list[Json], name: str) -> dict[str, int]:
    """Return how often which cause was named, or what the outcome was."""
    said = [
        "+".join(one["causes"]) if one["outcome"] == "named" else str(one["outcome"])
        for one in studies
        if one["mishap"] == name and is_judged(one)
    ]
    return {word: said.count(word) for word in dict.fromkeys(said)}


def _share(flags: Iterable[object]) -> float | None:
    found = [bool(flag) for flag in flags]
    return float(np.mean(found)) if found else None


def _median(values: Iterable[float]) -> float | None:
    found = list(values)
    return float(np.median(found)) if found else None


def _known(path: Path | None) -> dict[tuple[int, bool], Json]:
    if path is None or not path.exists():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    return {(one["number"], one["spoilt"]): one for one in map(json.loads, lines)}


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=30)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--kind", choices=KINDS, help="studies of this kind alone")
    parser.add_argument("--record", type=Path, help="file of studies that were judged, to go on")
    parser.add_argument("--search", action="store_true", help="look for suspects, judge nothing")
    parser.add_argument("--whole", action="store_true", help="set nothing aside, for comparison")
    parser.add_argument("--seconds", type=float, default=np.inf, help="to begin no study after")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--causes", action="store_true", help="look through hidden_effects.py's")
    options = parser.parse_args()
    if options.causes:
        for number in range(options.first, options.first + options.studies):
            print(json.dumps(with_causes(number)), flush=True)
        return
    begun, known = time.perf_counter(), _known(options.record)
    how = {"search": options.search, "whole": options.whole}
    found: list[Json] = []
    for number in range(options.first, options.first + options.studies):
        if options.kind not in (None, drawn(number)[0]):
            continue
        for spoilt in (True, False) if drawn(number)[2] else (True,):
            key = (number, spoilt)
            new = key not in known or not (options.search or is_judged(known[key]))
            if new and time.perf_counter() - begun < options.seconds:
                folder = STORE / f"{number}{'' if spoilt else '-sound'}"
                known[key] = judged(number, folder, **how, spoilt=spoilt)
                if options.record is not None:
                    with options.record.open("a", encoding="utf-8") as file:
                        file.write(json.dumps(known[key], ensure_ascii=False) + "\n")
                if not options.json:
                    one = known[key]
                    said = (one.get("outcome"), one.get("causes"), one["aside"])
                    facts = (one["mishap"], one["cause"], one["found"], one["innocent"])
                    print(number, *facts, *said, flush=True)
            if key in known:
                found.append(known[key])
    print(json.dumps(summary(found), indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
