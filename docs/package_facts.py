"""What the running package says of itself, as plain values: all imports of its inner modules.

`generate.py` and `conf.py` import nothing of bayesdeg but through this module, so that a module
that moves is mended here alone.
"""

import hashlib
import importlib
import inspect
import pkgutil
import re
import sys
import textwrap
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache
from pathlib import Path
from typing import get_args, get_origin

import numpy as np
import pandas as pd
from typer.main import get_command

import bayesdeg
import bayesdeg.causes
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reading import read_study
from bayesdeg.cli import app
from bayesdeg.commands.interface import COMMANDS
from bayesdeg.data.settings import KEYS, MODELS, MOULDS, Known, Settings
from bayesdeg.data.tables import words_of
from bayesdeg.laboratory.experiment import Design, run_experiment
from bayesdeg.laboratory.score import score
from bayesdeg.laboratory.truth import HiddenEffect, Truth
from bayesdeg.observations.catalogue import TABLES as STUDY_TABLES
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.pages.tables import TABLES as RUN_TABLES
from bayesdeg.priors import LAWS
from bayesdeg.quantities import QUANTITIES
from bayesdeg.records import Record
from bayesdeg.surrogate.trained import default_surrogate

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))  # scripts, no package

import scored_methods
from hidden_record import read_record
from hidden_summary import summary_of_record
from hidden_tables import markdown

ROOT = Path(__file__).resolve().parents[1]
VERSION = bayesdeg.__version__
LEVELS = {"fresh": 0.0, "degraded by 25 %": 25.0}
HOLD_S = 30.0


@dataclass(frozen=True)
class Entry:
    """A column, key, option or parameter as a row of a table.

    Parameters
    ----------
    name, unit, meaning : str
    place : str
        File, table or group in which it stands.
    default : str
        Empty where there is none.
    required : bool
    accepts : str
        What may be written, in words.
    """

    name: str
    unit: str
    meaning: str
    place: str = ""
    default: str = ""
    required: bool = False
    accepts: str = ""


def public_names() -> tuple[str, ...]:
    """Return the names that ``bayesdeg`` exports, in its own order."""
    return tuple(name for name in getattr(bayesdeg, "__all__", ()) if not name.startswith("_"))


def fingerprint(script: Path) -> str:
    """Return a hash of a script and of all that its output depends on in this repository."""
    package = Path(bayesdeg.__file__).parent
    files = [
        f for f in package.rglob("*") if f.is_file() and f.suffix not in (".pyc", ".nbi", ".nbc")
    ]
    files += [*(ROOT / "studies").rglob("*.csv"), *(ROOT / "studies").rglob("study.toml")]
    files += [ROOT / "reports" / "gelatin_actuator" / "verdict.json"]
    digest = hashlib.sha256()
    for file in (script, *sorted(files)):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def is_class(name: str) -> bool:
    """Return whether a public name is a class."""
    return inspect.isclass(getattr(bayesdeg, name))


def members(name: str) -> str:
    """Return the methods and properties of a public class, separated by commas; no fields."""
    owner = getattr(bayesdeg, name)
    kept = [
        member
        for member in dir(owner)
        if not member.startswith("_")
        and member not in getattr(owner, "__dataclass_fields__", ())
        and (inspect.getdoc(getattr(owner, member)) or "")
        and any(member in vars(base) for base in owner.__mro__ if base.__module__ != "builtins")
        and not any(hasattr(base, member) for base in (Exception, int, str))
    ]
    return ", ".join(kept)


def is_callable(name: str) -> bool:
    """Return whether a public name is a function or class."""
    return callable(getattr(bayesdeg, name))


def columns_of_studies() -> dict[str, list[Entry]]:
    """Return the columns of every file of a study by the file's name."""
    tables = STUDY_TABLES.values()
    return {table.file: [_column(c) for c in table.columns.values()] for table in tables}


def _column(column) -> Entry:
    known = QUANTITIES[column.name]
    words = [f"`{word}`" for word in words_of(column)]
    kinds = {"str": "a name", "int64": "a whole number", "float64": "a number"}
    accepts = f"one of {', '.join(words)}" if words else kinds[str(column.dtype.type)]
    if column.checks and not words:
        accepts += f"; refused if it {' or '.join(check.error for check in column.checks)}"
    if column.required and column.nullable:
        accepts += "; a cell may be empty"
    default = "" if column.default is None or column.required else str(column.default)
    return Entry(column.name, known.unit, known.meaning, "", default, column.required, accepts)


def rules_of_studies() -> dict[str, list[str]]:
    """Return what the rows of a file must fulfil together, as what is said when they do not."""
    return {
        table.file: [f"{check.error}: {check.description}" for check in table.schema.checks]
        for table in STUDY_TABLES.values()
    }


