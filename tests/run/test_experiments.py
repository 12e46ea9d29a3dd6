from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import multivariate_normal

from bayesdeg.actuator.inputs import Further
from bayesdeg.analysis.designs import (
    MOUNTS,
    WARMER,
    Measurand,
    PartMeasurements,
    candidate_experiments,
)
from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.criticism.experiments.ranking import (
    LEAST,
    NO_CAUSE,
    ActuatorTests,
    FilmTests,
    Hypothesis,
    PredictiveReadings,
    ReadingsLaw,
    compare,
    hypotheses_of,
    next_experiments_document,
    predictive_readings,
    rank,
    rank_hypotheses,
    separation,
    with_noise,
)
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.inference.laplace import Evidence
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.pressures import PressureTests
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.tensile import Tensile, median_stresses
from bayesdeg.observations.volume import SHARE_OF_STROKE, CavityVolume
from bayesdeg.pages.wording import worded
from bayesdeg.surrogate.trained import default_surrogate
from tests.inference.small_study import TRUTH, altered, small_model, values_of

QUIET = {
    "stiffness_scatter": 0.01,
    "curvature_noise": 0.005,
    "curvature_noise_floor": 0.03,
    "tensile_noise": 0.005,
    "tensile_noise_floor": 0.002,
}
DRAWS = 300
STRIP = "strip of the wall"


@pytest.fixture(scope="module")
def model():
    """The small study with the shipped emulator, thrice as many specimens and no bend angle."""
    whole = small_model(default_surrogate())
    data = whole.data_of(Curvature).tests.subset(np.repeat(np.arange(5), 3))
    return altered(whole, actuator=replace(data, angle_mask=np.zeros_like(data.mask)))


@pytest.fixture(scope="module")
def experiments(model):
    return candidate_experiments(model)


def of_kind(experiments, kind):
    return [e for e in experiments if e.kind == kind]


def around(model, sizes, *, width=0.01, seed=0, truth=QUIET):
    """Draws about the truth, and about the sizes of causes: what data that fixed them leave."""
    names = list(dict.fromkeys(name.split(".")[0] for name in sizes))
    extended = model.extended(*(find(name) for name in names))
    known = values_of(TRUTH | truth | sizes)
    centre = extended.table.vectors({n: known[n] for n in extended.table.names})[0]
    noise = np.random.default_rng(seed).standard_normal((DRAWS, len(centre)))
    return Hypothesis("+".join(names) or NO_CAUSE, extended, centre + width * noise)


def alike(model, first, name, low, high, truth=QUIET, others=None):
    """A second cause of the size at which it bends the old tests as the first does."""

    def curvatures(sizes):
        hypothesis = around(model, sizes, width=0.0, truth=truth)
        values = hypothesis.model.table.named(hypothesis.draws[:1])
        return (
            hypothesis.model.data_of(Curvature)
            .predicted(hypothesis.model.tests(values))
            .mean[0][model.data_of(Curvature).tests.mask]
        )

    target = curvatures(first)

    def distance(size):
        return float(
            np.nansum((np.log(curvatures({name: size} | (others or {}))) - np.log(target)) ** 2)
        )

    size = minimize_scalar(distance, bounds=(low, high), method="bounded").x
    second = {name: float(size)} | (others or {})
    return around(model, first, seed=1, truth=truth), around(model, second, seed=2, truth=truth)


def expected_of(hypotheses, experiment, seed=3):
    (pair,) = compare(hypotheses, experiment.measurement, np.random.default_rng(seed))
    return pair.expected


def best(hypotheses, found):
    return max(expected_of(hypotheses, e) / e.specimens for e in found)


# ---- the law of the readings


def spread_law(seed, copies, size=4):
    generator = np.random.default_rng(seed)
    a, b = generator.standard_normal((2, size, size))
    return ReadingsLaw(generator.standard_normal(size), a @ a.T, b @ b.T + np.eye(size), copies)


def whole(law):
    """Mean and covariance of all readings of all copies, written out."""
    k = law.copies
    cov = np.kron(np.ones((k, k)), law.common) + np.kron(np.eye(k), law.own)
    return np.tile(law.mean, k), cov


