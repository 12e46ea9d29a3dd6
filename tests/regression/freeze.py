"""Write the numbers of the engine that `test_frozen_numbers` holds it to.

    uv run python tests/regression/freeze.py [--verdicts] [NAME ...]

writes those of all studies, or of those named, into ``frozen.npz``, and with ``--verdicts`` what is
concluded of them into ``verdicts.json`` beside it; what is not named stays as it was. Parameter
vectors that are there already are kept, so that a number that moved can be told from a vector that
was drawn anew; ``--redraw`` draws them anew. Numbers are written again only where they were
wrong, and the reason belongs into the message of that commit.
"""

import argparse
import json
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# as in tests: many small matrices, for which threads cost more than they give
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))  # the adapter is among the tests

import numpy as np
from numpy.typing import NDArray

from tests.regression import engine
from tests.regression.engine import Adapter, Block

Floats = NDArray[np.float64]

ARRAYS = Path(__file__).parent / "frozen.npz"
VERDICTS = Path(__file__).parent / "verdicts.json"
SEED = 19
ABOUT_MODE, FAR, FROM_PRIOR, ANYWHERE = 10, 4, 6, 4  # vectors of the base model
SIZES = (1.0, 0.5, 0.75)  # of a cause, in typical ones
TOGETHER = 0.3  # of a typical size, where all causes act at once
# causes that no other study can show; the others are frozen elsewhere
ONLY = {"planted 11": ("gravity", "mullins"), "planted 19": ("flaw_embrittlement", "erosion")}
CHOICES = {"stress_measure.confusion"}  # of two states, which have no size
READINGS = ("readings_pointwise", "expected", "simulated", "replicated")


@dataclass(frozen=True)
class Rows:
    """Vectors of one model: that of a study with some of its causes.

    Parameters
    ----------
    causes : tuple of str
    names : tuple of str
        Of the parameters.
    vectors : array, shape (n, n_parameters)
    with_readings : bool
        Whether numbers of every reading are frozen, at the first vector.
    """

    causes: tuple[str, ...]
    names: tuple[str, ...]
    vectors: Floats
    with_readings: bool


def numbers(model: Adapter, rows: Rows) -> dict[str, Block]:
    """Return all that is frozen of a model by name, in whichever order it has its parameters."""
    vectors = rows.vectors[:, [rows.names.index(name) for name in model.names]]
    found = {
        "log_prob": engine.labelled([("", "", "")], model.log_prob(vectors)[:, None]),
        "log_likelihood": model.blocks(vectors),
    }
    if rows.with_readings:
        readings = (
            model.pointwise(vectors[:1]),
            model.expected(vectors[:1]),
            model.simulated(vectors[:1], SEED),
            model.replicated(vectors[0], SEED),
        )
        found |= {what: b for what, b in zip(READINGS, readings, strict=True) if b is not None}
    return found


# ---- which vectors


def drawn(base: Adapter, name: str) -> list[Rows]:
    """Draw the vectors of a study: of its base model, with each cause, and with all together."""
    generator = np.random.default_rng(list(name.encode()))
    vectors = base_vectors(base, generator)
    causes = tuple(c for c in base.candidates if c in ONLY.get(name, base.candidates))
    together = [causes] if len(causes) > 1 else []
    found = [Rows((), base.names, vectors, with_readings=True)]
    for some in [*((cause,) for cause in causes), *together]:
        model, is_last = base.extended(some), len(some) > 1
        extended = extended_vectors(model, base, vectors, some)
        found.append(Rows(some, model.names, extended, with_readings=is_last))
    return found


def base_vectors(model: Adapter, generator: np.random.Generator) -> Floats:
    """Return vectors about the mode, the near ones first, then draws from the prior."""
    mode, covariance = model.mode(generator)
    root = np.linalg.cholesky(covariance)
    z = generator.standard_normal((200, len(mode)))
    near, far = (_possible(model, mode + scale * z @ root.T) for scale in (1.0, 3.0))
    prior = model.prior(generator, 1000)
    # the beam is linear in its nuisances about the first vector
    inside = _possible(model, np.vstack([near[:1], prior]))[1:]
    return np.vstack([near[:ABOUT_MODE], far[-FAR:], inside[:FROM_PRIOR], prior[-ANYWHERE:]])


def _possible(model: Adapter, vectors: Floats) -> Floats:
    return vectors[np.isfinite(model.log_prob(vectors))]


