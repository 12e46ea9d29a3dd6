"""Every record of the engine that is put into words: the one place where its sentences are read.

To accept new words: ``python -m tests.pages.test_findings``, and read the changes.
"""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from bayesdeg.analysis.designs import MOUNTS
from bayesdeg.analysis.films import CommonError, CourseSummary
from bayesdeg.analysis.judge import Description
from bayesdeg.analysis.material_laws import FittedLaw, LawComparison, NoiseLevels
from bayesdeg.analysis.order import OrderComparison, OrderFit
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.checks.absorption import Absorption, Push
from bayesdeg.criticism.checks.count_misfit import CountMisfit
from bayesdeg.criticism.checks.known_terms import PATHS, Acts, Form, KnownFunction, KnownTerm
from bayesdeg.criticism.checks.missing_terms import AlikeTerm, MissingTerm, MissingTerms
from bayesdeg.criticism.checks.residuals import (
    CurvatureDeparture,
    ReadingsDeparture,
    StressDeparture,
)
from bayesdeg.criticism.decide.counted import Counted, CountedCause
from bayesdeg.criticism.decide.support import Support
from bayesdeg.criticism.decide.verdict import (
    CoarseMap,
    ExcludedSize,
    ImplausibleSize,
    LittlePower,
    MisfitRemains,
    NoReduction,
    NotComputed,
    NotConverged,
    NothingHeldOut,
    NotPredictedBetter,
    NotTested,
    OnEdge,
    SharedByLevel,
    StructureLeft,
    TakenForErrors,
    TooLittleEvidence,
    TooLittleExplained,
    Uncalibrated,
)
from bayesdeg.criticism.experiments.ranking import ExperimentPlan
from bayesdeg.criticism.findings import (
    ColumnMisfit,
    Concentration,
    CountedLevel,
    Displacement,
    LevelMisfit,
)
from bayesdeg.criticism.fit.search import Step
from bayesdeg.criticism.holdout.gain import LooPit, Scatter
from bayesdeg.criticism.holdout.leave_one_out import LeaveOneOut
from bayesdeg.criticism.posterior.convergence import Convergence
from bayesdeg.criticism.posterior.prior_sensitivity import PriorSensitivity, Sensitivity
from bayesdeg.inference.sampling import Effort
from bayesdeg.pages.left_out import OptionalStage
from bayesdeg.pages.record import BurstEntry, MemberEntry, UpdateEntry, VerdictRecord
from bayesdeg.pages.wording import environment, sentences, worded
from bayesdeg.prediction.control import Allowed, Setting
from bayesdeg.prediction.lifetime import Duty, LifeSummary
from bayesdeg.prediction.prior_predictive import PriorPredictive
from bayesdeg.run.run_record import VendorCheck, VendorFigure

WORDS = Path(__file__).with_name("findings.json")
NAN = float("nan")

CURVATURE = CurvatureDeparture(
    -0.293, (20.0, 80.0), (0.0, 12.4), everywhere=True, agreeing=17, specimens=18
)
STRESS = StressDeparture((("uniaxial", 0.3124), ("planar", 0.0385)), above=False)
SAMPLED = Convergence(
    names=("c1_at_0", "volume_ratio"),
    r_hat=(1.0021, 1.2345),
    ess_bulk=(1284.4, 962.2),
    ess_tail=(652.1, 911.0),
    steps=60,
    walkers=10,
    ensembles=4,
    usable=True,
    tau=(2.04, 10.62),
    effort=Effort(effective=2000.0, r_hat=1.01, chunk=100, longest=1000),
    more_helps=True,
)
PIT = LooPit(*[np.zeros(1)] * 5, 0.01, Scatter.AS_PREDICTED, NAN, replicates=300, drawn=400)
LEFT_OUT = LeaveOneOut(
    specimens=("s1", "s2", "s3"),
    kinds=("tensile",) * 3,
    elpd=np.array([27.59, 34.45, 30.33]),
    error=np.array([0.08, 0.12, 0.07]),
    in_sample=np.array([35.59, 36.8, 31.58]),
    pareto_k=np.array([0.62, 0.59, 0.51]),
    refitted=np.array([False, False, False]),
    threshold=0.7,
)
HEAVY = replace(LEFT_OUT, pareto_k=np.array([0.92, 0.8, 0.51]))
MANY = replace(
    LEFT_OUT,
    specimens=tuple(f"s{i}" for i in range(120)),
    **{name: np.linspace(1.0, 2.0, 120) for name in ("elpd", "error", "in_sample", "pareto_k")},
    refitted=np.zeros(120, bool),
)