@pytest.mark.parametrize("copies", [1, 2, 5])
def test_the_density_of_copies_is_that_of_the_covariance_written_out(copies):
    first, second = spread_law(0, copies), spread_law(1, copies)
    readings = np.random.default_rng(2).standard_normal((copies, 7, 4))
    flat = readings.transpose(1, 0, 2).reshape(7, -1)
    by_hand = [multivariate_normal(*whole(law)).logpdf(flat) for law in (first, second)]
    ratio = first.log_density(readings) - second.log_density(readings)
    assert ratio == pytest.approx(by_hand[0] - by_hand[1])


@pytest.mark.parametrize("copies", [1, 3])
def test_the_divergence_is_that_of_the_normal_laws_written_out(copies):
    (m1, c1), (m2, c2) = (whole(spread_law(seed, copies)) for seed in (0, 1))
    inverse = np.linalg.inv(c2)
    by_hand = 0.5 * (
        np.trace(inverse @ c1)
        + (m2 - m1) @ inverse @ (m2 - m1)
        - len(m1)
        + np.linalg.slogdet(c2)[1]
        - np.linalg.slogdet(c1)[1]
    )
    assert spread_law(0, copies).divergence(spread_law(1, copies)) == pytest.approx(by_hand)


def test_readings_of_a_normal_law_give_its_divergence():
    generator = np.random.default_rng(4)
    laws = [spread_law(0, 2), spread_law(1, 2)]
    drawn = [
        generator.multivariate_normal(*whole(law), size=40_000).reshape(-1, 2, 4).swapaxes(0, 1)
        for law in laws
    ]
    both = separation(
        *(PredictiveReadings(law, data) for law, data in zip(laws, drawn, strict=True))
    )
    for found, (a, b) in zip(both, (laws, laws[::-1]), strict=True):
        assert found.error < 0.05 * found.expected
        assert abs(found.expected - a.divergence(b)) < 4.0 * found.error


def test_the_simulated_factor_agrees_with_the_closed_form(model, experiments):
    first, second = alike(
        model,
        {"curvature_reading.fibre_height": 4.0, "curvature_reading.magnification": 0.0},
        "film_mismatch.log_ratio",
        0.0,
        0.5,
    )
    generator = np.random.default_rng(5)
    for experiment in of_kind(experiments, "bend angle"):
        named = [
            (h.model, with_noise(h.model.table.named(h.draws), generator)) for h in (first, second)
        ]
        told = predictive_readings(named, experiment.measurement, generator)
        for found, (a, b) in zip(separation(*told), (told, told[::-1]), strict=True):
            # what is left is the nonlinearity of the specimens' deviations
            assert abs(found.expected - a.law.divergence(b.law)) < 4.0 * found.error + 0.05


def test_scatter_is_that_of_the_linearised_model(model):
    hypothesis = around(model, {}, width=0.0)
    values = model.table.named(hypothesis.draws[:1])
    # readings as predicted: the most probable deviations are zero
    exact = model.with_observations(
        *data_of_actuators(
            model.data_of(Curvature).tests.with_readings(
                model.data_of(Curvature).predicted(model.tests(values)).mean[0]
            ),
            model.base,
        )
    )
    films = replace(
        exact.data_of(Tensile).tests,
        stress=median_stresses(exact.tests(values), exact.data_of(Tensile).tests).at_rest[0],
    )
    exact = altered(exact, tensile=films)
    scatter = exact.scatter(hypothesis.draws[0])
    place = 0
    for test in (
        FilmTests(exact.data_of(Tensile).tests, 1),
        ActuatorTests(exact.data_of(Curvature).tests, 1),
    ):
        for block, read in zip(test.covariance(exact, values)[0], test.read, strict=True):
            count = int(read.sum())
            own = scatter[place : place + count, place : place + count]
            assert block[np.ix_(read, read)] == pytest.approx(own)
            place += count
    assert place == len(scatter)


# ---- what separates what


def test_a_bend_angle_separates_what_was_traced_from_the_material(model, experiments):
    pair = alike(
        model,
        {"curvature_reading.fibre_height": 6.0, "curvature_reading.magnification": 0.0},
        "film_mismatch.log_ratio",
        0.0,
        0.6,
    )
    angle, again = (best(pair, of_kind(experiments, k)) for k in ("bend angle", "more specimens"))
    assert angle > LEAST
    assert angle > 2.0 * again


