"""A virtual experiment → the texts of its files."""

import json
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace

import bayesdeg
from bayesdeg.actuator.status import MODEL_VERSION
from bayesdeg.data.settings import ENTRIES, Dimensions, Settings
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.tables import TABLES
from bayesdeg.files import spreadsheet_safe
from bayesdeg.laboratory.experiment import VirtualExperiment
from bayesdeg.priors import LAWS, Law

TRUTH_FILE = "truth.json"
#: What a virtual experiment writes; published statistics are not virtual.
VIRTUAL_FILES = (
    *(SETTINGS_FILE, TRUTH_FILE),
    *(table.file for name, table in TABLES.items() if name != "summary"),
)
#: Of every file of it but `TRUTH_FILE`.
FIRST_WORDS = "# virtual experiment made by"
NOTE = (
    "This is a virtual experiment: all specimens were simulated by the fine finite element model, "
    "with scatter of specimens and errors of reading. Whether an effect is hidden in it, and "
    f"which, stands in {TRUTH_FILE}, which the calibration never opens."
)


@dataclass(frozen=True)
class Provenance:
    """How a virtual experiment was made.

    Parameters
    ----------
    command : str
        The exact command.
    seed : int
        Seed of all randomness.
    mesh : mapping of str to float
        Sizes of the elements of the fine model [mm], or whatever describes the forward map.
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
    """Return the texts of a study folder that holds a virtual experiment.

    Parameters
    ----------
    experiment : VirtualExperiment
        What was recorded and what was true.
    settings : Settings
        Those of the study whose design was used.
    provenance : Provenance
        How it was made.

    Returns
    -------
    dict of str to str
        By name of the file: ``study.toml``, the CSV files, and ``truth.json``, which no study
        reads.
    """
    texts = {
        TABLES[name].file: provenance.comment
        + table.map(spreadsheet_safe).to_csv(index=False, lineterminator="\n")
        for name, table in experiment.tables.items()
    }
    virtual = virtual_settings(settings, seed=provenance.seed)
    record = json.dumps(truth_record(experiment, provenance), indent=2, ensure_ascii=False)
    return {
        SETTINGS_FILE: provenance.comment + settings_text(virtual),
        **texts,
        TRUTH_FILE: record + "\n",
    }


def truth_record(experiment: VirtualExperiment, provenance: Provenance) -> dict[str, object]:
    """Return what ``truth.json`` holds.

    Returns
    -------
    dict
        ``constants`` by the names of calibrated parameters, ``causes`` with the values of their
        parameters by short name, ``actuators`` and ``films`` by specimen, and how it was made.
    """
    return {
        "causes": {hidden.cause.name: dict(hidden.values) for hidden in experiment.effects},
        "constants": experiment.truth.named(),
        "actuators": experiment.actuators.to_dict("index"),
        "films": experiment.films.to_dict("index"),
        "seed": provenance.seed,
        "command": provenance.command,
        "mesh": dict(provenance.mesh),
        "version": {"bayesdeg": bayesdeg.__version__, "model": MODEL_VERSION},
    }


def virtual_settings(settings: Settings, *, seed: int) -> Settings:
    """Return settings that say that the data are virtual; virtual ones keep title and note.

    Examples
    --------
    >>> virtual_settings(Settings(title="Gelatin"), seed=7).title
    'Virtual experiment: Gelatin'
    """
    if settings.virtual:
        return replace(settings, seed=seed)
    title = f"Virtual experiment: {settings.title}" if settings.title else "Virtual experiment"
    return replace(settings, virtual=True, seed=seed, title=title, note=NOTE)


def settings_text(settings: Settings) -> str:
    """Return the text of a ``study.toml`` from which the same settings are read.

    Keys that hold their default are left out, but for the seed.

    Examples
    --------
    >>> print(settings_text(Settings(seed=7, effort="quick")))
    seed = 7
    <BLANKLINE>
    [sampling]
    effort = "quick"
    <BLANKLINE>
    """
    written: dict[str, list[str]] = {"": []}
    for entry in ENTRIES:
        holder: Settings | Dimensions = settings
        default: Settings | Dimensions = Settings()
        if not hasattr(holder, entry.field):
            holder, default = settings.dimensions, Dimensions()
        value = getattr(holder, entry.field)
        if entry.key == "seed" or value != getattr(default, entry.field):
            written.setdefault(entry.table, []).append(f"{entry.key} = {_literal(value)}")
    if settings.priors:
        priors = settings.priors.items()
        written["priors"] = [f"{_quoted(name)} = {_law_text(law)}" for name, law in priors]
    parts = (
        "".join(f"{line}\n" for line in ([f"[{table}]"] if table else []) + lines)
        for table, lines in written.items()
    )
    return "\n".join(parts)


def _law_text(law: Law) -> str:
    [name] = [name for name, kind in LAWS.items() if type(law) is kind]
    pairs = [f'law = "{name}"']
    for entry in fields(LAWS[name]):
        value = getattr(law, entry.name)
        if entry.default is MISSING or value != entry.default:
            pairs.append(f"{entry.name} = {_literal(value)}")
    return f"{{ {', '.join(pairs)} }}"


def _literal(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(_literal(entry) for entry in value)}]"
    return _quoted(value) if isinstance(value, str) else repr(value)


def _quoted(text: str) -> str:
    # JSON writes strings as TOML does, but for one control character
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
