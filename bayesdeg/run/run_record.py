"""Content of ``run.json``: the basis of a run, how it went, and results of its checks."""

import json
import multiprocessing
import platform
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import bayesdeg
from bayesdeg.actuator.reading import mechanics_of
from bayesdeg.analysis.calibrate import Fit, refused_inputs
from bayesdeg.analysis.model_kind import kind_of
from bayesdeg.criticism.checks.count_misfit import CountMisfit
from bayesdeg.data.settings import Known
from bayesdeg.data.study import Study
from bayesdeg.inference.model import JointModel, Refusals, share_outside
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.means import MPA, Means
from bayesdeg.observations.specimens import (
    FilmsAndActuators,
    has_elongation,
    modulus_100,
    node_name,
    young_modulus,
)
from bayesdeg.pages.left_out import Guard, OptionalStage
from bayesdeg.pages.record import (
    ComparisonEntry,
    ConvergenceEntry,
    EmulatorEntry,
    InDoubt,
    MissingEntry,
    RunRecord,
    StatisticEntry,
)
from bayesdeg.pages.wording import NOTHING, sentences, worded
from bayesdeg.run.record import Results
from bayesdeg.surrogate.surrogate import Surrogate

Floats = NDArray[np.float64]


def comparisons(study: Study, fit: Fit, counts: CountMisfit | None = None) -> list[ComparisonEntry]:
    """Return every published statistic and that of the posterior, with 90 % intervals.

    For rupture counts it is the number that the model expects without a cause of rupture.
    Quantities that it does not predict are left blank.
    """
    if study.summary is None:
        return []
    values = fit.model.table.named(fit.chain.spread(2000))
    expected = {} if counts is None else {one.degradation_pct: one for one in counts.levels[::-1]}
    rows: list[ComparisonEntry] = []
    for row in study.summary.to_dict("records"):
        level, predicted = np.array([float(row["degradation_pct"])]), NOTHING
        if row["quantity"] == "young_modulus":
            constants = fit.model.world.constants(values, level)
            predicted = _interval(young_modulus(values, constants, fit.model.causes)[:, 0])
        elif row["quantity"] == "elongation_at_break" and "elongation_scatter" in values:
            predicted = _interval(fit.model.world.elongation(values, level)[:, 0])
        elif row["quantity"] == "volume_ratio" and "volume_ratio" in values:
            predicted = _interval(values["volume_ratio"])
        elif row["quantity"] == "ruptured_count" and level[0] in expected:
            ruptures = expected[level[0]].tested * expected[level[0]].probability
            few = ruptures < FEWEST_RUPTURES
            predicted = f"fewer than {FEWEST_RUPTURES:g}" if few else f"{ruptures:.2g}"
        unit = str(row["unit"]).replace("–", "")
        sd = "" if np.isnan(row["sd"]) else f" ± {row['sd']:g}"
        rows.append(
            ComparisonEntry(
                quantity=str(row["quantity"]),
                degradation_pct=None if np.isnan(level[0]) else float(level[0]),
                predicted=predicted if predicted == NOTHING else f"{predicted} {unit}".strip(),
                published=f"{row['value']:g}{sd} {unit}".strip(),
                source=str(row["source"]),
            )
        )
    return rows


FEWEST_RUPTURES = 0.05
"""Expected ruptures below which only a bound is shown: fewer than one in twenty such studies."""


def _interval(draws: NDArray[np.float64]) -> str:
    low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95])
    return f"{middle:.3g} ({low:.3g} to {high:.3g})"


# share of refused proposals above which the posterior may be truncated
WORRYING = 0.01
LOOKED_AT = 1000  # posterior draws
FACTS = (
    "design",
    "model_version",
    "coarse_curves",
    "fine_curves",
    "curves_cut_short",
    "mesh_error_pct",
)
LIBRARIES = ("numpy", "scipy", "scikit-fem", "numba", "emcee", "arviz", "pandas", "xarray")