def sensitivity(quantity, prior, likelihood, shift):
    own = f"{quantity.replace(' ', '_')}_own"
    return Sensitivity(quantity, True, prior, likelihood, 0.01, 0.01, shift, own, "actuator")


DATA = sensitivity("C1 at 0 %", 0.01, 0.2, 0.07)
MOVED = (
    sensitivity("volume ratio", 0.07, 0.2, 0.163),
    sensitivity("paper stiffness", 0.3, 0.01, -0.74),
    sensitivity("creep: size", 0.3, 0.1, 0.4),
)
PRIORS = PriorPredictive(pd.DataFrame(), 0.41, 0.98, 1.0)


def order(number, elpd, log_evidence):
    count = len(elpd)
    none = np.zeros(count)
    return OrderFit(
        number, 3 * number, log_evidence, 0.03, 900.0, np.array(elpd), none, none.astype(bool)
    )


SECOND = order(2, [20.0, 41.0, 50.0], 14.0)
WORSE, SIMPLER = order(1, [9.0, 20.0, 31.0], -30.0), order(1, [20.0, 40.5, 50.6], 15.0)
HIGHER = order(3, [90.0, 91.0, 92.0], 20.0)


def fitted_law(name, elpd, error):
    elpd, errors = np.array(elpd), np.full(len(elpd), error)
    noise = NoiseLevels(0.01, 0.02, 0.03, 0.05)
    return FittedLaw(name, 3, ({},), np.ones(1), noise, errors, errors, elpd)


def laws(*fits, modes=("uniaxial",)):
    count = len(fits[0].elpd)
    return LawComparison(fits, "yeoh", np.zeros(count), np.full(count, 5), modes)


YEOH = fitted_law("yeoh", [20.0, 21.0, 22.0], 0.0432)
GENT = fitted_law("gent", [12.0, 11.5, 14.0], 0.0914)
OGDEN = fitted_law("ogden", [26.0, 27.5, 28.0], 0.0221)
DOUBTFUL = fitted_law("mooney_rivlin", [20.0, 29.0, 20.0], 0.0397)
ALONE = fitted_law("yeoh", [NAN, NAN], NAN), fitted_law("gent", [NAN, NAN], NAN)
STATED = VendorFigure("modulus_100", "kPa", 68.9, 13.8, "datum", 74.1, 70.2, 78.8)
BROKEN = VendorFigure("elongation_at_break", "%", 900.0, 180.0, "prior", 873.0, 640.0, 1170.0)
NO_ACTUATOR = VendorFigure(
    "elongation_at_break", "%", 900.0, 180.0, "there is no actuator that could burst"
)
COURSE = CourseSummary(63, 25.0, 1.0, (24.31, 22.4, 27.08), (32.1, 28.9, 35.2), 24.0)
ERROR = CommonError(9, 8, 25.0, 0.441, 0.582, 0.731, 0.5)


TEST = ExperimentPlan("unloading", 3, (25.0,), low=20.0, top=240.0)


def specimens(*names):
    return Concentration(
        kind="specimen",
        members=names,
        excess_pct=(-14.2, 9.0)[: len(names)],
        share_of_misfit=0.88,
        share_of_readings=0.063,
        p_value=0.002,
    )


def later(kind, member, share, readings):
    """Most of a misfit in one part of the history."""
    return Concentration(
        kind=kind,
        members=(member,),
        excess_pct=(4.2,),
        share_of_misfit=share,
        share_of_readings=readings,
        p_value=0.004,
    )


def counted_level(degradation, ruptured, *probabilities, of_count):
    probability, low, high = probabilities
    return CountedLevel(
        degradation_pct=degradation,
        pressure_kPa=240.0,
        tested=3,
        ruptured=ruptured,
        probability=probability,
        probability_q05=low,
        probability_q95=high,
        count_probability=of_count,
    )


COUNTS = CountMisfit(
    source="summary.csv",
    levels=(
        counted_level(0.0, 0, 1e-9, 1e-12, 1e-8, of_count=1.0),
        counted_level(25.0, 2, 2e-7, 1e-9, 1e-6, of_count=1e-13),
    ),
    log_probability=-30.0,
    p_value=0.001,
    draws=3000,
    replicates=999,
)


def counted_cause(name, factor, p_value):
    support = Support(name, factor, 20.0, 8.0, {}, 0.1)
    return CountedCause(None, support, replace(COUNTS, p_value=p_value))