def test_a_second_mount_reveals_weight_that_the_old_tests_are_blind_to(model, experiments):
    # a part of gelatin is so light that it takes a good camera: 4 % at 20 kPa, 0.3 % at 240 kPa
    truth = QUIET | {"curvature_noise": 0.002, "curvature_noise_floor": 0.005}
    weight = {"gravity.density": 1150.0}
    pair = (
        around(model, {}, truth=truth, width=0.002),
        around(model, weight, truth=truth, width=0.002, seed=1),
    )
    ranked = rank_hypotheses(pair, experiments, np.random.default_rng(3))
    told = [entry.experiment.kind for entry in ranked if entry.told_apart]
    assert told == ["second mount"]


@pytest.mark.parametrize("kind", ["hold", "unloading", "held steps"])
def test_time_and_unloading_separate_creep_from_drying(model, experiments, kind):
    creep = {"creep.amount": 0.04, "creep.time_constant": 30.0}
    drying = {"humidity_drift.stiffening": 0.04, "humidity_drift.time_constant": 900.0}
    pair = around(model, creep), around(model, drying, seed=1)
    assert best(pair, of_kind(experiments, kind)) > LEAST
    # no time was recorded before
    assert best(pair, of_kind(experiments, "more specimens")) < 0.1


def test_thickness_separates_the_walls_from_the_material(model, experiments):
    pair = alike(model, {"wall_thickness.excess": 0.1}, "film_mismatch.log_ratio", 0.0, 0.6)
    of = {
        e.kind: expected_of(pair, e)
        for e in candidate_experiments(model)
        if e.plan.levels == (0.0,)
    }
    assert of["roof"] > 2.0
    assert of[STRIP] > 2.0
    assert abs(of["length"]) < 0.1


def test_only_a_second_gauge_or_a_strip_separates_a_gauge_from_the_material(model, experiments):
    pair = alike(model, {"gauge_gain.gain": -0.1}, "film_mismatch.log_ratio", 0.0, 0.6)
    ranked = rank_hypotheses(pair, experiments, np.random.default_rng(6))
    assert ranked[0].experiment.kind == "second gauge"
    assert ranked[0].decisive.expected > 10.0
    assert ranked[1].experiment.kind == STRIP
    assert all(r.decisive.expected < LEAST for r in ranked[2:])


def test_weighing_the_actuator_reveals_a_misread_degradation_rate(model, experiments):
    misread = {"degradation_misread.shift": 4.0, "degradation_misread.scatter": 0.1}
    pair = (
        around(model, misread),
        around(model, {"erosion.lost_share": 0.1, "erosion.growth": 1.0}, seed=1),
    )
    [weighed] = [e for e in experiments if e.kind == "weighed piece"]
    assert expected_of(pair, weighed) > LEAST
    [walls] = [e for e in of_kind(experiments, WALLS) if e.plan.levels != (0.0,)]
    assert expected_of(pair, walls) > LEAST


WALLS = "roof"


def test_walls_read_what_erosion_and_thickness_leave(model):
    sizes = {"erosion.lost_share": 0.1, "erosion.growth": 1.0, "wall_thickness.excess": -0.05}
    hypothesis = around(model, sizes, width=0.0)
    values = hypothesis.model.table.named(hypothesis.draws[:1])
    level = np.array([[0.0], [25.0]])
    test = PartMeasurements(Measurand.WALL, level, 0.0 * level, 100.0 + 0.0 * level, 2)
    scale = TRUTH["volume_ratio"] ** (1.0 / 3.0)
    by_hand = [0.95 * scale, 0.95 * scale - 0.1 * scale]
    assert test.expected(hypothesis.model, values)[0, :, 0] == pytest.approx(by_hand)


