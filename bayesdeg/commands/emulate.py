"""``bayesdeg emulate``: an emulator for a geometry."""

import tomllib
from dataclasses import replace
from pathlib import Path

import typer

from bayesdeg import training
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.status import Backend
from bayesdeg.console import output
from bayesdeg.data.settings import FILE, Settings, parse_settings
from bayesdeg.errors import BayesdegError, Fault, StudyError
from bayesdeg.files import STUDY_MB, read_bytes, reason
from bayesdeg.pages.output import output_file
from bayesdeg.surrogate.campaign import Campaign
from bayesdeg.surrogate.kept import CACHE, cached_path, refuse_whole_range
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.workers import workplace


def emulate(
    geometry: Path | None,
    out: Path | None,
    store: Path,
    workers: int,
    scheduler: str | None,
    timeout: float,
    backend: Backend,
    yes: bool,
    quiet: bool,
) -> None:
    """Do what `interface.emulate` says."""
    if not timeout > 0.0:
        raise typer.BadParameter(f"--timeout {timeout:g} s is out of range; give more than 0")
    settings = _settings(geometry)
    for one in settings.uncertain[:1]:
        raise BayesdegError(
            f"{one.name} is a prior, but an emulator of the whole range needs known dimensions; "
            "'bayesdeg run STUDY' trains one for the study"
        )
    actuator = geometry_of_study(settings)
    refuse_whole_range(actuator)
    options = training.TrainingOptions(yes=yes, quiet=quiet, backend=backend)
    path = cached_path(actuator, options.recipe, CACHE) if out is None else output_file(out)
    with workplace(workers, scheduler) as executor:
        campaign = Campaign(actuator, options.recipe, SolutionStore(store), executor, timeout)
        training.train(campaign, path, options)
    output().print(f"wrote {path}", soft_wrap=True)


def _settings(path: Path | None) -> Settings:
    """Read the settings of an actuator from a study folder or a TOML file."""
    if path is None:
        return Settings()
    file = path / FILE if path.is_dir() else path
    try:
        content = read_bytes(file, most_mb=STUDY_MB)
    except OSError as fault:
        remedy = f"name a study folder that holds {FILE}, or a TOML file with an [actuator] table"
        raise StudyError([Fault(str(file), f"cannot be read ({reason(fault)})", remedy)]) from fault
    settings, faults = parse_settings(content)
    if faults:
        raise StudyError([replace(fault, file=str(file)) for fault in faults])
    if not path.is_dir() and "actuator" not in tomllib.loads(content.decode("utf-8-sig")):
        remedy = "add [actuator] and, below it, the dimensions that differ, such as length = 60.0"
        raise StudyError([Fault(str(file), "has no [actuator] table", remedy)])
    return settings
