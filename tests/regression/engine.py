"""All that the frozen numbers know of the package: where its interface changes, this file follows.

`load` gives what has a posterior density, whatever it is made of, as an `Adapter`; `verdict` gives
what is concluded, as numbers by name.

Vectors (n, n_parameters) are those of the sampler, on its unconstrained scale, in the order of
`names`. Every other number has a label: kind of data, specimen, condition (a mode of tension, a
source), and a number that tells readings apart which share the three, in the order of the table.
"""

import importlib
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.analysis.judge import judge_model
from bayesdeg.analysis.summary import summary
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.causes.cause import Cause
from bayesdeg.data.study import Study, read_study
from bayesdeg.inference.course import CourseModel, course_model, moisture_at
from bayesdeg.inference.laplace import approximate
from bayesdeg.inference.model import JointModel, near_films, replicate
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import ActuatorCurves, Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.noise import sequential
from bayesdeg.observations.published import RSquared, of_tests, published_tests
from bayesdeg.observations.tensile import Tensile
from bayesdeg.priors import ParameterTable
from bayesdeg.surrogate.trained import default_surrogate
from tests.hidden_effects.judging import concluded, judged

Floats = NDArray[np.float64]
Label = tuple[str, str, str, str]

ROOT = Path(__file__).resolve().parents[2]
STUDIES, PLANTED = ROOT / "studies", ROOT / "tests" / "hidden_effects" / "studies"
COARSE = (4, 1, 1)  # bricks of the beam: its numbers are frozen, not its accuracy
SIMULATED = 1  # seed of the readings of the simple machine, and of verdicts


class Block(NamedTuple):
    """Numbers with a label for each column.

    Parameters
    ----------
    labels : list of (kind, specimen, condition, number)
    values : array, shape (n_vectors, n_labels)
    """

    labels: list[Label]
    values: Floats


def labelled(places: Iterable[tuple[str, str, str]], values: Floats) -> Block:
    """Number what shares kind, specimen and condition."""
    seen: Counter[tuple[str, str, str]] = Counter()
    labels = []
    for place in places:
        labels.append((*place, str(seen[place])))
        seen[place] += 1
    assert values.shape[1:] == (len(labels),)
    return Block(labels, np.asarray(values, dtype=np.float64))


def joined(blocks: Iterable[Block]) -> Block:
    """Return the columns of several blocks as those of one."""
    labels, values = zip(*blocks, strict=True)
    return Block([label for part in labels for label in part], np.concatenate(values, axis=1))


class Adapter:
    """What adapters share: a table of parameters. What they do not have is None."""

    table: ParameterTable
    candidates: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of vectors."""
        return self.table.names

    def prior(self, generator: np.random.Generator, count: int) -> Floats:
        """Draw vectors from the prior."""
        return self.table.sample(generator, count)

    def column(self, name: str, value: float) -> float:
        """Return where a value of a parameter is on the sampler's scale."""
        law = self.table.parameters[self.names.index(name)].law
        return float(law.to_unconstrained(np.asarray(value)))

    def named(self, vectors: Floats) -> dict[str, Floats]:
        """Return values by name, (n,)."""
        return self.table.named(vectors)

    def mode(self, generator: np.random.Generator) -> tuple[Floats, Floats]:
        """Return a vector near the mode and a covariance about it."""
        raise NotImplementedError

    def extended(self, names: Iterable[str]) -> Self:
        """Return it with causes active."""
        assert not tuple(names)
        return self

    def typical(self, name: str) -> dict[str, float]:
        """Return values of a cause's parameters at a size met in practice."""
        raise NotImplementedError

    def log_prob(self, vectors: Floats) -> Floats:
        """Return the log posterior density, (n,)."""
        raise NotImplementedError

    def blocks(self, vectors: Floats) -> Block:
        """Return the log likelihood specimen by specimen."""
        raise NotImplementedError

    def pointwise(self, vectors: Floats) -> Block | None:
        """Return the log density of each reading given those before it on its specimen."""
        return None

    def expected(self, vectors: Floats) -> Block | None:
        """Return the readings expected of specimens that are as the mean."""
        return None

    def simulated(self, vectors: Floats, seed: int) -> Block | None:
        """Return readings that new specimens would show."""
        return None

    def replicated(self, vector: Floats, seed: int) -> Block | None:
        """Return data of every kind drawn anew, summed over the readings of each specimen."""
        return None


