"""The house rules that no type checker sees."""

import ast
import importlib
import tomllib
from pathlib import Path

import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "bayesdeg"
LONGEST_MODULE, LONGEST_FUNCTION = 300, 45

# from top to bottom; a package imports only from those below it
LAYERS = (
    "cli",
    "pipeline",
    "report",
    "laboratory",
    "prediction",
    "criticism",
    "inference",
    "causes",
    "emulator",
    "actuator",
    "material",
    "measure",
    "laws",
    "distributions",
    "errors",
    "nomenclature",
)

MODULES = sorted(PACKAGE.rglob("*.py"))
each_module = pytest.mark.parametrize(
    "path", MODULES, ids=[str(path.relative_to(PACKAGE)) for path in MODULES]
)


def place(path):
    return path.relative_to(PACKAGE).as_posix()


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


def imported_modules(tree):
    """Names of all modules that are imported, with the line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative import"
            yield node.module, node.lineno


def imports_of(tree, package):
    return [line for name, line in imported_modules(tree) if name.split(".")[0] == package]


def functions_of(tree):
    return [n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]


def length_without_docstring(function):
    end = function.end_lineno or function.lineno
    docstring = function.body[0] if ast.get_docstring(function) is not None else None
    text = 0 if docstring is None else (docstring.end_lineno or 0) - docstring.lineno + 1
    return end - function.lineno + 1 - text


def test_the_layers_are_kept(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    status = lint_imports(config_filename=str(ROOT / "pyproject.toml"), no_cache=True)
    printed = capsys.readouterr().out
    assert status == EXIT_STATUS_SUCCESS, printed
    assert "0 broken" in printed


def test_the_contract_names_every_layer_in_order_and_ignores_no_import():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    linter = settings["tool"]["importlinter"]
    layers = next(c for c in linter["contracts"] if c["type"] == "layers")
    assert layers["layers"] == [f"bayesdeg.{name}" for name in LAYERS]
    assert not layers.get("ignore_imports")
    assert linter["root_package"] == "bayesdeg"


def test_every_package_has_its_layer():
    there = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" and p.stem != "__init__"}
    there |= {p.name for p in PACKAGE.iterdir() if (p / "__init__.py").exists()}
    assert there <= set(LAYERS)


@each_module
def test_modules_import_from_modules_and_not_from_packages(path):
    """``from bayesdeg.x import y`` where x is a package and y no module of it."""
    wrong = []
    for node in ast.walk(tree_of(path)):
        if not isinstance(node, ast.ImportFrom) or not node.module.startswith("bayesdeg."):
            continue
        folder = ROOT / Path(*node.module.split("."))
        if folder.is_dir():
            wrong += [
                f"line {node.lineno}: {alias.name}"
                for alias in node.names
                if not ((folder / f"{alias.name}.py").exists() or (folder / alias.name).is_dir())
            ]
    assert not wrong


@each_module
def test_no_import_inside_a_function(path):
    wrong = [
        node.lineno
        for function in functions_of(tree_of(path))
        for node in ast.walk(function)
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    # the one exception: pypardiso, which is not to be had on every machine
    assert not wrong or place(path) == "actuator/linear.py"


@each_module
def test_matplotlib_is_used_for_figures_alone(path):
    figures = place(path).startswith("report/figures")
    assert figures or not imports_of(tree_of(path), "matplotlib")


@each_module
def test_emcee_is_used_in_one_place(path):
    assert place(path) == "inference/ensemble.py" or not imports_of(tree_of(path), "emcee")


def test_the_rules_of_places_are_not_void():
    assert imports_of(tree_of(PACKAGE / "inference" / "ensemble.py"), "emcee")
    assert any(imports_of(tree_of(p), "matplotlib") for p in PACKAGE.glob("report/figures*.py"))


# measure/study.py and emulator/campaign.py of the rule; the pipeline keeps a run's folder
PATHS_ALLOWED = ("measure/study.py", "emulator/campaign.py", "emulator/build.py", "cli.py")


@each_module
def test_file_paths_stand_where_files_are_read_and_written(path):
    allowed = place(path) in PATHS_ALLOWED or place(path).startswith(("report/", "pipeline/"))
    tree = tree_of(path)
    calls = [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "open"
    ]
    used = calls + [line for name in ("pathlib", "os", "shutil") for line in imports_of(tree, name)]
    assert allowed or not used


@each_module
def test_nothing_is_pickled(path):
    tree = tree_of(path)
    packages = ("pickle", "cPickle", "dill", "joblib", "cloudpickle", "shelve", "marshal")
    assert not [name for name in packages if imports_of(tree, name)]
    for node in ast.walk(tree):
        if isinstance(node, ast.keyword) and node.arg == "allow_pickle":
            assert isinstance(node.value, ast.Constant)
            assert node.value.value is False
        if isinstance(node, ast.Attribute):
            assert node.attr not in ("read_pickle", "to_pickle")


def calls_of(tree, name):
    return [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Attribute)
        and node.func.attr == name
        and isinstance(node.func.value, ast.Name)
        and node.func.value.id in ("np", "numpy")
    ]


@each_module
def test_arrays_are_read_with_pickling_refused_in_so_many_words(path):
    for call in calls_of(tree_of(path), "load"):
        assert "allow_pickle" in [keyword.arg for keyword in call.keywords], call.lineno


LEGACY = {"Generator", "SeedSequence", "default_rng", "MT19937", "RandomState"}


@each_module
def test_randomness_comes_from_a_generator_that_was_passed(path):
    """No function of numpy's global state; ``RandomState`` only where emcee asks for one."""
    for node in ast.walk(tree_of(path)):
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Attribute)
            and node.value.attr == "random"
            and isinstance(node.value.value, ast.Name)
            and node.value.value.id == "np"
        ):
            assert node.attr in LEGACY, f"line {node.lineno}: np.random.{node.attr}"
            if node.attr in ("RandomState", "MT19937"):
                assert place(path) == "inference/ensemble.py"
    assert not imports_of(tree_of(path), "random")


@each_module
def test_modules_are_short(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST_MODULE


@each_module
def test_functions_are_short(path):
    long = {
        function.name: length_without_docstring(function)
        for function in functions_of(tree_of(path))
        if length_without_docstring(function) > LONGEST_FUNCTION
    }
    assert not long


@each_module
def test_every_module_can_be_imported_and_says_what_it_is(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    module = importlib.import_module(".".join(p for p in parts if p != "__init__"))
    assert module.__doc__


def test_names_of_test_files_are_unique():
    names = [p.name for p in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))