def test_a_strip_of_the_paper_tells_softer_paper_from_thinner_walls(model, experiments):
    softer = around(model, {"paper_softening.softening": 1.0, "paper_softening.growth": 2.0})
    thinner = around(model, {"erosion.lost_share": 0.1, "erosion.growth": 1.0}, seed=1)
    strips = of_kind(experiments, "strip of the paper")
    [degraded] = [e for e in strips if e.plan.levels != (0.0,)]
    assert expected_of((softer, thinner), degraded) > LEAST
    drawn = softer.model.table.named(softer.draws[:1])
    level = degraded.measurement.degradation
    softened = drawn["paper_softening.softening"] * (level / 25.0) ** 2.0
    by_hand = np.log(TRUTH["paper_stiffness"]) - softened
    found = degraded.measurement.expected(softer.model, drawn)
    assert found == pytest.approx(by_hand[None], abs=0.1)


# ---- ranking


@pytest.fixture(scope="module")
def many(model):
    first, second = alike(
        model, {"pressure_loss.fraction": 0.1}, "film_mismatch.log_ratio", 0.0, 0.6
    )
    return first, second, around(model, {"wall_thickness.excess": 0.06}, seed=4)


@pytest.fixture(scope="module")
def ranked(many, experiments):
    return rank_hypotheses(many, experiments, np.random.default_rng(7))


def test_nothing_is_expected_to_speak_against_the_truth(ranked):
    pairs = [pair for entry in ranked for pair in entry.pairs]
    assert len(pairs) == 3 * len(ranked)
    assert all(pair.expected > -4.0 * pair.error - 0.05 for pair in pairs)


def test_what_tells_more_pairs_apart_comes_first_then_what_tells_them_apart_better(ranked):
    order = [
        (-r.told_apart, -round(r.decisive.expected, 1), r.experiment.specimens) for r in ranked
    ]
    assert order == sorted(order)
    assert len({entry.told_apart for entry in ranked}) > 1


def test_the_best_of_each_kind_is_kept(ranked, experiments, many):
    kinds = [entry.experiment.kind for entry in ranked]
    assert sorted(kinds) == sorted({e.kind for e in experiments})


def test_the_decisive_pair_is_the_worst_of_those_told_apart(ranked):
    for entry in ranked:
        told = [p.expected for p in entry.pairs if p.expected >= LEAST]
        assert entry.decisive.expected == (min(told) if told else entry.pairs[0].expected)


def test_the_same_hypothesis_twice_is_told_apart_by_nothing(model, experiments):
    pair = around(model, {}, seed=0), around(model, {}, seed=1)
    found = rank_hypotheses(pair, experiments, np.random.default_rng(8))
    assert max(entry.decisive.expected for entry in found) < 0.5
    assert next_experiments_document(found, repr) == ()


def test_the_document_holds_what_the_contract_asks_for(ranked):
    document = next_experiments_document(ranked, repr, most=2)
    assert len(document) == 2
    for entry, source in zip(document, ranked, strict=False):
        assert entry.design == repr(source.experiment.plan)
        assert len(entry.separates) == 2
        assert entry.expected_log_bayes_factor == pytest.approx(source.decisive.expected, abs=0.01)
        assert entry.specimens == source.experiment.specimens > 0
        assert entry.readings >= entry.specimens
        assert len(entry.pairs) == 3


def test_more_specimens_are_worth_more(model, many):
    data = model.data_of(Curvature).tests.subset(np.array([0]))
    few, more = (ActuatorTests(data, k) for k in (1, 6))
    pair = (many[0], many[2])
    worth = [compare(pair, m, np.random.default_rng(9))[0].expected for m in (few, more)]
    assert worth[1] > 1.5 * worth[0]


# ---- what cannot be foretold


def test_readings_beyond_the_range_are_left_out(model, many):
    data = model.data_of(Curvature).tests.subset(np.array([0]))
    points = data.pressure.shape[1]
    beyond = replace(data, pressure=np.where(np.arange(points) < points - 2, data.pressure, 5e3))
    shorter = replace(data, mask=data.mask & (np.arange(points) < points - 2))
    known, same = (
        compare(many, ActuatorTests(d, 2), np.random.default_rng(10)) for d in (beyond, shorter)
    )
    for pair in known:
        other = next(p for p in same if p.causes == pair.causes)
        assert pair.expected == pytest.approx(other.expected, abs=4 * (pair.error + other.error))
    nowhere = replace(data, pressure=np.full_like(data.pressure, 5e3))
    assert compare(many, ActuatorTests(nowhere, 2), np.random.default_rng(10)) == ()