# ---- a study folder


@dataclass(frozen=True)
class Folder(Adapter):
    """The model of a study folder.

    Parameters
    ----------
    model : JointModel
    causes : tuple of Cause
        Its candidates.
    """

    model: JointModel
    causes: tuple[Cause, ...]

    @cached_property
    def table(self) -> ParameterTable:
        return self.model.table

    @property
    def candidates(self) -> tuple[str, ...]:
        return tuple(cause.name for cause in self.causes)

    def extended(self, names: Iterable[str]) -> Self:
        chosen = [cause for cause in self.causes if cause.name in set(names)]
        return replace(self, model=self.model.extended(*chosen))

    def typical(self, name: str) -> dict[str, float]:
        return _typical(self.causes, name)

    def mode(self, generator: np.random.Generator) -> tuple[Floats, Floats]:
        films = self.model.of_kind(Tensile)
        start = near_films(self.model, generator) if films else None
        found = approximate(self.model, generator, start=start)
        return found.mode, found.covariance

    def log_prob(self, vectors: Floats) -> Floats:
        return self.model.log_prob(vectors)

    def blocks(self, vectors: Floats) -> Block:
        with np.errstate(all="ignore"):
            found = self.model.log_likelihood(self.named(vectors))
        return joined(
            labelled(((kind, *one) for one in self._specimens(kind)), values)
            for kind, values in found.items()
        )

    def pointwise(self, vectors: Floats) -> Block | None:
        state, parts = self.model.state(self.named(vectors)), []
        for kind in (Tensile, Curvature):
            for one in self.model.of_kind(kind):
                parts.append(sequential(one.linearised(state))[:, one.tests.paths.mask])
        return self._of_readings(np.concatenate(parts, axis=1)) if parts else None

    def expected(self, vectors: Floats) -> Block | None:
        if self._subject is None:
            return None
        return self._of_readings(self._subject.expected(vectors))

    def simulated(self, vectors: Floats, seed: int) -> Block | None:
        if self._subject is None:
            return None
        generator = np.random.default_rng(seed)
        return self._of_readings(self._subject.simulated(vectors, generator))

    def replicated(self, vector: Floats, seed: int) -> Block | None:
        if self.model.of_kind(RSquared):
            return None
        values, generator = self.named(vector[None]), np.random.default_rng(seed)
        new, parts = replicate(self.model, values, generator), []
        if new.of_kind(Tensile):
            total = new.data_of(Tensile).tests.stress.sum(axis=1)
            parts.append(
                labelled((("tensile", *s) for s in self._specimens("tensile")), total[None])
            )
        if new.of_kind(Curvature):
            parts += _totals(new.data_of(Curvature).tests)
        if new.of_kind(Breaks):
            broken = [("breaks", *one) for one in self._specimens("breaks")]
            parts.append(labelled(broken, new.data_of(Breaks).table.elongation[None]))
        if new.data_of(Means).statistics:
            means = [("statistics", *one) for one in self._specimens("statistics")]
            parts.append(
                labelled(means, np.array([[s.value for s in new.data_of(Means).statistics]]))
            )
        return joined(parts)

    @property
    def _subject(self) -> JointModel | None:
        return self.model if self.model.criticised else None

    def _of_readings(self, values: Floats) -> Block:
        assert self._subject is not None
        places = self._subject.places
        mode = np.where(places.family == "film", places.history, "")
        columns = (places.kind.tolist(), places.specimen.tolist(), mode.tolist())
        return labelled(zip(*columns, strict=True), values)

    def _specimens(self, kind: str) -> list[tuple[str, str]]:
        """Return specimen and condition of what a block of the log likelihood is of."""
        model = self.model
        if kind == "tensile":
            assert model.of_kind(Tensile)
            return list(
                zip(
                    model.data_of(Tensile).tests.specimens,
                    model.data_of(Tensile).tests.modes,
                    strict=True,
                )
            )
        if kind == "statistics":
            return [
                (f"{s.quantity} at {s.degradation:g} %", s.source)
                for s in model.data_of(Means).statistics
            ]
        if kind in ("r_squared", "ruptures"):
            assert model.of_kind(RSquared)
            levels = model.data_of(RSquared).tests.degradation[
                model.data_of(RSquared).tests.given(kind)
            ]
            return [(f"{level:g} %", "") for level in levels]
        data = model.data_of(Breaks).table if kind == "breaks" else model.data_of(Curvature).tests
        assert data is not None
        return [(specimen, "") for specimen in data.specimens]