def with_rivals(cause, **gaps):
    return replace(cause, support=replace(cause.support, rivals=gaps))


FLAWS = counted_cause("flaw_embrittlement", 44.5, 0.2)
ALIKE = counted_cause("common_factor", 15.3, 0.007)
COUNTED = Counted(COUNTS, (with_rivals(FLAWS, common_factor=29.2), ALIKE), 3.0)
TWO = (with_rivals(FLAWS, dry_embrittlement=1.0), counted_cause("dry_embrittlement", 43.5, 0.3))


def displaced(moved, adjusted, *, median):
    """The volume ratio of films of 0.62, where a model has another."""
    return Displacement(
        parameter="volume_ratio",
        meaning="of the part over its mould",
        unit="–",
        all_else_q05=0.571,
        all_else_q50=0.62,
        all_else_q95=0.668,
        base_q50=median,
        moved_sd=moved,
        learned=0.9,
        score_sd=moved,
        p_alone=adjusted,
        p_adjusted=adjusted,
    )


def absorbed(*displacements, pushes=(), after=()):
    return Absorption.complete(displacements, pushes, after)


def push(*causes, share, factor=80.0):
    return Push(causes, factor, {"volume_ratio": share * 10.46})


HIGH = displaced(10.46, 0.0034, median=0.94)
BACK = displaced(0.31, 1.0, median=0.629)
PUSH = push("pressure_offset", share=0.97)


SCALES = {"curvature": (30.0, "κ", "1/m"), "bend angle": (90.0, "φ", "°")}
STEEP = KnownFunction(PATHS["actuator"], Form.ABOVE, 200.0, 100.0)
FACTOR = KnownTerm(
    "actuator", tuple(SCALES), Acts.FACTOR, (STEEP,), PATHS["actuator"], SCALES, 200.0
)
ALONG = replace(FACTOR, acts=Acts.PATH, functions=(), kinds=("curvature",))


def missing_term(term, **changes):
    found = MissingTerm(
        term, -0.312, -0.401, -0.223, 18.0, 0.00498, 0.87, 9.41, 4.02, (), 0, np.zeros(3), 0.16
    )
    return replace(found, **changes)


def described(*terms, causes=(), share=0.82, p_value=0.00498):
    levels = (
        LevelMisfit(level="20 to 80 kPa", share_of_misfit=0.1, excess=0.02, excess_pct=0.7),
        LevelMisfit(level="160 to 200 kPa", share_of_misfit=0.7, excess=-0.243, excess_pct=-2.25),
    )
    columns = tuple(
        ColumnMisfit(column=name, share_of_misfit=of, kind="curvature", unit="1/m", levels=parts)
        for name, of, parts in (
            ("specimen", share + 0.02, levels * 2),
            ("pressure", share, levels),
            ("level", 0.1, levels),
        )
    )
    trial = SimpleNamespace(names=frozenset(causes))
    step = Step(trial, None, np.zeros((0, 3)), {}, 4.0)
    return Description(step, MissingTerms(terms, 465, 200, p_value), columns)