# ---- from fitted models


def trial_of(hypothesis):
    weights = np.zeros(DRAWS)
    posterior = Evidence(0.0, 0.0, hypothesis.draws, weights, float(DRAWS))
    subject = hypothesis.model
    size = hypothesis.draws.shape[1]
    mode = hypothesis.draws.mean(axis=0)
    return CandidateFit(subject, mode, 0.0, posterior, np.eye(size), mode)


def test_causes_that_all_have_in_common_are_not_in_question(model):
    common = {"pressure_offset.offset": 5.0}
    trials = [
        trial_of(around(model, common | {"wall_thickness.excess": 0.05})),
        trial_of(around(model, common | {"film_mismatch.log_ratio": 0.1})),
        trial_of(around(model, common)),
    ]
    found = hypotheses_of(trials, np.random.default_rng(0), untested=[find("creep")], draws=50)
    assert [h.name for h in found] == ["wall_thickness", "film_mismatch", NO_CAUSE, "creep"]
    assert [c.name for c in found[3].model.causes] == ["pressure_offset", "creep"]


def test_an_untested_cause_has_the_size_that_its_prior_says(model):
    creep = find("creep")
    found = hypotheses_of(
        [trial_of(around(model, {}))], np.random.default_rng(1), untested=[creep], draws=4000
    )[1]
    sizes = found.model.table.named(found.draws)["creep.amount"]
    shares = np.quantile(sizes, [0.1, 0.5, 0.9])
    assert shares == pytest.approx(creep.parameters[0].law.quantile([0.1, 0.5, 0.9]), rel=0.1)


def test_one_model_alone_leaves_nothing_to_tell_apart(model, experiments):
    alone = [trial_of(around(model, {}))]
    every = experiments
    assert rank(alone, every, np.random.default_rng(2)) == ()
    with_rival = rank(alone, every[:2], np.random.default_rng(2), untested=[find("mullins")])
    assert set(with_rival[0].decisive.causes) == {NO_CAUSE, "mullins"}


# ---- candidates


@dataclass(frozen=True)
class Change:
    """A column that a study may have already, and the kinds that are then not proposed."""

    fields: dict
    gone: set


SHAPE = (15, 7)
HAS = {
    "bend angle": Change({"angle_mask": np.ones(SHAPE, bool)}, {"bend angle"}),
    "unloading": Change({"branch": np.full(SHAPE, "unloading")}, {"unloading"}),
    "cycle": Change({"cycle": np.tile([1, 1, 1, 1, 2, 2, 2], (15, 1))}, {"cycle"}),
    "slow steps": Change({"time": np.tile(120.0 * np.arange(7), (15, 1))}, {"held steps"}),
    "mounts": Change(
        {"mount": np.tile(np.array([*MOUNTS, "horizontal", "hanging", "horizontal"]), (15, 1))},
        {"second mount"},
    ),
    "rooms": Change(
        {"temperature": np.tile(np.repeat([22.0, 29.0, 24.0], 5)[:, None], (1, 7))},
        {"warmer room"},
    ),
    "batches": Change({"batch": np.tile([0, 1, 0], 5)[:, None]}, {"two batches"}),
    "hold": Change(
        {"time": np.tile(600.0 * np.arange(7), (15, 1)), "pressure": np.full(SHAPE, 100.0)},
        {"hold", "held steps", "finer steps"},
    ),
}


@pytest.mark.parametrize("name", HAS)
def test_only_what_the_study_does_not_have_is_proposed(model, name):
    plain = {e.kind for e in candidate_experiments(model)}
    data = replace(model.data_of(Curvature).tests, **HAS[name].fields)
    proposed = {e.kind for e in candidate_experiments(altered(model, actuator=data))}
    assert HAS[name].gone <= plain
    assert plain - proposed == HAS[name].gone