def keys_of_study_toml() -> list[Entry]:
    """Return every key of ``study.toml`` with its default, from the classes that hold them."""
    rows = []
    for table, keys in KEYS.items():
        if table == "actuator":
            family = "Family of the actuator, which has the dimensions."
            rows.append(Entry("kind", "", family, table, '"pneunet"', accepts=keys["kind"]))
            rows += [row for kind, mould in MOULDS.items() for row in _dimensions(kind, mould)]
            continue
        model = MODELS.get(table, Settings)
        meanings = _documented(model)
        stored = {one.metadata.get("key", one.name): one for one in fields(model)}
        for key, accepts in keys.items():
            meaning, default = meanings[stored[key].name], _default(stored[key])
            if key == "candidates":
                default = '"all"'
            rows.append(Entry(key, "", meaning, table, default, accepts=accepts))
    return rows


def _dimensions(kind: str, mould) -> list[Entry]:
    """Return the dimensions of one family, in a table of their own."""
    meanings, place = _documented(mould), f"actuator.{kind}"
    return [
        Entry(
            f.name,
            "",
            meanings[f.name],
            place,
            _default(f),
            accepts=KEYS["actuator"][f.name],
        )
        for f in fields(mould)
        if not f.metadata
    ]


def _default(key) -> str:
    """Return the default of a key as TOML writes it; empty if it has none."""
    return "" if key.default in (None, MISSING, ()) else _written(key.default)


def _written(value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, Known):
        return str(value.value)
    if isinstance(value, tuple):
        return f"[{', '.join(_written(one) for one in value)}]"
    return str(value)


def _documented(owner) -> dict[str, str]:
    """Return what the numpydoc section Parameters of a class says of each of its fields."""
    section = re.search(
        r"Parameters\n-+\n(.*?)(\n\n\S|\Z)", inspect.cleandoc(owner.__doc__ or ""), re.DOTALL
    )
    found: dict[str, str] = {}
    for names, text in re.findall(
        r"^(\w[\w, ]*?)(?: : [^\n]*)?\n((?:    [^\n]*\n?)+)", section[1] + "\n", re.MULTILINE
    ):
        for name in names.split(","):
            found[name.strip()] = " ".join(text.split())
    return found


def laws_of_priors() -> list[Entry]:
    """Return the prior laws that study.toml may name, with their arguments."""
    return [
        Entry(
            name,
            "",
            (inspect.getdoc(law) or "").split("\n")[0].split("\\n")[0],
            accepts=", ".join(
                f.name if f.default is MISSING else f"{f.name} = {f.default:g}" for f in fields(law)
            ),
        )
        for name, law in LAWS.items()
    ]


def parameters_of_the_base_model() -> list[Entry]:
    """Return the parameters of the base model of the gelatin study with their priors."""
    assembly = assemble(read_study(ROOT / "studies" / "gelatin_actuator"), emulator())
    return [
        Entry(p.name, p.unit, p.meaning, default=str(p.law))
        for p in assembly.model.table.parameters
    ]


def columns_of_runs() -> dict[str, list[Entry]]:
    """Return the columns of every table of a run folder by the file's name."""
    return {
        f"{name}.csv": [Entry(c.name, c.unit, c.meaning) for c in table.columns]
        for name, table in RUN_TABLES.items()
    }


def keys_of_verdicts() -> dict[str, str]:
    """Return every key of ``verdict.json`` with its meaning, from the records that write it."""
    return dict(_keys_of(VerdictRecord))


def _keys_of(record, place: str = ""):
    """Yield the keys of a record; `[]` is each entry of a list, `*` any name."""
    for name, field in record.model_fields.items():
        if field.exclude:
            continue
        key = f"{place}{field.serialization_alias or name}"
        if field.description:
            yield key, field.description
        parts = get_args(field.annotation) or (field.annotation,)
        for inner in parts:
            if inspect.isclass(inner) and issubclass(inner, Record):
                many = {tuple: "[]", Mapping: ".*"}.get(get_origin(field.annotation), "")
                yield from _keys_of(inner, f"{key}{many}.")


def tables_of_hidden_effects(record: Path) -> str:
    """Return what recorded verdicts on hidden effects come to, as tables in Markdown."""
    studies = sorted(read_record(record).values(), key=lambda one: one["number"])
    return markdown(summary_of_record(studies))


def tables_of_scored_methods(folder: Path) -> str:
    """Return the scores of the methods of a recorded benchmark, as tables in Markdown."""
    truths, answers = scored_methods.recorded(folder)
    scores = {method: score(given, truths, method) for method, given in answers.items()}
    return scored_methods.markdown(scores)


@dataclass(frozen=True)
class CommandHelp:
    """A command of the command line as its ``--help`` shows it."""

    name: str
    usage: str
    text: str
    example: str
    options: tuple[Entry, ...]


def commands() -> list[CommandHelp]:
    """Return every command with its arguments and options."""
    parsers = get_command(app).commands
    return [_command(entry.name, parsers[entry.name]) for entry in COMMANDS]


def _command(name, command) -> CommandHelp:
    context = command.make_context(name, [], resilient_parsing=True)
    usage = re.sub(r"[{}]", "", " ".join(command.collect_usage_pieces(context)))
    options = tuple(_option(p, context) for p in command.params if not getattr(p, "hidden", False))
    return CommandHelp(name, usage, command.help or "", command.epilog or "", options)