RECORDS = {
    "absorbed, pushed by a cause": absorbed(HIGH, pushes=(PUSH,), after=(BACK,)),
    "absorbed by several": absorbed(
        HIGH,
        HIGH.model_copy(update={"parameter": "c1_at_0", "moved_sd": -3.2, "score_sd": -3.2}),
        pushes=(replace(PUSH, shifts={**PUSH.shifts, "c1_at_0": 0.0}),),
        after=(BACK,),
    ),
    "absorbed, pushed by either": absorbed(
        HIGH, pushes=(PUSH, push("creep", share=0.8, factor=79.0)), after=(BACK,)
    ),
    "absorbed, pushed by two together": absorbed(
        HIGH,
        pushes=(push("creep", share=0.4), push("creep", "mullins", share=1.1)),
        after=(BACK,),
    ),
    "absorbed, pushed by nothing known": absorbed(HIGH, pushes=(push("creep", share=0.1),)),
    "absorbed by nothing": absorbed(BACK),
    "nothing could absorb": absorbed(BACK.model_copy(update={"p_alone": NAN, "p_adjusted": NAN})),
    "structure left": StructureLeft(FACTOR.formula, FACTOR.columns, 0.163, 0, 0.00498, 200),
    "structure left, several": StructureLeft(ALONG.formula, (), 0.163, 4, 0.00498, 200),
    "a term describes the misfit": described(missing_term(FACTOR)),
    "one of several terms describes it": described(
        missing_term(FACTOR, alike=(AlikeTerm(ALONG, 3.0, 1.2),), count_alike=3),
        causes=("creep", "erosion"),
    ),
    "two terms describe it": described(
        missing_term(FACTOR, alike=(AlikeTerm(ALONG, 3.0, 1.2),), count_alike=1),
        missing_term(ALONG, size=4.1, low=3.0, high=5.2, share=0.98, held_out=None),
    ),
    "no term describes it": described(causes=("creep",), p_value=0.31),
    "held-out specimens confirm no term": described(p_value=0.01),
    "nothing is known of where it sits": described(share=0.0, p_value=NAN),
    "counts that contradict": COUNTS,
    "counts of the study's own": replace(COUNTS, source="actuator.csv", p_value=0.4),
    "counts as expected": replace(
        COUNTS, levels=(counted_level(0.0, 0, 0.1, 0.05, 0.2, of_count=0.7),), p_value=1.0
    ),
    "counts explained": COUNTED,
    "counts explained by either": replace(COUNTED, tried=(*TWO, ALIKE)),
    "counts explained by a cut alike": replace(
        COUNTED, tried=(counted_cause("common_factor", 45.3, 0.3), FLAWS)
    ),
    "counts by each criterion": replace(
        COUNTED, criteria={"cauchy_stress": 0.001, "strain_energy": 0.02}
    ),
    "counts unexplained": replace(
        COUNTED, tried=(counted_cause("flaw_embrittlement", 1.5, 0.007), ALIKE)
    ),
    "misfit not calibrated": Uncalibrated(18, 200),
    "remaining misfit not calibrated": Uncalibrated(0, 200, remaining=True),
    "little power": LittlePower("curvature", 31.8, 6),
    "one specimen": LittlePower("curvature", 31.8, 1),
    "coarse map": CoarseMap(1.74),
    "on the edge": OnEdge(0.034, ("A00-1", "A00-2")),
    "noise that is none": TakenForErrors("curvature", 4.2, 0.9),
    "worse than the mean": TakenForErrors("curvature", 1.1, -28.7),
    "shared scatter not tested": NotTested("creep"),
    "test not computed": NotComputed("held-out specimens", "It broke."),
    "sampler not converged": NotConverged("base model", 1.8249, 12.3),
    "nothing held out": NothingHeldOut(),
    "not predicted better": NotPredictedBetter("creep", -20.04, 14.0),
    "implausible size": ImplausibleSize("creep", 0.00123, 3.14),
    "implausible size beside another": ImplausibleSize("creep", 0.00123, 47.0, beside=True),
    "size that a cause does not have": ExcludedSize("creep", 0.0001234),
    "size that no prior draw has": ExcludedSize("creep", 0.0),
    "too little evidence": TooLittleEvidence("creep", 2.14, 4.2),
    "shared by a level": SharedByLevel("creep", 0.0199, 500),
    "no reduction": NoReduction(0.0199, 500),
    "too little explained": TooLittleExplained(0.4),
    "misfit remains": MisfitRemains(0.74, 0.0199, 500),
    "curvature everywhere": CURVATURE,
    "curvature at one pressure": replace(CURVATURE, pressures=(11.2, 11.2), excess=0.0004),
    "curvature a little": replace(CURVATURE, pressures=(11.2, 11.4), excess=0.004),
    "curvature at some rates": replace(CURVATURE, excess=0.043, everywhere=False),
    "curvature, in a specimen": (CURVATURE, specimens("G7")),
    "curvature, in two specimens": (CURVATURE, specimens("G7", "G1")),
    "curvature, in a branch": (
        CURVATURE,
        later("branch", "unloading", 0.8, 0.5),
    ),
    "curvature, after the first cycle": (
        CURVATURE,
        later("cycle", "cycles after the first", 1.0, 0.67),
    ),
    "stress in modes": STRESS,
    "stress in one mode": StressDeparture(STRESS.modes[:1], above=True),
    "force": ReadingsDeparture("tip force", "N", (20.0, 100.0), 0.0412, above=False),
    "converged": SAMPLED,
    "not converged, more would help": replace(SAMPLED, usable=False),
    "not converged, two modes": replace(SAMPLED, usable=False, more_helps=False, shares=(0.7, 0.3)),
    "held out as predicted": PIT,
    "held out above": replace(PIT, scatter=Scatter.ABOVE, share=0.85),
    "held out, too narrow": replace(PIT, scatter=Scatter.TOO_NARROW, share=0.23),
    "held out, not known": replace(PIT, scatter=Scatter.NOT_KNOWN, replicates=18),
    "held out, nothing known": replace(PIT, scatter=Scatter.NOT_KNOWN, replicates=0),
    "left out in turn": LEFT_OUT,
    "left out, one calibrated again": replace(HEAVY, refitted=np.array([True, False, False])),
    "left out, two calibrated again": replace(HEAVY, refitted=np.array([True, True, False])),
    "left out of many": MANY,
    "nothing depends on a prior": PriorSensitivity((DATA,)),
    "some depends on a prior": PriorSensitivity((DATA, *MOVED)),
    "all depends on a prior": PriorSensitivity(MOVED[:1]),
    "priors leave room": PRIORS,
    "priors of films contradict": PriorPredictive(pd.DataFrame(), NAN, NAN, 0.04),
    "priors of nothing": PriorPredictive(pd.DataFrame(), NAN, NAN, NAN),
    "order adequate": OrderComparison((WORSE, SECOND), 2),
    "order could be lower": OrderComparison((SIMPLER, SECOND), 2),
    "order too low": OrderComparison((WORSE, SECOND, HIGHER), 2),
    "order not judged": OrderComparison((WORSE, replace(SECOND, log_evidence=NAN)), 2),
    "law used predicts best": laws(YEOH, GENT),
    "law used predicts best, of modes": laws(YEOH, GENT, modes=("uniaxial", "planar")),
    "another law is better": laws(YEOH, GENT, OGDEN),
    "another law may be better": laws(YEOH, DOUBTFUL),
    "laws not judged": laws(*ALONE),
    "vendor": VendorCheck((STATED, BROKEN), "data sheet, 2024"),
    "vendor, not used": VendorCheck((NO_ACTUATOR,), "vendor"),
    "course reaches the rate": COURSE,
    "course reaches the rate in time": replace(COURSE, last_h=48.0),
    "course may not reach the rate": replace(COURSE, reached=0.43),
    "common error larger than stated": ERROR,
    "common error smaller than stated": replace(ERROR, fresh=1, films=1, stated=1.0),
    "common error, none stated": replace(ERROR, stated=None),
    "common error of no fresh film": replace(ERROR, fresh=0),
    "unload": TEST,
    "unload, no times so far": replace(TEST, timed=False, specimens=1),
    "load again": replace(TEST, kind="cycle"),
    "hold each step": replace(TEST, kind="held steps", hold_s=120.0),
    "hold once": replace(TEST, kind="hold", top=160.0, low=160.0, hold_s=1800.0, steps=8),
    "finer steps": replace(TEST, kind="finer steps", low=10.0, levels=(0.0,)),
    "bend angle": replace(TEST, kind="bend angle"),
    "another level": replace(TEST, kind="another level"),
    "warmer room": replace(TEST, kind="warmer room", temperature_c=30.0),
    "another batch": replace(TEST, kind="another batch", batch="2026-04 B"),
    "another batch without a name": replace(TEST, kind="another batch"),
    "two batches": replace(TEST, kind="two batches", specimens=2, levels=(0.0,)),
    "cavity volume": replace(TEST, kind="cavity volume"),
    "more specimens": replace(TEST, kind="more specimens", specimens=2, levels=(0.0, 25.0)),
    "one more specimen": replace(TEST, kind="more specimens", specimens=1, levels=(10.0,)),
    "films in another mode": ExperimentPlan("planar", 3, (0.0,)),
    "a film in another mode": ExperimentPlan("planar", 1, (0.0,)),
    **{f"mount {mount}": replace(TEST, kind="second mount", mount=mount) for mount in MOUNTS},
    **{
        part: ExperimentPlan(part, 3, (25.0,))
        for part in (
            *("length", "roof", "strip of the wall", "strip of the paper", "second gauge"),
            "weighed piece",
        )
    },
}
COSTLY = (
    *(
        OptionalStage.VERDICT,
        OptionalStage.RUPTURE_MISFIT,
        OptionalStage.RUPTURE_COUNTS,
        OptionalStage.CONFLICT,
        OptionalStage.HELD_OUT,
        OptionalStage.SHARED_SCATTER,
    ),
    *(
        OptionalStage.CONFUSABILITY,
        OptionalStage.ABSORPTION,
        OptionalStage.LEVELS_OUT,
        OptionalStage.EXPERIMENTS,
        OptionalStage.EXTENDED,
        OptionalStage.READINGS,
    ),
)
NOTES = ("not_calibrated", "ruptures_not_judged", "no_statistics", "counts_not_judged")