def _totals(data: ActuatorCurves) -> list[Block]:
    """Return sums of each specimen's readings, and the pressure at which it burst; 0 if not."""
    burst = np.where(data.ruptured, data.pressure, 0.0).sum(axis=1)
    sums = {"curvature": data.curvature, "bend angle": data.bend_angle}
    found = {kind: values.sum(axis=1) for kind, values in sums.items()} | {"burst": burst}
    return [
        labelled(((kind, specimen, "") for specimen in data.specimens), values[None])
        for kind, values in found.items()
    ]


def _typical(causes: Iterable[Cause], name: str) -> dict[str, float]:
    [cause] = (cause for cause in causes if cause.name == name)
    return {cause.qualified(p): float(value) for p, value in cause.typical.items()}


# ---- moisture of films, which has a density of its own


@dataclass(frozen=True)
class Course(Adapter):
    """The course of degradation in films.

    Parameters
    ----------
    model : CourseModel
    """

    model: CourseModel

    @cached_property
    def table(self) -> ParameterTable:
        return self.model.table

    def mode(self, generator: np.random.Generator) -> tuple[Floats, Floats]:
        found = approximate(self.model, generator)
        return found.mode, found.covariance

    def log_prob(self, vectors: Floats) -> Floats:
        return self.model.log_prob(vectors)

    def blocks(self, vectors: Floats) -> Block:
        return self._of_films(self.model.log_likelihood(self.named(vectors))["moisture"])

    def expected(self, vectors: Floats) -> Block:
        return self._of_films(moisture_at(self.named(vectors), self.model.time_h))

    def _of_films(self, values: Floats) -> Block:
        return labelled((("moisture", film, "") for film in self.model.films), values)


# ---- a script with a forward map of its own


@dataclass(frozen=True)
class Script(Adapter):
    """A forward map with a catalogue of its own.

    Parameters
    ----------
    model : JointModel
    causes : tuple of Cause
    """

    model: JointModel
    causes: tuple[Cause, ...]

    @cached_property
    def table(self) -> ParameterTable:
        return self.model.table

    @property
    def candidates(self) -> tuple[str, ...]:
        return tuple(cause.name for cause in self.causes)

    def extended(self, names: Iterable[str]) -> Self:
        chosen = [cause for cause in self.causes if cause.name in set(names)]
        return replace(self, model=self.model.extended(*chosen))

    def typical(self, name: str) -> dict[str, float]:
        return _typical(self.causes, name)

    def mode(self, generator: np.random.Generator) -> tuple[Floats, Floats]:
        found = approximate(self.model, generator)
        return found.mode, found.covariance

    def log_prob(self, vectors: Floats) -> Floats:
        return self.model.log_prob(vectors)

    def blocks(self, vectors: Floats) -> Block:
        with np.errstate(all="ignore"):
            found = self.model.group_density(vectors)
        return labelled((("group", group, "") for group in self.model.groups), found)

    def expected(self, vectors: Floats) -> Block:
        return self._of_readings(self.model.expected(vectors))

    def simulated(self, vectors: Floats, seed: int) -> Block:
        return self._of_readings(self.model.simulated(vectors, np.random.default_rng(seed)))

    def _of_readings(self, values: Floats) -> Block:
        places = self.model.places
        columns = (places.kind, places.specimen, places.history)
        return labelled(zip(*(c.tolist() for c in columns), strict=True), values)


# ---- the beam of silicone


