"""Efficiency of Brynjarsdóttir and O'Hagan's simple machine (2014) under model error.

A machine does the work w for an effort x. The model is w = θ x; the truth is θ x/(1 + x/20) with
θ = 0.65, since friction grows with the effort. The readings are virtual: 31 efforts from 0.2 to 4 J
with errors of 0.01 J. They are judged with three catalogues: one with the truth, one with the truth
and a cause of nearly the same effect, and one without the truth. Source:
doi:10.1088/0266-5611/30/11/114007. Run as ``python studies/simple_machine.py [--json] [--seed N]``.
"""

import argparse
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

import bayesdeg as bd
from bayesdeg.analysis.judge import Judgement
from bayesdeg.analysis.summary import lines, summary
from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.checks.discrepancy import interval_with_discrepancy
from bayesdeg.priors import HalfNormal, Normal, Parameter, TruncatedNormal, Uniform

Floats = NDArray[np.float64]

EFFICIENCY, FRICTION, ERROR = 0.65, 1.0 / 20.0, 0.01  # –, 1/J, J

GROWING_FRICTION = Cause(
    "growing_friction",
    Stage.RESPONSE,
    (Parameter("growth", TruncatedNormal(0.0, 0.1, 0.0), "1/J", "1/a in x/(1 + x/a)", 0.0),),
    "friction takes a share that grows with the effort: w = θ x/(1 + x/a)",
    {"growth": 0.05},
    "an efficiency that falls with the effort; refuted by one that does not",
    on_reading=lambda work, effort, effect: work / (1.0 + effect["growth"] * effort),
)
SLIP = Cause(
    "slip",
    Stage.RESPONSE,
    (Parameter("share", TruncatedNormal(0.0, 0.1, 0.0), "1/J", "share lost for each J", 0.0),),
    "a share proportional to the effort is lost: w = θ x (1 − s x)",
    {"share": 0.04},
    "an efficiency that falls in proportion to the effort",
    on_reading=lambda work, effort, effect: work * (1.0 - effect["share"] * effort),
)
CONSTANT_LOSS = Cause(
    "constant_loss",
    Stage.LOAD,
    (Parameter("effort", TruncatedNormal(0.0, 0.2, 0.0), "J", "lost before any work", 0.0),),
    "the first part of every effort is lost: w = θ max(x − c, 0)",
    {"effort": 0.1},
    "no work for small efforts",
    on_inputs=lambda effort, recorded, effect: np.maximum(effort - effect["effort"], 0.0),
)
OFFSET = Cause(
    "offset",
    Stage.READING,
    (Parameter("work", Normal(0.0, 0.05), "J", "added to every reading", 0.0),),
    "the scale for the work does not begin at zero",
    {"work": 0.05},
    "work that is read without effort",
    on_reading=lambda work, effort, effect: work + effect["work"],
)
CATALOGUES = {
    "the truth is in the catalogue": (GROWING_FRICTION, CONSTANT_LOSS, OFFSET),
    "so is another cause like it": (GROWING_FRICTION, SLIP, CONSTANT_LOSS, OFFSET),
    "the truth is not in the catalogue": (CONSTANT_LOSS, OFFSET),
}


def readings(effort: Floats, generator: np.random.Generator) -> Floats:
    """Return the readings of the true machine's work [J]."""
    work: Floats = EFFICIENCY * effort / (1.0 + FRICTION * effort)
    return work + ERROR * generator.standard_normal(len(effort))


def machine(values: dict[str, Floats], effort: Floats) -> Floats:
    """Return the work of w = θ x [J], draws by readings."""
    return values["efficiency"][:, None] * effort


def asked(seed: int, *, count: int = 31) -> bd.Model:
    """Return w = θ x with virtual readings; θ and their error are unknown."""
    effort = np.linspace(0.2, 4.0, count)
    work = bd.Readings(
        effort,
        readings(effort, np.random.default_rng(seed)),
        specimen=np.array([f"{x:.3g} J" for x in effort]),
        name="work",
        unit="J",
        error=Parameter("reading_error", HalfNormal(0.02), "J", "sd of a reading"),
    )
    efficiency = Parameter("efficiency", Uniform(0.0, 1.0), "–", "work over effort, θ")
    return bd.Model(work, machine, parameters=(efficiency,))


def without_causes(judgement: Judgement) -> dict[str, list[float]]:
    """Return 90 % intervals of θ if the model is right, and with an added discrepancy."""
    base = judgement.search.base
    draws = base.named_draws("efficiency", np.random.default_rng(0))
    return {
        "as if the model were right": np.quantile(draws, [0.05, 0.95]).tolist(),
        "with a discrepancy of no known cause": list(interval_with_discrepancy(base, "efficiency")),
    }


def run(seed: int) -> dict[str, Any]:
    """Judge the same readings with each catalogue."""
    base, answers = bd.calibrate(asked(seed), effort="quick", seed=seed), {}
    for title, catalogue in CATALOGUES.items():
        verdict = bd.criticise(base, catalogue, effort="standard", seed=seed)
        found = verdict.judgement
        assert found is not None
        answers[title] = {**summary(found), "efficiency_without_causes": without_causes(found)}
    return answers


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    answers = run(arguments.seed)
    if arguments.json:
        print(json.dumps(answers, indent=1, ensure_ascii=False))
        return
    print(f"true efficiency: {EFFICIENCY}; 90 % intervals from w = θ x")
    for words, (low, high) in next(iter(answers.values()))["efficiency_without_causes"].items():
        print(f"  {words}: {low:.3f} to {high:.3f}")
    for title, answer in answers.items():
        print("\n".join((f"== {title}", *lines(answer))))


if __name__ == "__main__":
    main()