def setting(pressure, needed, *, middle=8.25, found=True, by_rupture=False, by_test=False):
    allowed = Allowed(pressure, by_rupture, found, by_test)
    quantiles = (NAN,) * 2 + (middle,) + (NAN,) * 2
    return Setting(
        degradation=10.0,
        wanted=25.0,
        risk=0.05,
        pressure=pressure,
        reached=False,
        needed=(NAN, needed, NAN),
        allowed=allowed,
        curvature=quantiles,
        probability=(NAN,) * 3,
    )


def burst(**content):
    known = {"degradation_pct": 24.0, "burst": 1, "source": "actuator.csv"}
    return BurstEntry(**known | content)


LIFE = LifeSummary(
    duty=Duty(120.0, 5.0, 0.05),
    failure=(5.07, 6.37, 7.87),
    reachable=(16.7, 20.9, np.inf),
    first=0.0,
    last=24.0,
    failed=1.0,
    burst=0.012,
    allowed=240.0,
    checks=60,
)


def nothing(**content):
    return {"v": VerdictRecord.read(content), "left_out": "", "least": 3.0}


ANSWERS = {
    "no prediction": (
        "unanswered",
        {"left": 1.0, "nothing": True, "some": True, "lacks_rupture": True},
    ),
    "band of the others": (
        "unanswered",
        {"left": 0.123, "nothing": False, "some": True, "lacks_rupture": False},
    ),
    "band of the others, no rupture": (
        "unanswered",
        {"left": 0.123, "nothing": False, "some": True, "lacks_rupture": True},
    ),
    "no rupture": (
        "unanswered",
        {"left": 0.0, "nothing": False, "some": False, "lacks_rupture": True},
    ),
    "no pressure allowed": ("out_of_reach", {"s": setting(NAN, 300.0, by_rupture=True)}),
    "rupture forbids": ("out_of_reach", {"s": setting(204.31, 300.04, by_rupture=True)}),
    "ballooning forbids": ("out_of_reach", {"s": setting(204.31, np.inf)}),
    "no limit found": ("out_of_reach", {"s": setting(960.0, np.inf, middle=NAN, found=False)}),
    "tests forbid": ("out_of_reach", {"s": setting(240.0, 477.0, by_test=True)}),
    "ruptures forbid": ("out_of_reach", {"s": setting(NAN, 477.0, by_test=True)}),
    "by hours": (
        "out_of_reach",
        {"s": replace(setting(240.0, 477.0, by_test=True), degradation=12.66, hours=8.0)},
    ),
    "no cause answers": ("moves_nothing", {"name": "mount", "value": "hanging", "causes": []}),
    "none answers": ("moves_nothing", {"name": "cycle", "value": 2, "causes": ["creep"]}),
    "no time": (
        "moves_nothing",
        {"name": "humidity_pct", "value": 40.0, "causes": ["creep", "humidity_drift"]},
    ),
    "hours beyond": ("hours_beyond", {"last": 24.0, "asked": 48.0}),
    "burst, recorded": ("burst", {"b": burst(pressure_kPa=120.0, survived_kPa=100.0)}),
    "burst at once": ("burst", {"b": burst(pressure_kPa=20.0)}),
    "burst, published": ("burst", {"b": burst(burst=2, tested=3), "tested": 240.0}),
    "beyond what was tested": (
        "rests_on",
        {"over": {10.0: 240.0, 25.0: 100.0}, "strong": True},
    ),
    "beyond, without a limit": ("rests_on", {"over": {25.0: 240.0}, "strong": False}),
    "a life": ("life", {"s": LIFE}),
    "a long life": (
        "life",
        {"s": replace(LIFE, failure=(20.0, np.inf, np.inf), reachable=(np.inf,) * 3)},
    ),
    "no end": (
        "life",
        {"s": replace(LIFE, failure=(np.inf,) * 3, reachable=(18.0, np.inf, np.inf))},
    ),
    "unexplained": ("unexplained", {}),
    "ambiguous": ("ambiguous", {"causes": ("creep", "mullins"), "model": "base+creep"}),
    "averaged": (
        "averaged",
        {
            "members": (
                MemberEntry(causes=("creep",), probability=0.7),
                MemberEntry(causes=("mullins",), probability=0.3),
            ),
            "by_command": True,
        },
    ),
    "one of an average": (
        "averaged",
        {"members": (MemberEntry(causes=("creep",), probability=0.7),), "by_command": False},
    ),
    "no actuator": ("no_actuator", {}),
    "no rupture known": ("no_rupture", {}),
    "rates beyond": (
        "rates_beyond",
        {"what": "films", "low": 0.0, "high": 25.0, "asked": [28.0, 31.5]},
    ),
    "rate beyond the only one": (
        "rates_beyond",
        {"what": "actuators", "low": 10.0, "high": 10.0, "asked": [31.0]},
    ),
    "pressures beyond": ("pressures_beyond", {"high": 240.0, "asked": 300.0}),
    "small risk": ("small_risk", {"risk": 0.001, "checks": 54}),
    "small rate": ("small_rate", {"rate": 0.25}),
    "ranking left out": (
        "nothing_proposed",
        nothing(outcome="named") | {"left_out": "It could not be computed (ValueError)."},
    ),
    "judging failed": (
        "nothing_proposed",
        nothing(outcome="not_judged", explanation="One reading.", misfit={"p_value": 0.4}),
    ),
    "nothing to judge": ("nothing_proposed", nothing(outcome="not_judged")),
    "nothing to tell apart": ("nothing_proposed", nothing(outcome="adequate")),
    "one named": ("nothing_proposed", nothing(outcome="named", causes=["degraded_skin"])),
    "two named": ("nothing_proposed", nothing(outcome="named", causes=["creep", "mullins"])),
    "no experiment helps": (
        "nothing_proposed",
        nothing(outcome="ambiguous", causes=["erosion", "creep"]),
    ),
    "no cause and no experiment": ("nothing_proposed", nothing(outcome="unexplained")),
    "readings taken in": ("updated", {"update": UpdateEntry(specimens=("A00-1", "A25-3"))}),
    "no average any more": (
        "updated",
        {
            "update": UpdateEntry(
                specimens=("A00-1",),
                not_averaged=(
                    MemberEntry(causes=("creep",), probability=0.7),
                    MemberEntry(causes=("mullins",), probability=0.3),
                ),
            )
        },
    ),
    "never told apart": ("never_told_apart", {"causes": ("film_mismatch", "creep")}),
}