@dataclass(frozen=True)
class Beam(Adapter):
    """The posterior of the silicone beam, linear in its nuisances about the first vector given.

    Parameters
    ----------
    posterior : dragon_skin.posterior.Posterior
    """

    posterior: Any

    @cached_property
    def table(self) -> ParameterTable:
        return self.posterior.table

    @property
    def candidates(self) -> tuple[str, ...]:
        return tuple(script("dragon_skin.causes").CAUSES)

    def extended(self, names: Iterable[str]) -> Self:
        return replace(self, posterior=self.posterior.with_causes(names))

    def typical(self, name: str) -> dict[str, float]:
        """Return the size of a cause at two thirds of its prior; of one without a size nothing."""
        sampled = script("dragon_skin.causes").CAUSES[name].sampled
        return {} if sampled is None else {sampled.name: float(sampled.law.quantile(2.0 / 3.0))}

    def mode(self, generator: np.random.Generator) -> tuple[Floats, Floats]:
        """Return the medians of the priors and a tenth of their spreads: enough to be typical."""
        draws = self.prior(generator, 400)
        return np.median(draws, axis=0), np.diag((0.1 * draws.std(axis=0)) ** 2)

    def log_prob(self, vectors: Floats) -> Floats:
        return np.asarray(self._linearised(vectors).log_prob(vectors))

    def blocks(self, vectors: Floats) -> Block:
        found = self._linearised(vectors).log_likelihood(self.named(vectors))
        return labelled([("markers", "", "")], found[:, None])

    def expected(self, vectors: Floats) -> Block:
        here = self._linearised(vectors)
        places = [
            ("marker", f"take {take}, {('held', 'at rest')[rest]}", f"marker {marker}")
            for take, rest, marker, _ in np.ndindex(*script("dragon_skin.scene").SHAPE)
        ]
        return labelled(places, here.observed - here.residual(self.named(vectors)))

    def simulated(self, vectors: Floats, seed: int) -> Block:
        generator = np.random.default_rng(seed)
        drawn = self._linearised(vectors).nuisances(self.named(vectors), generator)
        return labelled([("nuisance", "", "")] * drawn.shape[1], drawn)

    def _linearised(self, vectors: Floats) -> Any:
        values = self.named(vectors[:1])
        return self.posterior.linearised({name: float(v[0]) for name, v in values.items()})


# ---- by name


def script(name: str) -> ModuleType:
    """Import a module of the folder of studies."""
    if str(STUDIES) not in sys.path:
        sys.path.append(str(STUDIES))
    return importlib.import_module(name)


def _folder(path: Path, *, only: tuple[str, ...] = ()) -> Assembly:
    return assemble(_reduced(read_study(path), only) if only else read_study(path))


def _reduced(study: Study, only: tuple[str, ...]) -> Study:
    """Return a study of some of its tables alone."""
    tables = ("moisture", "shrinkage", "tensile", "breaks", "actuator", "summary")
    return replace(study, **{name: None for name in tables if name not in only})


def _of(assembly: Assembly) -> Folder:
    return Folder(assembly.model, assembly.candidates)


def _published() -> Folder:
    """Return the published statistics as data, the counts of ruptures among them."""
    study = _reduced(read_study(STUDIES / "gelatin_actuator"), ("summary",))
    found, tests = _of(assemble(study)), published_tests(study)
    assert tests is not None
    return replace(found, model=found.model.with_observations(*of_tests(tests)))


def _course() -> Course:
    found = course_model(read_study(STUDIES / "gelatin_actuator"))
    assert found is not None
    return Course(found)


def _ball(*, gravity_known: bool) -> Script:
    module = script("falling_ball")
    return Script(module.asked(gravity_known=gravity_known).density, module.CATALOGUE)


def _machine() -> Script:
    module = script("simple_machine")
    causes = {cause.name: cause for some in module.CATALOGUES.values() for cause in some}
    model = module.asked(SIMULATED).density
    (work,) = model.observations
    # specimens had numbers, and groups their efforts, when the numbers were frozen
    numbered = np.arange(1, len(work.observed) + 1).astype(np.str_)
    labelled = replace(work, read_at=replace(work.read_at, specimen=numbered))
    return Script(model.with_observations(labelled), tuple(causes.values()))