def run_document(
    study: Study,
    results: Results,
    seconds: dict[str, float],
    guard: Guard | None = None,
    doubted: InDoubt | None = None,
) -> RunRecord:
    """Return the content of ``run.json``: versions, seed, hashes, effort, times, counts."""
    settings, judgement = study.settings, results.judgement
    guard, doubted = guard or Guard(strict=True), doubted or InDoubt()
    base, kind = results.base.model, kind_of(results.base.model)
    expected = results.counts_expected
    compared = guard.attempt(OptionalStage.COMPARISONS, comparisons, study, results.final, expected)
    degrades = kind.degrades(study)
    model = kind.tested(base, results.final.model, study)
    if model is not None and results.averaged is not None:
        model = model.model_copy(update={"averaged": results.averaged.members})
    return RunRecord(
        title=settings.title or study.name,
        study=study.name,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        virtual=settings.virtual,
        degrades=degrades,
        note=settings.note,
        seed=settings.seed,
        effort=settings.sampling.effort,
        version=bayesdeg.__version__,
        versions=library_versions(),
        hashes=dict(study.hashes),
        seconds=seconds,
        memory=peaks_of_memory(),
        counts=draw_counts(results) | _proposal_counts(results),
        missing=tuple(MissingEntry(what=w, cost=c) for w, c in results.assembly.missing),
        rests_on=kind.basis(study, base),
        convergence={
            label: ConvergenceEntry(
                r_hat_max=max(fit.diagnosis.r_hat),
                ess_min=min(fit.diagnosis.ess_bulk),
                sentence=worded(fit.diagnosis, degrades=degrades),
                usable=bool(fit.diagnosis.usable),
            )
            for label, fit in results.sampled.items()
        },
        emulator=emulator_entry(results, guard),
        model=model,
        forward=kind.source(base),
        forward_map=doubted.forward_map,
        misfit=StatisticEntry(
            observed=None if judgement is None else judgement.misfit.statistic,
            name="log-likelihood ratio of a smooth discrepancy",
        ),
        comparisons=tuple(compared or ()),
        checks=guard.attempt(OptionalStage.CHECKS_IN_WORDS, _checks, study, results) or {},
        suspects=doubted.suspects,
        parameters_in_question=doubted.parameters_in_question,
        unused=doubted.unused,
    )


def library_versions() -> dict[str, str]:
    """Return the versions of the libraries that a run is made with, and of Python."""
    return {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()}


def _checks(study: Study, results: Results) -> dict[str, str]:
    """Return the results of checks, films and a vendor's figures in words."""
    said = {} if results.checks is None else results.checks.sentences(degrades=study.degrades)
    absorbed = None if results.judgement is None else results.judgement.absorbed
    if absorbed is not None:
        said["absorption"] = worded(absorbed, degrades=study.degrades)
    final = results.final
    vendor = vendor_check(study, final.model, final.chain.spread(DRAWS))
    if vendor is not None:
        said["vendor"] = worded(vendor, degrades=study.degrades)
    return said if results.films is None else said | results.films.sentences()


def draw_counts(results: Results) -> dict[str, int]:
    """Return the numbers of posterior draws, and of those outside the emulator's range."""
    count = results.final.chain.log_prob.size
    return {
        "posterior draws, base": results.base.chain.log_prob.size,
        "posterior draws, final": count,
        "posterior draws outside the emulator's range": (
            0 if emulated(results) is None else round(_outside(results.final) * count)
        ),
    }


def _proposal_counts(results: Results) -> dict[str, int]:
    """Return the numbers of refused proposals and of curves with a limit point."""
    forward, counts = emulated(results), dict[str, int]()
    cut = None if forward is None else emulator_facts(forward.record).curves_cut_short
    for label, fit in results.fits.items():
        counts[f"proposals of the sampler, {label}"] = fit.chain.refusals.proposed
        counts[f"proposals refused by the emulator, {label}"] = fit.chain.refusals.refused
    name = "finite element curves of the emulator that met a limit point"
    return counts | ({} if cut is None else {name: int(cut)})