def render(name):
    if name in ANSWERS:
        part, facts = ANSWERS[name]
        return sentences("answers", part, **facts).replace("\N{NO-BREAK SPACE}", " ")
    if name == "counts_not_judged":
        return sentences("findings", name, one=replace(COUNTS, draws=18))
    if name in NOTES:
        return sentences("findings", name, one=Uncalibrated(18, 200))
    record = RECORDS[name]
    record, most = record if isinstance(record, tuple) else (record, None)
    return worded(record, most=most)


@pytest.mark.parametrize("name", [*RECORDS, *NOTES, *ANSWERS])
def test_every_finding_is_rendered(name):
    said = render(name)
    assert said == json.loads(WORDS.read_text("utf-8"))[name]
    assert not re.search(r"nan|None|\{|  | [.,;]|\.\.", said)


def test_every_macro_of_a_record_is_rendered():
    classes = {type(r[0] if isinstance(r, tuple) else r).__name__ for r in RECORDS.values()}
    rendered = {re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower() for name in classes}
    module = environment().get_template("findings.j2").make_module({"one": None, "most": None})
    helpers = {"few", "mostly", "place", "off", "figures", "new", "burst_of", "counts_in"}
    helpers |= {"those", "uncatalogued"}
    helpers |= {"in_words", "fit_alike", "by_column", "column_words", "a_term"}
    # of facts, not of a record: tests/run/test_set_aside.py, tests/run/test_reach.py
    helpers |= {"suspect", "oddness", "guess", "verb", "beyond"}
    macros = {name for name in vars(module) if not name.startswith("_")} - {"mounts", "parts"}
    assert macros - helpers == rendered | set(NOTES)
    module = environment().get_template("answers.j2").make_module({})
    macros = {name for name in vars(module) if not name.startswith("_")}
    assert macros - {"beyond", "allowed", "when"} == {part for part, _ in ANSWERS.values()}