def _option(option, context) -> Entry:
    record = option.get_help_record(context)
    name = record[0] if record else (option.metavar or option.name)
    default = option.default
    if option.name == "workers":
        default = "cores, at most 4"
    shown = "" if default in (None, False) or callable(default) else str(default)
    text = re.sub(r"\s*\[(default|required|\d+<=|x>=).*?\]$", "", record[1] if record else "")
    return Entry(name, "", text, default=shown, required=option.required)


@dataclass(frozen=True)
class CausePage:
    """A cause as its file states it.

    Parameters
    ----------
    cause : Cause
    title : str
        First line of the file.
    sections : dict of str to str
        Of its docstring, in order: Mechanism, Equation, …
    """

    cause: object
    title: str
    sections: dict[str, str]


def causes() -> list[CausePage]:
    """Return every cause of the catalogue, in order of names, from the files that define them."""
    found = []
    for entry in pkgutil.iter_modules(bayesdeg.causes.__path__):
        module = importlib.import_module(f"{bayesdeg.causes.__name__}.{entry.name}")
        if hasattr(module, "CAUSE"):
            title, *_ = inspect.cleandoc(module.__doc__).split("\n")
            found.append(CausePage(module.CAUSE, title, _sections(module.__doc__)))
    return sorted(found, key=lambda page: page.cause.name)


def _sections(docstring: str) -> dict[str, str]:
    parts = re.findall(
        r"^(\w[\w ]*)\n((?:    [^\n]*\n|\n)+)", inspect.cleandoc(docstring) + "\n", re.MULTILINE
    )
    return {name: textwrap.dedent(text).strip() for name, text in parts}


@cache
def emulator():
    """Return the shipped emulator."""
    return default_surrogate()


class NoChance(np.random.Generator):
    """A source of randomness from which every normal number is 0."""

    def standard_normal(self, size=None, *arguments, **options):
        """Return zeros."""
        return np.zeros(size) if size is not None else 0.0


@cache
def signature(name: str) -> dict[str, pd.DataFrame]:
    """Return the tables of a virtual experiment with a cause at typical size, beside one without.

    There is neither scatter nor noise: all that differs is the cause. Actuators are inflated to
    200 kPa and let down again, with 30 s at each pressure, in a horizontal mount; where the cause
    cannot show in that, bent against gravity, at 29 °C, or of another batch than most films.

    Parameters
    ----------
    name : str
        Of the cause.

    Returns
    -------
    dict of str to DataFrame
        ``actuator`` and ``tensile`` with the columns of the files and ``change`` [1/m, MPa];
        ``strength`` with ``limit_stretch`` and ``before``.
    """
    (cause,) = (page.cause for page in causes() if page.cause.name == name)
    with_it = _experiment(_design(cause.needs), (HiddenEffect(cause, dict(cause.typical)),))
    without = _experiment(_design(cause.needs), ())
    pair = {
        table: (with_it.tables[table], without.tables[table]) for table in ("actuator", "tensile")
    }
    limits = with_it.actuators.assign(before=without.actuators["limit_stretch"])
    return {
        "actuator": _changed(*pair["actuator"], "curvature_per_m"),
        "tensile": _changed(*pair["tensile"], "stress_MPa"),
        "strength": limits,
    }


def _changed(with_it: pd.DataFrame, without: pd.DataFrame, column: str) -> pd.DataFrame:
    keys = ["specimen_id", "row"]
    numbered = [
        t.assign(row=t.groupby("specimen_id").cumcount()).set_index(keys)
        for t in (with_it, without)
    ]
    joined = numbered[1].join(numbered[0][column].rename("changed"), how="left")
    return joined.assign(change=joined["changed"] - joined[column]).reset_index()


def _experiment(design: Design, effects):
    truth = Truth(elongation_scatter=0.0)
    chance = NoChance(np.random.PCG64(0))
    return run_experiment(design, truth, forward=emulator(), generator=chance, effects=effects)


def _design(needs) -> Design:
    up = np.arange(10.0, 201.0, 10.0)
    path = np.concatenate([up, up[-2::-1]])
    rows = pd.DataFrame(
        {
            "pressure_kPa": path,
            "branch": ["loading"] * len(up) + ["unloading"] * (len(up) - 1),
            "time_s": HOLD_S * np.arange(len(path)),
            "mount": "bending_up" if "mount" in needs else "horizontal",
        }
    )
    between = {f"{level:g} %": level for level in np.arange(2.5, 25.0, 2.5)}
    levels = LEVELS | between
    specimens = pd.DataFrame(
        {
            "specimen_id": list(levels),
            "degradation_pct": list(levels.values()),
            "degradation_sd_pct": 0.0,
        }
    )
    if "batch" in needs:
        specimens["batch"] = ["B" if name in LEVELS else "A" for name in levels]
    if "temperature_C" in needs:
        specimens["temperature_C"] = 29.0
    share = pd.DataFrame({"elongation_share": np.linspace(0.02, 0.95, 40)})
    films = specimens.merge(share, how="cross")
    films = films.assign(mode="uniaxial", stress_measure="nominal")
    return Design(actuator=specimens.merge(rows, how="cross"), tensile=films, breaks=specimens)