def emulated(results: Results) -> Surrogate | None:
    """Return the emulator that replaced the mechanics, if any."""
    world = results.base.model.world
    forward = mechanics_of(world.forward) if isinstance(world, FilmsAndActuators) else None
    return forward if isinstance(forward, Surrogate) else None


def _outside(fit: Fit) -> float:
    """Return the share of a posterior that lies outside the emulator's range, from some draws."""
    return share_outside(fit.model, fit.chain.spread(LOOKED_AT))


def emulator_entry(results: Results, guard: Guard) -> EmulatorEntry:
    """Return the emulator's entry, with what it refuses of a posterior and its sampling."""
    forward = emulated(results)
    if forward is None:
        return EmulatorEntry()
    chains = {id(fit.chain): fit.chain.refusals for fit in results.fits.values()}
    refusals = sum(chains.values(), start=Refusals())
    refused = {}
    if results.final.model.of_kind(Curvature):
        refused = guard.attempt(OptionalStage.REFUSED, refused_inputs, results.final) or {}
    words = [refusal_words(refusals), outside_words(_outside(results.final))]
    if refused:
        listed = "; ".join(refused.values())
        words.append(f"For new specimens in the same tests it refuses: {listed}.")
    return emulator_facts(forward.record).model_copy(
        update={
            "refusals": " ".join(filter(None, words)),
            "refused_inputs": refused,
            "training": json.loads(forward.record),
        }
    )


def emulator_facts(record: str) -> EmulatorEntry:
    """Return the facts in a trained emulator's record, as far as given.

    Parameters
    ----------
    record : str
        JSON. Every key may be missing: ``design``, ``model_version``, ``coarse_curves``,
        ``fine_curves``, ``curves_cut_short``, ``mesh_error_pct``, and ``accuracy``, which maps a
        quantity to ``rms_pct``, ``p95_pct``, ``max_pct`` [%] and ``coverage_90`` [–] on curves
        that were not trained on; ``refinement``, see `bayesdeg.analysis.region.ErrorLeft`.

    Examples
    --------
    >>> facts = emulator_facts('{"coarse_curves": 64, "accuracy": {"limit": {"p95_pct": 1.5}}}')
    >>> facts.coarse_curves, facts.accuracy[0].quantity, facts.accuracy[0].p95_pct
    (64, 'limit', 1.5)
    """
    trained = json.loads(record)
    by_quantity = trained.get("accuracy", {})
    if not by_quantity and "left_out_rms_pct" in trained:
        older = {
            "rms": "left_out_rms_pct",
            "p95": "left_out_p95_pct",
            "max": "left_out_largest_pct",
        }
        by_quantity = {"curvature": {f"{k}_pct": trained.get(key) for k, key in older.items()}}
    entries = [{"quantity": name} | measured for name, measured in by_quantity.items()]
    facts = EmulatorEntry.read({name: trained.get(name) for name in FACTS} | {"accuracy": entries})
    rms = by_quantity.get("curvature", {}).get("rms_pct")
    error = None if rms is None else float(np.hypot(rms, facts.mesh_error_pct or 0.0))
    refined = trained.get("refinement")
    said = sentences("run", "trained", facts=facts, rms=rms, refined=refined)
    return facts.model_copy(update={"error_pct": error, "record": said})


def outside_words(share: float) -> str:
    """Say what share of the posterior is outside the emulator's range; empty if none.

    Examples
    --------
    >>> outside_words(0.25).split(", ")[0]
    "25 % of the posterior lies outside the emulator's range"
    """
    return sentences("run", "outside", share=share)


def refusal_words(refusals: Refusals) -> str:
    """Say how many proposals the emulator refused, and what to do if there are many.

    Examples
    --------
    >>> refusal_words(Refusals(200_000, 50)).split(" as ")[0]
    'The emulator refused 50 of 200000 proposals of the sampler (0.025 %)'
    """
    facts = {"proposed": refusals.proposed, "refused": refusals.refused, "worrying": WORRYING}
    return sentences("run", "refusals", **facts)


DRAWS = 2000  # posterior draws for the comparison with a vendor's figure
FRESH = np.array([0.0])  # degradation rate at which vendors measure [%]