def test_candidates_keep_to_the_design_of_the_study(model, experiments):
    top = model.data_of(Curvature).tests.pressure.max()
    for experiment in experiments:
        if isinstance(experiment.measurement, ActuatorTests):
            curves = experiment.measurement.curves
            assert curves.pressure.max() <= top
            assert curves.degradation.max() <= model.world.nodes[-1]
            assert len(curves.specimens) * experiment.measurement.copies == experiment.specimens
        assert f"{experiment.specimens} " in worded(experiment.plan)


def test_a_burst_level_is_tested_up_to_what_half_of_its_specimens_reached(model):
    data = model.data_of(
        Curvature
    ).tests  # the one specimen at 24 % was read at five of seven pressures
    tests = [
        e.measurement.curves
        for e in candidate_experiments(model)
        if e.kind == "unloading" and e.plan.levels[0] > 20.0
    ]
    assert [t.pressure.max() for t in tests] == [data.pressure[4, 4]]


def test_films_alone_are_tested_in_another_mode(model):
    uniaxial = model.data_of(Tensile).tests.subset(np.array([0, 1]))
    alone = altered(model, actuator=None, tensile=uniaxial)
    assert {e.kind for e in candidate_experiments(alone)} == {"equibiaxial", "planar"}
    assert candidate_experiments(altered(model, actuator=None, tensile=None)) == ()


def test_an_equibiaxial_test_separates_what_uniaxial_films_cannot(model):
    uniaxial = altered(model, tensile=model.data_of(Tensile).tests.subset(np.array([0])))
    found = {e.kind: e for e in candidate_experiments(uniaxial)}
    pair = around(uniaxial, {}), around(uniaxial, {"second_invariant.ratio": 0.2}, seed=1)
    assert expected_of(pair, found["equibiaxial"]) > LEAST


# ---- batches, warmth of the room, volumes


def shown(kind, experiments, name):
    """Whether a cause that the study's tests are blind to is not blind in those of a kind."""
    tests = [e.measurement.curves.conditions for e in of_kind(experiments, kind)]
    assert tests
    return all(find(name).blind(test) is None for test in tests)


BATCH = {"batch_stiffness.second": 0.2, "batch_stiffness.third": 0.0, "batch_stiffness.fourth": 0.0}
WARMTH = {"temperature_softening.softening": 0.03}
ORDINARY = {"stiffness_scatter": 0.03}
"""Errors of reading as they were, and parts of a careful laboratory."""


@pytest.mark.parametrize(
    ("kind", "sizes"), [("two batches", BATCH), ("warmer room", WARMTH)], ids=lambda x: str(x)[:12]
)
def test_what_was_not_recorded_is_proposed_first_and_nothing_else_shows_it(
    model, experiments, kind, sizes
):
    name = next(iter(sizes)).split(".")[0]
    assert find(name).blind(model.data_of(Curvature).tests.conditions) is not None
    assert shown(kind, experiments, name)
    pair = (
        around(model, {}, truth=ORDINARY, width=0.002),
        around(model, sizes, truth=ORDINARY, width=0.002, seed=1),
    )
    ranked = rank_hypotheses(pair, experiments, np.random.default_rng(3))
    assert [entry.experiment.kind for entry in ranked if entry.told_apart] == [kind]
    assert 1.5 < ranked[0].decisive.expected < 60.0


def of_batches(model, numbers):
    """The study with batches of its actuators, three at each of five degradation rates."""
    batch = np.repeat(np.array(numbers), 3)[:, None]
    names = np.array(["spring", "autumn", "winter"])[batch]
    names[0] = ""  # without a record it counts as of the first
    return altered(
        model, actuator=replace(model.data_of(Curvature).tests, batch=batch, batch_name=names)
    )


def test_a_batch_that_was_tested_at_no_other_rate_is_tested_there(model):
    """Degraded actuators were all of another batch: is it the batch, or their rates?"""
    confounded = of_batches(model, [0, 0, 1, 1, 1])
    proposed = candidate_experiments(confounded)
    assert "two batches" not in {e.kind for e in proposed}
    found = [(e.plan.levels, e.plan.batch) for e in of_kind(proposed, "another batch")]
    assert found == [((0.0,), "autumn"), ((24.0,), "spring")]
    nameless = replace(confounded.data_of(Curvature).tests, batch_name=np.array(""))
    proposed_too = candidate_experiments(altered(confounded, actuator=nameless))
    assert {e.plan.batch for e in of_kind(proposed_too, "another batch")} == {""}
    misread = (
        "degradation_misread.shift",
        0.0,
        6.0,
        ORDINARY,
        {"degradation_misread.scatter": 0.1},
    )
    pair = alike(confounded, BATCH, *misread)
    ranked = rank_hypotheses(pair, proposed, np.random.default_rng(3))
    assert ranked[0].experiment.kind == "another batch"
    assert 5.0 < ranked[0].decisive.expected < 60.0
    again = next(r for r in ranked if r.experiment.kind == "more specimens")
    assert again.decisive.expected < 0.5 * ranked[0].decisive.expected