def as_made(record):
    """The record as it would be of a study in which nothing degrades; None if there is none."""
    if isinstance(record, CourseSummary | CommonError | OrderComparison | PriorSensitivity):
        return None
    if isinstance(record, ExperimentPlan):
        made = replace(record, levels=(0.0,) * len(record.levels))
        return None if record.kind == "weighed piece" else made
    return record


@pytest.mark.parametrize("name", RECORDS)
def test_no_finding_speaks_of_degradation_where_nothing_degrades(name):
    record, most = RECORDS[name] if isinstance(RECORDS[name], tuple) else (RECORDS[name], None)
    if (made := as_made(record)) is None:
        return
    said = worded(made, most=most, degrades=False)
    told = re.sub("|".join(c.name for c in CATALOGUE.values() if c.of_degradation), "", said)
    assert not re.search(r"degrad|fresh|moisture|shrink| at \d+ %", told)
    assert not re.search(r"nan|None|\{|  | [.,;]|\.\.", said)


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        (
            "absorbed, pushed by a cause",
            ["0.940", "0.620", "0.571", "0.668", "10.5 of", "p = 0.003", "97 %", "0.629", "0.3"],
        ),
        ("absorbed by nothing", ["(1)"]),
        ("misfit not calibrated", ["18", "200"]),
        ("little power", ["32 %"]),
        ("not predicted better", ["−20 ± 14"]),
        ("implausible size", ["0.001", "3.1"]),
        ("shared by a level", ["p = 0.02"]),
        ("misfit remains", ["74 %", "p = 0.02"]),
        ("curvature everywhere", ["29 %", "20–80 kPa", "17 of 18"]),
        ("curvature at one pressure", ["less than 0.1 % above", "at 11.2 kPa"]),
        ("curvature a little", ["lies 0.4 % above", "11.2–11.4 kPa"]),
        ("curvature at some rates", ["4 %", "0 and 12.4 %"]),
        ("curvature, in two specimens", ["88 %", "6.3 %", "G7", "14 %", "G1", "9 %"]),
        ("stress in modes", ["uniaxial", "0.31 MPa", "planar 0.038 MPa"]),
        ("converged", ["1.234", "volume ratio", "962", "652", "60", "10.6"]),
        ("not converged, two modes", ["1.01", "2000", "70 %", "30 %"]),
        ("held out above", ["85 %"]),
        ("left out in turn", ["92.4", "11.6", "s1", "8.0", "0.62", "0.70"]),
        ("some depends on a prior", ["0.16", "0.74", "0.40", "paper stiffness own"]),
        ("unload", ["240 → 20 kPa", "3 new", "25 %"]),
        ("hold once", ["160 kPa", "30 min", "8 times"]),
        ("hold each step", ["120 s"]),
        ("priors leave room", ["98 %", "100 %", "41 %"]),
        ("order adequate", ["−51.0 ± 9.2", "−44.0 ± 0.04"]),
        ("order too low", ["order = 3"]),
        (
            "course reaches the rate",
            ["63", "25 %", "24.3", "22.4", "27.1", "24 h", "32", "29", "35"],
        ),
        ("course may not reach the rate", ["43 %"]),
        ("law used predicts best", ["3 films", "25.5 ± 1.5", "0.043", "0.091 MPa"]),
        ("another law is better", ["18.5 ± 0.5", "0.022", "0.043 MPa"]),
        (
            "vendor",
            ["68.9 ± 14 kPa", "74.1", "70.2", "78.8", "0.4 of", "873 %", "0.1 of"],
        ),
        ("band of the others", ["12 %"]),
        ("rupture forbids", ["25 1/m at 10 %", "300 kPa", "204 kPa", "0.05", "8.25 1/m"]),
        ("ballooning forbids", ["204 kPa", "5 %"]),
        ("rates beyond", ["0 to 25 %", "28 %, 31.5 %"]),
        ("pressures beyond", ["240 kPa", "300 kPa"]),
        ("small rate", ["0.25 %"]),
        ("no experiment helps", ["factor of 3"]),
        ("common error larger than stated", ["9", "0.44", "25 %", "0.58", "0.73", "0.5 points"]),
    ],
)
def test_numbers_of_a_finding_are_in_its_sentence(name, numbers):
    said = render(name).replace("\N{NARROW NO-BREAK SPACE}", "")
    assert [number for number in numbers if number not in said] == []


@pytest.mark.parametrize("stage", COSTLY)
def test_what_a_failed_stage_costs_is_said(stage):
    """The template knows stages by the names that they have."""
    said = sentences("run", "stage_failed", stage=str(stage), what="RuntimeError: no ink")
    assert said.endswith("(RuntimeError: no ink).")
    assert not said.startswith("It could")


if __name__ == "__main__":
    found = {name: render(name) for name in (*RECORDS, *NOTES, *ANSWERS)}
    WORDS.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", "utf-8")
