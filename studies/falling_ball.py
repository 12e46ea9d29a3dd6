"""Gravity from 63 fall times of a ball, and the effects missing from t = √(2h/g).

Real data (``data/falling_ball.csv``): a ball dropped from 21 heights in three rounds. The formula
is criticised with g unknown and with g known; the catalogue has drag, a late or early stopwatch,
and an error of the release height. Run as ``python studies/falling_ball.py [--json]
[--seed N]``; ``bayesdeg run studies/fall_times`` writes a report of it.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import bayesdeg as bd
from bayesdeg.analysis.judge import Judgement
from bayesdeg.analysis.summary import lines, summary
from bayesdeg.causes.cause import Cause, Stage
from bayesdeg.criticism.fit.trials import try_causes
from bayesdeg.priors import HalfNormal, Normal, Parameter, TruncatedNormal, Uniform

Floats = NDArray[np.float64]

DATA = Path(__file__).parent / "data" / "falling_ball.csv"
GRAVITY = 9.81  # m/s²
DRAG_SIZES = (0.03, 0.05, 0.1, 0.2, 0.5)  # 1/m; a steel ball has 0.004, one for table tennis 0.12


class Fall(NamedTuple):
    """Inputs of a fall time: height [m], gravity [m/s²], drag coefficient [1/m]."""

    height: Floats
    gravity: Floats | float
    drag: Floats | float = 0.0


def fall_time(fall: Fall, height: Floats) -> Floats:
    """Return times [s] of v' = g − c v² from rest, arcosh(exp(c h))/√(c g); √(2h/g) for c = 0."""
    x = fall.drag * fall.height
    over = np.expm1(x) + 0j
    with np.errstate(invalid="ignore", divide="ignore"):
        longer = (np.log1p(over + np.sqrt(over * (over + 2.0))) / np.sqrt(2.0 * x + 0j)).real
        free = np.sqrt(2.0 * fall.height / fall.gravity)
    return free * np.where(x == 0.0, 1.0, longer)


def predict(values: dict[str, Floats], height: Floats) -> Floats:
    """Return times [s], draws by readings; drag acts where that cause is active."""
    g = values.get("g", np.full(1, GRAVITY))[:, None]
    drag = values.get("drag.coefficient", np.zeros(1))[:, None]
    return fall_time(Fall(height + 0.0 * values["timing_error"][:, None], g, drag), height)


DRAG = Cause(
    "drag",
    Stage.LOAD,
    (Parameter("coefficient", TruncatedNormal(0.0, 0.1, 0.0), "1/m", "c of v' = g − c v²", 0.0),),
    "air slows the ball in proportion to the square of its speed",
    {"coefficient": 0.1},
    "times that grow faster than √h; refuted by the ball's mass and diameter, c = ρ C_d A/(2m)",
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
    on_inputs=lambda height, recorded, effect: height + effect["error"],
)
CATALOGUE = (DRAG, REACTION_TIME, RELEASE_HEIGHT)


def asked(*, gravity_known: bool) -> bd.Model:
    """Return the formula with the data; readings of one height are held out together."""
    height, time = np.genfromtxt(DATA, delimiter=",", skip_header=3).T
    gravity = Parameter("g", Uniform(5.0, 15.0), "m/s²", "free fall")
    times = bd.Readings(
        height,
        time,
        specimen=np.array([f"{h:g} m" for h in height]),
        history=np.repeat(["round 1", "round 2", "round 3"], len(height) // 3),
        name="fall time",
        unit="s",
        error=Parameter("timing_error", HalfNormal(0.1), "s", "sd of a time"),
    )
    return bd.Model(times, predict, parameters=() if gravity_known else (gravity,))


def drag_by_prior(judgement: Judgement, sd: float) -> list[float]:
    """Return the log Bayes factor of drag with a different prior sd, and mean and sd of g."""
    size = replace(DRAG.parameters[0], law=TruncatedNormal(0.0, sd, 0.0))
    base, generator = judgement.search.base, np.random.default_rng(0)
    trial = try_causes(base, replace(DRAG, parameters=(size,)), np.array([0.1]), generator)
    unknown = "g" in trial.subject.table.names
    g = trial.named_draws("g", generator) if unknown else np.array(GRAVITY)
    return [trial.log_evidence - base.log_evidence, float(np.mean(g)), float(np.std(g))]


def run(seed: int) -> dict[str, Any]:
    """Judge the formula with g unknown and with g known."""
    answers = {}
    for title, known in (("g unknown", False), ("g known", True)):
        base = bd.calibrate(asked(gravity_known=known), effort="quick", seed=seed)
        found = bd.criticise(base, CATALOGUE, effort="standard", seed=seed).judgement
        assert found is not None
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
        print(f"drag, by the sd of its prior; naming requires {answer['threshold']:.1f}:")
        for sd, (factor, g, g_sd) in answer["drag_by_prior"].items():
            word = "enough" if factor >= answer["threshold"] else "too little"
            gravity = f"; g = {g:.2f} ± {g_sd:.2f} m/s²" if g_sd else ""
            print(f"  {sd}: ln Bayes factor {factor:+.1f}, {word}{gravity}")


if __name__ == "__main__":
    main()