def test_further_specimens_are_of_the_batch_that_is_usual_at_their_rate(model):
    mixed = of_batches(model, [0, 2, 1, 1, 1])
    [again] = of_kind(candidate_experiments(mixed), "more specimens")
    assert again.measurement.curves.batch[:, 0].tolist() == [0, 1, 1, 1]
    films = replace(mixed.data_of(Tensile).tests.subset(np.array([0, 1])), batch=np.array([1, 0]))
    proposed = candidate_experiments(altered(mixed, tensile=films))
    assert {e.measurement.curves.batch.tolist()[0] for e in of_kind(proposed, "planar")} == {1}


def test_two_batches_cost_no_more_than_other_tests(experiments):
    assert {e.specimens for e in of_kind(experiments, "two batches")} == {2}
    assert {e.specimens for e in of_kind(experiments, "warmer room")} == {3}
    batches = [
        e.measurement.curves.batch[:, 0].tolist() for e in of_kind(experiments, "two batches")
    ]
    assert batches == [[0, 1], [0, 1]]


def test_a_warmer_room_is_warmer_than_the_usual_one(model):
    shape = model.data_of(Curvature).tests.pressure.shape
    recorded = replace(model.data_of(Curvature).tests, temperature=np.full(shape, 21.0))
    for data, usual in ((model.data_of(Curvature).tests, 24.0), (recorded, 21.0)):
        rooms = of_kind(candidate_experiments(altered(model, actuator=data)), "warmer room")
        assert {e.plan.temperature_c for e in rooms} == {usual + WARMER}
        for e in rooms:
            assert np.all(e.measurement.curves.temperature == usual + WARMER)
    plain = of_kind(candidate_experiments(altered(model, actuator=recorded)), "finer steps")
    assert np.all(plain[0].measurement.curves.temperature == 21.0)


@dataclass(frozen=True)
class Swept:
    """A map whose chambers take up the area of their opening times the way of its centre."""

    mechanics: object

    def __call__(self, inputs):
        return self._with_volumes(inputs, self.mechanics(replace(inputs, asked="")))

    def continued(self, inputs):
        return self._with_volumes(inputs, self.mechanics.continued(replace(inputs, asked="")))

    def _with_volumes(self, inputs, found):
        if inputs.asked != "cavity_volume":
            return found
        thicker = 1.0 if inputs.wall_factor is None else inputs.wall_factor
        width, height = 10.0 - 4.0 * thicker, 8.0 - 2.0 * thicker
        size = 43e-6 * width * height * (2.0 + 0.5 * height) * inputs.linear_scale**4
        volume, slope = size * found.curvature, size * found.slope
        return replace(found, further=Further(volume, slope, 0.005 * np.abs(volume)))


class Unswept(Swept):
    """A map that answers no volumes."""

    def _with_volumes(self, inputs, found):
        return replace(found, further=None)


@pytest.fixture(scope="module")
def swept(model):
    return altered(model, forward=Swept(model.world.forward))


def test_volumes_are_proposed_where_the_map_answers_them_and_none_were_read(model, swept):
    unswept = altered(model, forward=Unswept(model.world.forward))
    assert not of_kind(candidate_experiments(unswept), "cavity volume")
    proposed = of_kind(candidate_experiments(swept), "cavity volume")
    assert [e.plan.levels for e in proposed] == [(0.0,), (24.0,)]
    data = swept.data_of(Curvature).tests
    tests = PressureTests(
        *(data.specimens, data.degradation, data.degradation_sd, data.conditions),
        *(np.where(data.mask, 0.1, 0.0), data.mask),
    )
    read = swept.with_observations(CavityVolume(tests, data))
    assert read.of_kind(CavityVolume)
    assert not of_kind(candidate_experiments(read), "cavity volume")
    floor = {p.name: p for p in proposed[0].measurement.errors}["volume_noise_floor"]
    largest = proposed[0].measurement.volumes.observed.max()
    assert floor.law.sd == pytest.approx(SHARE_OF_STROKE * largest)
    assert 0.02 < largest < 0.2