def _beam() -> Beam:
    solutions, scene, record = (
        script(f"dragon_skin.{name}") for name in ("solutions", "scene", "record")
    )
    everything = np.ones(scene.SHAPE, dtype=bool)
    forward = solutions.build_map(COARSE, 3)
    return Beam(script("dragon_skin.posterior").Posterior(record.read(), forward, (), everything))


LOADERS: Mapping[str, Callable[[], Adapter]] = {
    "gelatin_actuator": lambda: _of(_folder(STUDIES / "gelatin_actuator")),
    "treloar": lambda: _of(_folder(STUDIES / "treloar")),
    "published statistics": _published,
    # bend angles, cycles and mounts; times, branches and humidity; ruptures; films alone
    "planted 11": lambda: _of(_folder(PLANTED / "11")),
    "planted 13": lambda: _of(_folder(PLANTED / "13")),
    "planted 19": lambda: _of(_folder(PLANTED / "19")),
    "films of planted 22": lambda: _of(
        _folder(PLANTED / "22", only=("moisture", "shrinkage", "tensile", "breaks"))
    ),
    "moisture of gelatin_actuator": _course,
    "falling_ball": lambda: _ball(gravity_known=False),
    "falling_ball, g known": lambda: _ball(gravity_known=True),
    "simple_machine": _machine,
    "dragon_skin_beam": _beam,
}


def load(name: str) -> Adapter:
    """Return what has a posterior density, without a cause."""
    return LOADERS[name]()


# ---- verdicts


def _verdict_of_folder(path: Path) -> dict[str, Any]:
    return concluded(judged(_folder(path), seed=SIMULATED))


def _verdict_of_script(model: Script) -> dict[str, Any]:
    found = summary(judge_model(model.model, model.causes, seed=SIMULATED))
    fitted = {"+".join(one["causes"]): one for one in found["fitted"]}
    numbers = ("outcome", "causes", "threshold", "misfit", "misfit_left", "explained_fraction")
    return {
        **{name: found[name] for name in (*numbers, "held_out", "trusted")},
        "fitted": {
            name: {part: one[part] for part in ("log_bayes_factor", "posterior")}
            for name, one in fitted.items()
        },
    }


def _published_answers() -> dict[str, Any]:
    """Return what the script of the published numbers makes of a hundred materials."""
    published, agreement, rupture = (
        script(f"nagai_2021.{name}") for name in ("published", "agreement", "rupture")
    )
    surrogate, generator = default_surrogate(), np.random.default_rng(SIMULATED)
    materials, curves = published.draw(surrogate, generator, 100)
    fits = {
        name: agreement.fit(curves, model, generator, inner=16)
        for name, model in agreement.MODELS.items()
    }
    walls = rupture.draw_walls(surrogate, materials, generator)
    return {
        "log_evidence": {name: fit.log_evidence()[0] for name, fit in fits.items()},
        "log_likelihood": {
            name: fit.log_likelihood.mean(axis=0).tolist() for name, fit in fits.items()
        },
        "absolute_misfit": agreement.absolute_misfit(curves).mean(axis=0).tolist(),
        "sensitivity": published.sensitivity(materials).mean(axis=0).tolist(),
        "probability_of_counts": {
            str(h): rupture.probability_of_counts(walls, h)[0] for h in rupture.HYPOTHESES
        },
    }


VERDICTS: Mapping[str, Callable[[], dict[str, Any]]] = {
    "gelatin_actuator": lambda: _verdict_of_folder(STUDIES / "gelatin_actuator"),
    "treloar": lambda: _verdict_of_folder(STUDIES / "treloar"),
    "planted 19": lambda: _verdict_of_folder(PLANTED / "19"),
    "falling_ball": lambda: _verdict_of_script(_ball(gravity_known=False)),
    "falling_ball, g known": lambda: _verdict_of_script(_ball(gravity_known=True)),
    "simple_machine": lambda: _verdict_of_script(_machine()),
    "nagai_2021_summary": _published_answers,
}


def verdict(name: str) -> dict[str, Any]:
    """Return what is concluded at quick effort, as words, numbers and lists of them by name."""
    return VERDICTS[name]()
