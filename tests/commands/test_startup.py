"""What a command imports: those that compute nothing come without what takes seconds to import."""

import inspect
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import get_type_hints

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import bayesdeg
from bayesdeg.cli import app
from bayesdeg.commands.interface import COMMANDS

STUDIES = Path(__file__).parents[2] / "studies"
# each takes a tenth of a second or more to import
HEAVY = (
    *("numba", "matplotlib", "sklearn", "skfem", "arviz", "arviz_stats", "xarray", "emcee"),
    *(
        "scipy.stats",
        "scipy.optimize",
        "scipy.interpolate",
        "scipy.special",
        "cv2",
        "jinja2",
        "meshio",
    ),
)
FOR_TABLES = ("numpy", "pandas", "pandera", "scipy")
PARSERS = get_command(app).commands

SCRIPT = """
import json, sys
from bayesdeg.cli import exit_code
code = exit_code()
sys.stderr.write("\\n" + json.dumps([code, sorted(sys.modules)]))
"""


def modules_after(*arguments, expected=0):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    code, modules = json.loads(done.stderr.splitlines()[-1])
    assert code == expected, done.stderr
    return set(modules)


def needless(modules):
    """What was imported that takes long, or does the work of a command."""
    # typer itself imports pydantic
    work = {f"bayesdeg.commands.{command.name}" for command in COMMANDS}
    return modules & {*HEAVY, *FOR_TABLES, *work, "bayesdeg.surrogate", "bayesdeg.data.study"}


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_the_list_of_commands_needs_nothing_heavy(option):
    assert not needless(modules_after(option))


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_help_and_the_refusal_of_a_wrong_option_need_nothing_heavy(command):
    assert not needless(modules_after(command.name, "--help"))
    assert not needless(modules_after(command.name, "--no-such-option", expected=2))


WRONG = ("run", "run x --effort most", "simulate x --out y --backend z", "next x --risk 2", "nix")


@pytest.mark.parametrize("words", WRONG)
def test_the_refusal_of_a_wrong_value_needs_nothing_heavy(words):
    assert not needless(modules_after(*words.split(), expected=2))


def test_the_library_is_imported_without_what_its_verbs_need():
    code = (
        "import json, sys\nimport bayesdeg as bd\nbefore = sorted(sys.modules)\n"
        "assert bd.LogNormal(2, 1).median == 2 and issubclass(bd.StudyError, bd.BayesdegError)\n"
        "print(json.dumps([before, sorted(sys.modules)]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    before, after = map(set, json.loads(done.stdout))
    assert not before & {*HEAVY, *FOR_TABLES, "inspect", "typing_extensions", "rich"}
    assert {name for name in before if name.startswith("bayesdeg")} == {"bayesdeg"}
    assert not after & {*HEAVY, "pandas", "bayesdeg.api"}  # laws and errors come without the verbs


def test_checking_a_study_needs_neither_emulator_nor_compiler():
    modules = modules_after("check", STUDIES / "gelatin_actuator")
    assert "bayesdeg.data.study" in modules
    assert not modules & {*HEAVY, "bayesdeg.surrogate.surrogate", "bayesdeg.inference.model"}


def test_the_list_says_of_a_command_what_its_own_help_begins_with():
    shown = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "300"}).stdout
    for command in COMMANDS:
        summary, *_ = inspect.getdoc(command.signature).split("\n\n")
        assert " ".join(summary.split()) in shown


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_the_work_takes_what_the_interface_promises(command):
    promised, taken = (
        inspect.signature(one).parameters for one in (command.signature, command.work)
    )
    assert list(promised) == list(taken)
    assert get_type_hints(command.signature) == get_type_hints(command.work)
    # defaults stand in the interface alone
    assert all(parameter.default is parameter.empty for parameter in taken.values())


def test_the_version_is_printed():
    shown = CliRunner().invoke(app, ["--version"])
    assert shown.exit_code == 0
    assert shown.stdout == f"bayesdeg {bayesdeg.__version__}\n"


def test_help_of_a_command_is_its_own():
    shown = CliRunner().invoke(app, ["emulate", "--help"], env={"COLUMNS": "200"})
    assert shown.exit_code == 0
    assert "--timeout" in re.sub(r"\x1b\[[0-9;]*m", "", shown.stdout)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_the_help_of_a_command_ends_with_an_example(command):
    assert command.examples
    for line in command.examples:
        program, name, *rest = line.split()
        assert (program, name) == ("bayesdeg", command.name)
        # parsed as the command would be, without being called
        PARSERS[name].make_context(name, rest)
        assert line in PARSERS[name].epilog


def test_a_shell_completes_commands_and_their_options():
    def completed(words, place):
        environment = {"_BAYESDEG_COMPLETE": "complete_bash", "COMP_WORDS": words}
        done = subprocess.run(
            [Path(sys.executable).with_name("bayesdeg")],
            env=os.environ | environment | {"COMP_CWORD": str(place)},
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        return done.stdout.split()

    assert completed("bayesdeg si", 1) == ["simulate"]
    assert "--effort" in completed("bayesdeg run --e", 2)
