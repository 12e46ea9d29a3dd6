"""``bayesdeg simulate``: a virtual experiment."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.families import geometry_of_study, with_dimensions
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.reading import as_read
from bayesdeg.actuator.status import FINE, Backend
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.reading import read_study
from bayesdeg.console import output, say
from bayesdeg.data.families import MeshDimensions
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.study import Study
from bayesdeg.display import shown
from bayesdeg.errors import BayesdegError
from bayesdeg.files import write_bytes, write_text
from bayesdeg.laboratory.experiment import (
    VIRTUAL_TABLES,
    VirtualExperiment,
    design_of,
    run_experiment,
)
from bayesdeg.laboratory.truth import Truth, drawn_truth, parse_effects
from bayesdeg.laboratory.writing import VIRTUAL_FILES, Provenance, study_files
from bayesdeg.pages.output import virtual_study
from bayesdeg.surrogate.workers import workplace
from bayesdeg.training import refuse_cells


def simulate(
    study: Path,
    out: Path,
    cause: list[str] | None,
    seed: int | None,
    draw_material: bool,
    backend: Backend,
    workers: int,
    quiet: bool,
) -> None:
    """Do what `interface.simulate` says."""
    template = read_study(study)
    _refuse(template)
    refuse_cells(template.settings, backend)
    chosen = template.settings.seed if seed is None else seed
    generator = np.random.default_rng(chosen)
    effects = parse_effects(cause or [])
    truth = _truth(template, generator if draw_material else None)
    named = " ".join(f"--cause {text}" for text in cause or [])
    drawn = " --draw-material" if draw_material else ""
    by = "" if backend is Backend.KERNELS else f" --backend {backend}"
    command = f"bayesdeg simulate {study} {named}{drawn} --out {out} --seed {chosen}{by}"
    geometry = with_dimensions(geometry_of_study(template.settings), truth.dimensions)
    provenance = Provenance(command, chosen, vars(mesh := geometry.mesh_like(FINE)))
    with virtual_study(out, VIRTUAL_FILES), workplace(workers, None) as executor:
        with shown(quiet) as progress:
            forward = ExactMap(
                geometry,
                mesh,
                executor=executor,
                backend=backend,
                on_start=partial(progress.stage, "finite element curves"),
                on_curve=progress.advance,
            )
            read = _as_stated(template, forward)
            experiment = run_experiment(
                design_of(template), truth, forward=read, generator=generator, effects=effects
            )
        made = study_files(_filed(template, experiment), template.settings, provenance=provenance)
        for name, text in made.items():
            if not (name == SETTINGS_FILE and study.resolve() == out.resolve()):
                write_text(out / name, text)
        for name in set(VIRTUAL_FILES) - set(made):  # left by an earlier experiment
            (out / name).unlink(missing_ok=True)
        _copy_mesh(template, out)
    output().print(f"wrote a virtual experiment to {out}", soft_wrap=True)


def _filed(template: Study, made: VirtualExperiment) -> VirtualExperiment:
    """Drop tables that the study lacks, unless it has only published statistics."""
    there = {name: one for name, one in made.tables.items() if template.table(name) is not None}
    return replace(made, tables=there or made.tables)


def _truth(template: Study, generator: np.random.Generator | None) -> Truth:
    """Return the true specimens; with a random source, draw material and dimensions."""
    truth = Truth() if generator is None else drawn_truth(generator)
    sizes = _sizes(template, generator)
    thickness = template.settings.paper.thickness
    truth = replace(truth, paper_thickness=thickness, dimensions=sizes)
    if template.degrades:
        return truth
    return replace(truth, volume_ratio=_volume_ratio(template))


def _sizes(template: Study, generator: np.random.Generator | None) -> dict[str, float]:
    """Return the dimensions given as priors, drawn or at their medians [mm]."""
    return {
        one.name: one.median if generator is None else float(one.prior.sample(generator))
        for one in template.settings.uncertain
    }


def _copy_mesh(template: Study, out: Path) -> None:
    """Copy the mesh of a part next to the settings that name it."""
    mould = template.settings.dimensions
    if isinstance(mould, MeshDimensions) and Path(mould.path) != (out / mould.file).resolve():
        write_bytes(out / mould.file, Path(mould.path).read_bytes())


def _as_stated(template: Study, forward: ExactMap) -> ForwardMap:
    """Return the curvature map for the reading operator of a study."""
    return as_read(forward, template.settings.reading.operator, template.settings.reading.points)


def _volume_ratio(template: Study) -> float:
    """Return the volume ratio of a non-degrading part: its prior median, or 1 without a prior."""
    law = template.settings.priors.get("volume_ratio")
    return 1.0 if law is None else float(law.quantile(0.5))


def _refuse(template: Study) -> None:
    """Refuse a study with its own forward map, and say which files are not simulated.

    Raises
    ------
    BayesdegError
        If it is one, or states unknown priors or candidates.
    """
    say(
        f"{name}.csv: not simulated, the finite element model does not predict it"
        for name in template.others
        if template.settings.forward is None and name not in VIRTUAL_TABLES
    )
    if template.settings.forward is not None:
        raise BayesdegError(
            f"{template.name} has its own forward map, but virtual experiments are of films "
            "and actuators; simulate readings with the function itself"
        )
    outline(template)
