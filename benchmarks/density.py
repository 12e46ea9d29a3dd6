"""Joint log densities per second of a model, now and before a change.

Of the base model of a study with all its data, in batches of draws about its mode, in seconds of
the processor. Two checkouts, each with its own environment (``uv sync``), are measured in turns,
so that what else the machine does falls on both. The keys of the document:

logprob_per_second   by size of the batch: median of the rounds, of this checkout
before               the same of the other checkout, if one is given
ratio                median over the rounds of the one over the other
largest_difference   between the densities of both checkouts, over their size

    uv run python benchmarks/density.py --json --against ../before
"""

import os

# before the libraries read them
os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.inference.laplace import approximate
from bayesdeg.inference.model import JointModel, near_films

Floats = NDArray[np.float64]

STUDY = Path("studies/gelatin_actuator")
BATCHES = (1, 16, 64, 256, 1000)
ROUNDS = 7
SECONDS = 0.5  # of each measurement


def draws(model: JointModel, count: int) -> Floats:
    """Return draws of the normal law at the mode that are possible."""
    generator = np.random.default_rng(0)
    laplace = approximate(model, generator, start=near_films(model, generator))
    root = np.linalg.cholesky(laplace.covariance)
    vectors = laplace.mode + generator.standard_normal((2 * count, len(laplace.mode))) @ root.T
    return vectors[np.isfinite(model.log_prob(vectors))][:count]


def rate(model: JointModel, batch: Floats) -> float:
    """Return densities a second of the processor."""
    begin, count = time.process_time(), 0
    while time.process_time() - begin < SECONDS:
        model.log_prob(batch)
        count += len(batch)
    return count / (time.process_time() - begin)


def serve(study: Path, vectors: Floats, values: Path) -> None:
    """Write the densities of the vectors; then answer each size of a batch with a rate."""
    model = assemble(read_study(study)).model
    np.save(values, model.log_prob(vectors))
    print("ready", flush=True)
    for line in sys.stdin:
        print(rate(model, vectors[: int(line)]), flush=True)


class Checkout:
    """A process with the code of one checkout that measures when it is asked."""

    def __init__(self, python: Path, study: Path, vectors: Path, values: Path) -> None:
        command = [python, Path(__file__).resolve(), "--study", study.resolve()]
        self.values = values
        self._process = subprocess.Popen(
            [*map(str, command), "--serve", str(vectors), str(values)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, size: int) -> float:
        assert self._process.stdin is not None
        print(size, file=self._process.stdin, flush=True)
        return float(self._line())

    def wait(self) -> Floats:
        assert self._line() == "ready"
        return np.asarray(np.load(self.values))

    def close(self) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


def measure(study: Path, pythons: dict[str, Path]) -> dict[str, object]:
    """Return the document: rates of the checkouts by name, in turns."""
    with tempfile.TemporaryDirectory() as folder:
        vectors = Path(folder) / "vectors.npy"
        np.save(vectors, draws(assemble(read_study(study)).model, max(BATCHES)))
        checkouts = {
            name: Checkout(python, study, vectors, Path(folder) / f"{name}.npy")
            for name, python in pythons.items()
        }
        values = [checkout.wait() for checkout in checkouts.values()]
        found = {
            size: np.array([[c.ask(size) for c in checkouts.values()] for _ in range(ROUNDS)])
            for size in BATCHES
        }
        for checkout in checkouts.values():
            checkout.close()
    document: dict[str, object] = {
        name: {size: float(np.median(rates[:, k])) for size, rates in found.items()}
        for k, name in enumerate(pythons)
    }
    if len(values) > 1:
        document["ratio"] = {
            size: float(np.median(rates[:, 0] / rates[:, 1])) for size, rates in found.items()
        }
        size = np.maximum(np.abs(values[1]), 1.0)
        document["largest_difference"] = float(np.max(np.abs(values[0] - values[1]) / size))
    return document


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the whole document")
    parser.add_argument("--study", type=Path, default=STUDY)
    parser.add_argument("--against", type=Path, help="another checkout, synced")
    parser.add_argument("--serve", nargs=2, type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        vectors, values = options.serve
        serve(options.study, np.load(vectors), values)
        return
    pythons = {"logprob_per_second": Path(sys.executable)}
    if options.against is not None:
        pythons["before"] = options.against / ".venv" / "bin" / "python"
    document = measure(options.study, pythons)
    if options.json:
        print(json.dumps(document | {"study": str(options.study)}, indent=1))
        return
    for key, value in document.items():
        print(f"{key:20} {value}")


if __name__ == "__main__":
    main()