def test_readings_of_volumes_have_the_law_that_they_are_ranked_by(swept):
    """Simulated through the full equations: mean and covariance of one specimen's readings."""
    [test, *_] = [e.measurement for e in of_kind(candidate_experiments(swept), "cavity volume")]
    one = around(swept, {}, truth=ORDINARY, width=0.0)
    values = swept.table.named(np.repeat(one.draws[:1], 20_000, axis=0))
    values |= {p.name: np.full(20_000, p.law.quantile(0.5)) for p in test.errors}
    drawn = test.simulated(swept, values, np.random.default_rng(12))[:, 0]
    few = {name: value[:1] for name, value in values.items()}
    mean, law = test.expected(swept, few)[0, 0], test.covariance(swept, few)[0, 0]
    assert drawn.shape[1] == len(law) == test.read.shape[1] == 2 * len(test.bent.curves.pressure[0])
    sd = np.sqrt(np.diag(law))
    np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=0.08 * sd.max(), rtol=2e-3)
    np.testing.assert_allclose(drawn.std(axis=0), sd, rtol=0.03)
    expected = law / np.outer(sd, sd)
    assert expected[0, -1] > 0.03  # a soft specimen bends further and swells more
    np.testing.assert_allclose(np.corrcoef(drawn.T), expected, atol=0.03)


@pytest.mark.parametrize(
    ("other", "low", "high"),
    [
        ("film_mismatch.log_ratio", -0.6, 0.6),
        ("pressure_loss.fraction", 0.0, 0.5),
        ("wall_thickness.excess", -0.2, 0.2),
    ],
)
def test_volumes_come_first_where_the_size_of_the_part_is_in_doubt(swept, other, low, high):
    """They go with its cube: more than a length by calliper, or a bend angle, would tell."""
    pair = alike(swept, {"shrinkage_reading.scale_error": -0.15}, other, low, high, ORDINARY)
    ranked = rank_hypotheses(pair, candidate_experiments(swept), np.random.default_rng(13))
    assert ranked[0].experiment.kind == "cavity volume"
    assert ranked[0].decisive.expected > 20.0
    assert ranked[0].decisive.expected > 1.2 * ranked[1].decisive.expected


def test_volumes_tell_walls_from_the_material_and_no_gauge_from_it(swept):
    [volumes, *_] = of_kind(candidate_experiments(swept), "cavity volume")
    soft = ("film_mismatch.log_ratio", 0.0, 0.6, ORDINARY)
    walls = alike(swept, {"wall_thickness.excess": 0.1}, *soft)
    gauge = alike(swept, {"gauge_gain.gain": -0.1}, *soft)
    assert expected_of(walls, volumes) > 2.0
    assert abs(expected_of(gauge, volumes)) < 0.2


@pytest.mark.parametrize(
    "name", sorted(n for n, c in CATALOGUE.items() if not c.is_of_rupture_alone)
)
def test_every_cause_but_that_of_strength_alone_is_revealed_by_some_experiment(model, name):
    """A typical effect, all else known: something that is proposed shows it."""
    uniaxial = altered(model, tensile=model.data_of(Tensile).tests.subset(np.array([0, 1])))
    cause = find(name)
    sizes = {cause.qualified(k): v for k, v in cause.typical.items()}
    truth = QUIET | {"curvature_noise": 0.002, "curvature_noise_floor": 0.005}
    pair = (
        around(uniaxial, {}, truth=truth, width=0.002),
        around(uniaxial, sizes, truth=truth, width=0.002, seed=1),
    )
    found = rank_hypotheses(pair, candidate_experiments(uniaxial), np.random.default_rng(11))
    assert found[0].decisive.expected > LEAST
