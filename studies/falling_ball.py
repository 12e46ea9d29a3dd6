"""What 63 fall times of a ball say of gravity, and of what t = √(2h/g) leaves out.

Real data (``data/falling_ball.csv``): a ball let fall from 21 heights in three rounds. The formula
is criticised with g unknown and with g known; the catalogue has drag, a watch that is late or
early, and an error of the release height. Run as ``python studies/falling_ball.py [--json]
[--seed N]``.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.fit.trials import try_causes
from bayesdeg.inference.model import Model
from bayesdeg.observations.readings import Formula, Readings, places_of
from bayesdeg.pipeline.judge import Judgement, judge_model
from bayesdeg.pipeline.summary import lines, summary
from bayesdeg.priors import HalfNormal, Normal, Parameter, TruncatedNormal, Uniform

Floats = NDArray[np.float64]

DATA = Path(__file__).parent / "data" / "falling_ball.csv"
GRAVITY = 9.81  # m/s²
DRAG_SIZES = (0.03, 0.05, 0.1, 0.2, 0.5)  # 1/m; a steel ball has 0.004, one for table tennis 0.12


class Fall(NamedTuple):
    """What a fall time depends on: height [m], gravity [m/s²], drag coefficient [1/m]."""

    height: Floats
    gravity: Floats | float
    drag: Floats | float = 0.0


def fall_time(fall: Fall, height: Floats) -> Floats:
    """Return times [s] of v' = g − c v² from rest, arcosh(exp(c h))/√(c g); √(2h/g) for c = 0.

    It goes on smoothly below c = 0; heights below zero have no answer.
    """
    x = fall.drag * fall.height
    over = np.expm1(x) + 0j
    with np.errstate(invalid="ignore", divide="ignore"):
        longer = (np.log1p(over + np.sqrt(over * (over + 2.0))) / np.sqrt(2.0 * x + 0j)).real
        free = np.sqrt(2.0 * fall.height / fall.gravity)
    return free * np.where(x == 0.0, 1.0, longer)


DRAG = Cause(
    "drag",
    Stage.LOAD,
    (Parameter("coefficient", TruncatedNormal(0.0, 0.1, 0.0), "1/m", "c of v' = g − c v²", 0.0),),
    "air slows the ball in proportion to the square of its speed",
    {"coefficient": 0.1},
    "times that grow faster than √h; refuted by the ball's mass and diameter, c = ρ C_d A/(2m)",
    on_inputs=lambda fall, height, effect: fall._replace(drag=fall.drag + effect["coefficient"]),
)
REACTION_TIME = Cause(
    "reaction_time",
    Stage.READING,
    (Parameter("delay", Normal(0.0, 0.1), "s", "stop of the watch less its start", 0.0),),
    "the watch is stopped later, or earlier, than it was started",
    {"delay": 0.1},
    "the same lateness from every height",
    on_reading=lambda time, height, effect: time + effect["delay"],
)
RELEASE_HEIGHT = Cause(
    "release_height",
    Stage.GEOMETRY,
    (Parameter("error", Normal(0.0, 0.05), "m", "true less recorded height", 0.0),),
    "the ball falls from higher, or lower, than recorded",
    {"error": 0.05},
    "lateness from small heights alone",
    on_inputs=lambda fall, height, effect: fall._replace(height=height + effect["error"]),
)
CATALOGUE = (DRAG, REACTION_TIME, RELEASE_HEIGHT)


def model(*, gravity_known: bool) -> Model:
    """Return the formula with the data; what is held out together is a height."""
    height, time = np.genfromtxt(DATA, delimiter=",", skip_header=3).T
    error = Parameter("timing_error", HalfNormal(0.1), "s", "sd of a time")
    gravity = Parameter("g", Uniform(5.0, 15.0), "m/s²", "free fall")
    labels = np.array([f"{h:g} m" for h in height])
    rounds = np.repeat(["round 1", "round 2", "round 3"], len(height) // 3)
    times = Readings(
        time,
        places_of(height, kind="fall time", specimen=labels, history=rounds),
        error=lambda values, times: values["timing_error"],
    )
    formula = Formula(
        fall_time,
        inputs=lambda values, height: Fall(height, values.get("g", np.array(GRAVITY))),
    )
    return Model((error,) if gravity_known else (gravity, error), (times,), formula)


def drag_by_prior(judgement: Judgement, sd: float) -> list[float]:
    """Return the log Bayes factor of drag with another prior sd, and mean and sd of g if any."""
    size = replace(DRAG.parameters[0], law=TruncatedNormal(0.0, sd, 0.0))
    base, generator = judgement.search.base, np.random.default_rng(0)
    trial = try_causes(base, replace(DRAG, parameters=(size,)), np.array([0.1]), generator)
    known = "g" not in trial.subject.table.names
    g = np.array(GRAVITY) if known else trial.named_draws("g", generator)
    return [trial.log_evidence - base.log_evidence, float(np.mean(g)), float(np.std(g))]


def run(seed: int) -> dict[str, Any]:
    """Judge the formula with g unknown and with g known."""
    answers = {}
    for title, known in (("g unknown", False), ("g known", True)):
        found = judge_model(model(gravity_known=known), CATALOGUE, seed=seed)
        priors = {f"{sd:g} 1/m": drag_by_prior(found, sd) for sd in DRAG_SIZES}
        answers[title] = {**summary(found), "drag_by_prior": priors}
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
    for title, answer in answers.items():
        print("\n".join((f"== {title}", *lines(answer))))
        least = answer["threshold"]
        print(f"drag, by the sd of its prior; to be named it takes {least:.1f}:")
        for sd, (factor, g, g_sd) in answer["drag_by_prior"].items():
            word = "enough" if factor >= least else "too little"
            gravity = f"; g = {g:.2f} ± {g_sd:.2f} m/s²" if g_sd else ""
            print(f"  {sd}: ln Bayes factor {factor:+.1f}, {word}{gravity}")


if __name__ == "__main__":
    main()
