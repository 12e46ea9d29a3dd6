from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.stats import multivariate_normal

from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.criticism.experiments.designs import (
    MOUNTS,
    WALL,
    PartMeasurements,
    candidate_experiments,
)
from bayesdeg.criticism.experiments.ranking import (
    LEAST,
    NO_CAUSE,
    ActuatorTests,
    FilmTests,
    Foretold,
    Hypothesis,
    ReadingsLaw,
    compare,
    foretell,
    hypotheses_of,
    next_experiments_document,
    rank,
    rank_hypotheses,
    separation,
    with_noise,
)
from bayesdeg.criticism.fit.trials import Trial
from bayesdeg.emulator.trained import default_surrogate
from bayesdeg.inference.laplace import Evidence
from bayesdeg.report.wording import worded
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
    data = whole.actuator.subset(np.repeat(np.arange(5), 3))
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


def alike(model, first, name, low, high):
    """A second cause of the size at which it bends the old tests as the first does."""

    def curvatures(sizes):
        hypothesis = around(model, sizes, width=0.0)
        values = hypothesis.model.table.named(hypothesis.draws[:1])
        return hypothesis.model.predict(values).mean[0][model.actuator.mask]

    target = curvatures(first)

    def distance(size):
        return float(np.nansum((np.log(curvatures({name: size})) - np.log(target)) ** 2))

    size = minimize_scalar(distance, bounds=(low, high), method="bounded").x
    return around(model, first, seed=1), around(model, {name: float(size)}, seed=2)


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
    both = separation(*(Foretold(law, data) for law, data in zip(laws, drawn, strict=True)))
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
        told = foretell(named, experiment.measurement, generator)
        for found, (a, b) in zip(separation(*told), (told, told[::-1]), strict=True):
            # what is left is the nonlinearity of the specimens' deviations
            assert abs(found.expected - a.law.divergence(b.law)) < 4.0 * found.error + 0.05


def test_scatter_is_that_of_the_linearised_model(model):
    hypothesis = around(model, {}, width=0.0)
    values = model.table.named(hypothesis.draws[:1])
    # readings as predicted: the most probable deviations are zero
    exact = model.with_readings(model.predict(values).mean[0])
    films = replace(exact.tensile, stress=exact.stresses(values, exact.tensile).at_rest[0])
    exact = altered(exact, tensile=films)
    scatter = exact.scatter(hypothesis.draws[0])
    place = 0
    for test in (FilmTests(exact.tensile, 1), ActuatorTests(exact.actuator, 1)):
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


def test_only_a_second_gauge_or_a_strip_separates_a_leak_from_the_material(model, experiments):
    pair = alike(model, {"pressure_loss.fraction": 0.1}, "film_mismatch.log_ratio", 0.0, 0.6)
    ranked = rank_hypotheses(pair, experiments, np.random.default_rng(6))
    assert ranked[0].experiment.kind == "second gauge"
    assert ranked[0].decisive.expected > 10.0
    assert ranked[1].experiment.kind == STRIP
    assert all(r.decisive.expected < LEAST for r in ranked[2:])


def test_weighing_the_actuator_reveals_a_misread_degradation_rate(model, experiments):
    misread = {"degradation_misread.shift": 4.0, "degradation_misread.scatter": 0.1}
    pair = around(model, misread), around(model, {"erosion.lost_share": 0.1}, seed=1)
    [weighed] = [e for e in experiments if e.kind == "weighed piece"]
    assert expected_of(pair, weighed) > LEAST
    [walls] = [e for e in of_kind(experiments, WALLS) if e.plan.levels != (0.0,)]
    assert expected_of(pair, walls) > LEAST


WALLS = "roof"


def test_walls_read_what_erosion_and_thickness_leave(model):
    sizes = {"erosion.lost_share": 0.1, "wall_thickness.excess": -0.05}
    hypothesis = around(model, sizes, width=0.0)
    values = hypothesis.model.table.named(hypothesis.draws[:1])
    level = np.array([[0.0], [25.0]])
    test = PartMeasurements(WALL, level, 0.0 * level, 100.0 + 0.0 * level, 2)
    scale = TRUTH["volume_ratio"] ** (1.0 / 3.0)
    by_hand = [0.95 * scale, 0.95 * scale - 0.1 * scale]
    assert test.expected(hypothesis.model, values)[0, :, 0] == pytest.approx(by_hand)


def test_a_strip_of_the_paper_tells_softer_paper_from_thinner_walls(model, experiments):
    softer = around(model, {"paper_softening.softening": 1.0})
    thinner = around(model, {"erosion.lost_share": 0.1}, seed=1)
    strips = of_kind(experiments, "strip of the paper")
    [degraded] = [e for e in strips if e.plan.levels != (0.0,)]
    assert expected_of((softer, thinner), degraded) > LEAST
    drawn = softer.model.table.named(softer.draws[:1])
    level = degraded.measurement.degradation
    by_hand = np.log(TRUTH["paper_stiffness"]) - drawn["paper_softening.softening"] * level / 25.0
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
    assert next_experiments_document(found, repr) == []


