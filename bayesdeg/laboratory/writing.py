"""Write a virtual experiment as the text of its files."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import pandas as pd
import tomli_w
from pydantic import Field

import bayesdeg
from bayesdeg.actuator.status import MODEL_VERSION
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import KEYS, MODELS, Known, Settings, VendorFigures
from bayesdeg.files import spreadsheet_safe
from bayesdeg.laboratory.experiment import VIRTUAL_TABLES, VirtualExperiment
from bayesdeg.priors import LAWS, Distribution
from bayesdeg.records import FileRecord, Numbers, Record, Scalar, Text

TRUTH_FILE = "truth.json"
#: Files of a virtual experiment.
VIRTUAL_FILES = (
    *(SETTINGS_FILE, TRUTH_FILE),
    *(table.file for table in VIRTUAL_TABLES.values()),
)
#: Tables of study.toml that describe other data, or a user's own forward map.
NOT_SIMULATED = {"forward", "photographs", "markers", "captures"}
#: First words of every file except `TRUTH_FILE`.
FIRST_WORDS = "# virtual experiment made by"
NOTE = (
    "This is a virtual experiment: all specimens were simulated by the fine finite element model, "
    "with specimen scatter and reading errors. Hidden effects, if any, are recorded in "
    f"{TRUTH_FILE}, which the calibration never opens."
)


@dataclass(frozen=True)
class Provenance:
    """Provenance of a virtual experiment.

    Parameters
    ----------
    command : str
        The exact command.
    seed : int
        Seed of all randomness.
    mesh : mapping of str to float
        Element sizes of the fine model [mm], or any description of the forward map.
    """

    command: str
    seed: int
    mesh: Mapping[str, float]

    @property
    def comment(self) -> str:
        """The first line of every file."""
        command = " ".join(self.command.split())
        return f"{FIRST_WORDS} {command} (seed {self.seed})\n"


def study_files(
    experiment: VirtualExperiment, settings: Settings, *, provenance: Provenance
) -> dict[str, str]:
    """Return the files of a study folder with a virtual experiment, by name.

    These are ``study.toml``, from the settings of the study whose design was used, the CSV files,
    and ``truth.json``, which no study reads.
    """
    texts = {
        VIRTUAL_TABLES[name].file: provenance.comment
        + table.map(spreadsheet_safe).to_csv(index=False, lineterminator="\n")
        for name, table in experiment.tables.items()
    }
    virtual = virtual_settings(settings, seed=provenance.seed)
    return {
        SETTINGS_FILE: provenance.comment + settings_text(virtual),
        **texts,
        TRUTH_FILE: truth_record(experiment, provenance).text(),
    }


class TruthVersion(Record):
    """Versions of the programs that made a virtual experiment."""

    bayesdeg: Text
    model: Text = Field(default="", description="version of the finite element model")


class TruthRecord(FileRecord):
    """The content of ``truth.json``: the hidden truth of an experiment, which no study reads."""

    causes: Mapping[str, Numbers] = Field(description="parameter values by hidden cause")
    constants: Numbers = Field(description="true values by calibrated parameter")
    actuators: Mapping[str, Mapping[str, Scalar]] = Field(description="true actuators by specimen")
    films: Mapping[str, Mapping[str, Scalar]] = Field(description="true films by specimen")
    blocked: Mapping[str, Mapping[str, Scalar]] = Field(
        default_factory=dict, description="actuators with held tips, by specimen"
    )
    seed: int
    command: Text
    mesh: Numbers = Field(description="element sizes [mm]")
    version: TruthVersion


def truth_record(experiment: VirtualExperiment, provenance: Provenance) -> TruthRecord:
    """Return the content of ``truth.json``."""
    return TruthRecord(
        causes={hidden.cause.name: dict(hidden.values) for hidden in experiment.effects},
        constants=experiment.truth.named(),
        actuators=_by_specimen(experiment.actuators),
        films=_by_specimen(experiment.films),
        blocked={} if experiment.blocked is None else _by_specimen(experiment.blocked),
        seed=provenance.seed,
        command=provenance.command,
        mesh=dict(provenance.mesh),
        version=TruthVersion(bayesdeg=bayesdeg.__version__, model=str(MODEL_VERSION)),
    )


def _by_specimen(frame: pd.DataFrame) -> dict[str, dict[str, float | str | None]]:
    rows = frame.to_dict("index").items()
    return {str(name): {str(key): cell for key, cell in row.items()} for name, row in rows}


def virtual_settings(settings: Settings, *, seed: int) -> Settings:
    """Return settings marked as virtual; already virtual ones keep title and note.

    Vendor figures are dropped: they describe a different material than the simulated one.

    Examples
    --------
    >>> virtual_settings(Settings(title="Gelatin"), seed=7).title
    'Virtual experiment: Gelatin'
    """
    settings = replace(settings, vendor=VendorFigures())
    if settings.virtual:
        return replace(settings, seed=seed)
    title = f"Virtual experiment: {settings.title}" if settings.title else "Virtual experiment"
    return replace(settings, virtual=True, seed=seed, title=title, note=NOTE)


def settings_text(settings: Settings) -> str:
    """Return the text of a ``study.toml`` that gives the same settings.

    Keys at their default are omitted, except the seed.

    Examples
    --------
    >>> from bayesdeg.data.settings import Paper
    >>> print(settings_text(Settings(seed=7, paper=Paper(0.2))))
    seed = 7
    <BLANKLINE>
    [paper]
    thickness = 0.2
    <BLANKLINE>
    """
    laws = {one.name: _plain_law(one.law) for one in settings.uncertain}
    mould = settings.dimensions
    family: dict[str, object] = (
        {"kind": mould.kind} if mould.kind != Settings().dimensions.kind else {}
    )
    sizes = family | _stated(mould, KEYS["actuator"]) | laws
    tables: dict[str, Mapping[str, object]] = {
        "actuator": {key: sizes[key] for key in KEYS["actuator"] if key in sizes}
    }
    for table in KEYS:
        if table in MODELS and table not in NOT_SIMULATED:
            tables[table] = _stated(getattr(settings, table), KEYS[table])
    tables["priors"] = {name: _plain_law(law) for name, law in settings.priors.items()}
    written = _stated(settings, KEYS[""]) | {"seed": settings.seed}
    return tomli_w.dumps(written | {name: table for name, table in tables.items() if table})


def _stated(record: Any, keys: Iterable[str]) -> dict[str, object]:
    """Return the values of keys that differ from their default; values read from a mesh do not."""
    stored = {entry.name for entry in fields(record) if "is_read" not in entry.metadata}
    usual = type(record)()
    return {
        key: _plain(getattr(record, key))
        for key in keys
        if key in stored and getattr(record, key) != getattr(usual, key)
    }


def _plain_law(law: Distribution) -> dict[str, object]:
    [name] = [name for name, kind in LAWS.items() if type(law) is kind]
    return {"law": name} | _changed(law)


def _plain(value: object) -> object:
    if isinstance(value, Known):
        return _changed(value) if value.sd > 0.0 else value.value
    return list(value) if isinstance(value, tuple) else value


def _changed(record: Any) -> dict[str, object]:
    """Return the fields of a record that differ from their default."""
    values = {entry.name: (getattr(record, entry.name), entry.default) for entry in fields(record)}
    return {name: value for name, (value, default) in values.items() if value != default}