def extended_vectors(
    model: Adapter, base: Adapter, vectors: Floats, causes: tuple[str, ...]
) -> Floats:
    """Return the nearest vectors with causes at sizes about the typical ones."""
    sizes = SIZES if len(causes) == 1 else (TOGETHER,) * len(SIZES)
    typical = {name: value for cause in causes for name, value in base.typical(cause).items()}
    rows = []
    for vector, size in zip(vectors, sizes, strict=False):
        known = dict(zip(base.names, vector, strict=True))
        sized = {name: v if name in CHOICES else size * v for name, v in typical.items()}
        known |= {name: model.column(name, value) for name, value in sized.items()}
        rows.append([known[name] for name in model.names])
    return np.array(rows)


# ---- as arrays: rows of all models of a study below one another


def stored() -> dict[str, dict[str, NDArray[Any]]]:
    """Return the stored arrays by study and name."""
    found: dict[str, dict[str, NDArray[Any]]] = {}
    with np.load(ARRAYS, allow_pickle=False) as file:
        for key in file.files:
            study, name = key.split("/", maxsplit=1)
            found.setdefault(study, {})[name] = file[key]
    return found


def rows_of(arrays: dict[str, NDArray[Any]]) -> list[Rows]:
    """Return the stored vectors, model by model."""
    found = []
    for number in range(int(arrays["model"].max()) + 1):
        vectors = arrays["vectors"][arrays["model"] == number]
        own = ~np.isnan(vectors[0])
        found.append(
            Rows(
                tuple(arrays["causes"][arrays["acts"][number]].tolist()),
                tuple(arrays["names"][own].tolist()),
                vectors[:, own],
                with_readings=bool(arrays["with_readings"][number]),
            )
        )
    return found


def frozen(base: Adapter, rows: list[Rows]) -> dict[str, NDArray[Any]]:
    """Return the arrays of a study: vectors, and what the engine makes of them."""
    names = tuple(dict.fromkeys(name for one in rows for name in one.names))
    causes = tuple(dict.fromkeys(cause for one in rows for cause in one.causes))
    vectors = [np.full((len(one.vectors), len(names)), np.nan) for one in rows]
    for table, one in zip(vectors, rows, strict=True):
        table[:, [names.index(name) for name in one.names]] = one.vectors
    arrays: dict[str, NDArray[Any]] = {
        "names": np.array(names),
        "causes": np.array(causes, dtype=np.str_),
        "acts": np.array([[c in one.causes for c in causes] for one in rows], dtype=np.bool_),
        "with_readings": np.array([one.with_readings for one in rows]),
        "model": np.repeat(np.arange(len(rows)), [len(one.vectors) for one in rows]),
        "vectors": np.concatenate(vectors),
    }
    found = [numbers(base.extended(one.causes), one) for one in rows]
    for what in ("log_prob", "log_likelihood", *READINGS):
        blocks = [one[what] for one in found if what in one]
        if blocks:
            assert all(block.labels == blocks[0].labels for block in blocks)
            arrays[what] = np.concatenate([block.values for block in blocks])
            arrays[f"{what} of"] = np.array(blocks[0].labels)
    return arrays


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("names", nargs="*", help="studies; all by default")
    parser.add_argument("--verdicts", action="store_true", help="what is concluded too")
    parser.add_argument("--redraw", action="store_true", help="draw parameter vectors anew")
    given = parser.parse_args()
    if unknown := set(given.names) - {*engine.LOADERS, *engine.VERDICTS}:
        parser.error(f"no study of the name {', '.join(sorted(unknown))}")
    known = stored() if ARRAYS.exists() else {}
    for name in (n for n in engine.LOADERS if n in given.names or not given.names):
        base = engine.load(name)
        is_new = given.redraw or name not in known
        known[name] = frozen(base, drawn(base, name) if is_new else rows_of(known[name]))
        possible = int(np.isfinite(known[name]["log_prob"]).sum())
        print(f"{name}: {len(known[name]['vectors'])} vectors, {possible} possible", flush=True)
    flat = {f"{study}/{name}": a for study in sorted(known) for name, a in known[study].items()}
    np.savez_compressed(ARRAYS, **flat)
    if given.verdicts:
        told = json.loads(VERDICTS.read_text(encoding="utf-8")) if VERDICTS.exists() else {}
        told |= {
            n: engine.verdict(n) for n in engine.VERDICTS if n in given.names or not given.names
        }
        text = json.dumps(dict(sorted(told.items())), indent=1, ensure_ascii=False)
        VERDICTS.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