def test_the_document_holds_what_the_contract_asks_for(ranked):
    document = next_experiments_document(ranked, repr, most=2)
    assert len(document) == 2
    for entry, source in zip(document, ranked, strict=False):
        assert entry["design"] == repr(source.experiment.plan)
        assert len(entry["separates"]) == 2
        assert entry["expected_log_bayes_factor"] == pytest.approx(
            source.decisive.expected, abs=0.01
        )
        assert entry["specimens"] == source.experiment.specimens > 0
        assert entry["readings"] >= entry["specimens"]
        assert len(entry["pairs"]) == 3


def test_more_specimens_are_worth_more(model, many):
    data = model.actuator.subset(np.array([0]))
    few, more = (ActuatorTests(data, k) for k in (1, 6))
    pair = (many[0], many[2])
    worth = [compare(pair, m, np.random.default_rng(9))[0].expected for m in (few, more)]
    assert worth[1] > 1.5 * worth[0]


# ---- what cannot be foretold


def test_readings_beyond_the_range_are_left_out(model, many):
    data = model.actuator.subset(np.array([0]))
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
    return Trial(subject, mode, 0.0, posterior, np.eye(size), mode)


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
    "hold": Change(
        {"time": np.tile(600.0 * np.arange(7), (15, 1)), "pressure": np.full(SHAPE, 100.0)},
        {"hold", "held steps", "finer steps"},
    ),
}


@pytest.mark.parametrize("name", HAS)
def test_only_what_the_study_does_not_have_is_proposed(model, name):
    plain = {e.kind for e in candidate_experiments(model)}
    data = replace(model.actuator, **HAS[name].fields)
    proposed = {e.kind for e in candidate_experiments(altered(model, actuator=data))}
    assert HAS[name].gone <= plain
    assert plain - proposed == HAS[name].gone


def test_candidates_keep_to_the_design_of_the_study(model, experiments):
    top = model.actuator.pressure.max()
    for experiment in experiments:
        if isinstance(experiment.measurement, ActuatorTests):
            curves = experiment.measurement.curves
            assert curves.pressure.max() <= top
            assert curves.degradation.max() <= model.nodes[-1]
            assert len(curves.specimens) * experiment.measurement.copies == experiment.specimens
        assert f"{experiment.specimens} " in worded(experiment.plan)


def test_a_burst_level_is_tested_up_to_what_half_of_its_specimens_reached(model):
    data = model.actuator  # the one specimen at 24 % was read at five of seven pressures
    tests = [
        e.measurement.curves
        for e in candidate_experiments(model)
        if e.kind == "unloading" and e.plan.levels[0] > 20.0
    ]
    assert [t.pressure.max() for t in tests] == [data.pressure[4, 4]]


def test_films_alone_are_tested_in_another_mode(model):
    uniaxial = model.tensile.subset(np.array([0, 1]))
    alone = altered(model, actuator=None, tensile=uniaxial)
    assert {e.kind for e in candidate_experiments(alone)} == {"equibiaxial", "planar"}
    assert candidate_experiments(altered(model, actuator=None, tensile=None)) == ()


def test_an_equibiaxial_test_separates_what_uniaxial_films_cannot(model):
    uniaxial = altered(model, tensile=model.tensile.subset(np.array([0])))
    found = {e.kind: e for e in candidate_experiments(uniaxial)}
    pair = around(uniaxial, {}), around(uniaxial, {"second_invariant.ratio": 0.2}, seed=1)
    assert expected_of(pair, found["equibiaxial"]) > LEAST


# no proposal is of another batch or in another room
NOT_PROPOSED = {"batch_stiffness", "temperature_softening"}


@pytest.mark.parametrize("name", sorted(NOT_PROPOSED))
def test_what_no_proposal_records_none_can_show(model, name):
    tests = [
        one.measurement.curves.conditions
        for one in candidate_experiments(model)
        if isinstance(one.measurement, ActuatorTests)
    ]
    assert tests
    assert all(find(name).blind(test) is not None for test in tests)


@pytest.mark.parametrize(
    "name",
    sorted(n for n, c in CATALOGUE.items() if not c.is_of_rupture_alone and n not in NOT_PROPOSED),
)
def test_every_cause_but_that_of_strength_alone_is_revealed_by_some_experiment(model, name):
    """A typical effect, all else known: something that is proposed shows it."""
    uniaxial = altered(model, tensile=model.tensile.subset(np.array([0, 1])))
    cause = find(name)
    sizes = {cause.qualified(k): v for k, v in cause.typical.items()}
    truth = QUIET | {"curvature_noise": 0.002, "curvature_noise_floor": 0.005}
    pair = (
        around(uniaxial, {}, truth=truth, width=0.002),
        around(uniaxial, sizes, truth=truth, width=0.002, seed=1),
    )
    found = rank_hypotheses(pair, candidate_experiments(uniaxial), np.random.default_rng(11))
    assert found[0].decisive.expected > LEAST