@dataclass(frozen=True)
class VendorFigure:
    """A vendor's figure and the posterior of the same quantity.

    Parameters
    ----------
    quantity, unit : str
        What it is, and in what.
    value, sd : float
        As stated.
    use : str
        ``datum``, ``prior``, or why it is not used.
    middle, low, high : float, optional
        Median and 90 % interval of the posterior; None where it has no such quantity.
    """

    quantity: str
    unit: str
    value: float
    sd: float
    use: str
    middle: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def distance(self) -> float | None:
        """Deviation of the posterior median from the figure, in the figure's sd."""
        return None if self.middle is None else (self.middle - self.value) / self.sd


@dataclass(frozen=True)
class VendorCheck:
    """All figures of a vendor.

    Parameters
    ----------
    figures : tuple of VendorFigure
        At least one.
    source : str
        Where they stand.
    """

    figures: tuple[VendorFigure, ...]
    source: str


def vendor_check(study: Study, model: JointModel, vectors: Floats) -> VendorCheck | None:
    """Return a vendor's figures and the posterior's; None if the study states none.

    Parameters
    ----------
    study : Study
        Its settings hold the figures.
    model : JointModel
        The final one.
    vectors : array, shape (n, n_parameters)
        Draws of its posterior, unconstrained.
    """
    if not isinstance(model.world, FilmsAndActuators):
        return None
    vendor, found = study.settings.vendor, list[VendorFigure]()
    values = model.table.named(vectors)
    if vendor.modulus_100 is not None:
        draws = modulus_100(values, model.world.constants(values, FRESH), model.causes)[:, 0]
        found.append(_beside("modulus_100", "kPa", vendor.modulus_100, "datum", draws / MPA))
    if vendor.elongation_at_break is not None:
        draws = (
            model.world.elongation(values, FRESH)[:, 0]
            if has_elongation(model.base)
            else np.empty(0)
        )
        if not has_elongation(model.base):
            use = "there is no actuator that could burst"
        elif model.of_kind(Breaks) or any(
            one.quantity == "elongation_at_break" for one in model.data_of(Means).statistics
        ):
            use = "the study has its own elongations"
        elif node_name("elongation", 0.0) in study.settings.priors:
            use = "the study states a prior"
        else:
            use = "prior"
        found.append(_beside("elongation_at_break", "%", vendor.elongation_at_break, use, draws))
    return VendorCheck(tuple(found), vendor.source) if found else None


def _beside(quantity: str, unit: str, stated: Known, use: str, draws: Floats) -> VendorFigure:
    """Return a figure with the posterior of the same quantity, if that has any."""
    known = np.quantile(draws, [0.05, 0.5, 0.95]).tolist() if len(draws) else [None, None, None]
    low, middle, high = known
    return VendorFigure(quantity, unit, stated.value, stated.sd, use, middle, low, high)


#: The highest resident size since the program began, in kB; of this program alone, where
#: `resource.getrusage` gives that of the process which started it, if that was larger.
_HIGHEST = re.compile(r"^VmHWM:\s+(\d+) kB$", re.MULTILINE)


def peaks_of_memory(name: str = "main process") -> dict[str, float]:
    """Return the largest resident memory of this process and of its largest worker now [MB].

    Empty if the system does not report it (Linux does).

    Parameters
    ----------
    name : str
        Of this process in what is returned.

    Examples
    --------
    >>> all(size > 0.0 for size in peaks_of_memory().values())
    True
    """
    own = _peak("self")
    if own is None:
        return {}
    known = [_peak(str(worker.pid)) for worker in multiprocessing.active_children()]
    sizes = [size for size in known if size is not None]
    return {name: own} | ({"largest worker": max(sizes)} if sizes else {})


def _peak(process: str) -> float | None:
    """Return the peak memory of a process [MB]; None if it has ended or is unknown."""
    try:
        found = _HIGHEST.search(Path("/proc", process, "status").read_text(encoding="ascii"))
    except (OSError, UnicodeDecodeError):
        return None
    return None if found is None else round(int(found[1]) * 1024 / 1e6, 1)
