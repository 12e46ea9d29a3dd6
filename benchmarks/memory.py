"""Peak memory of commands against the size of what they read; it must grow no faster than that.

    python benchmarks/memory.py --json

``check`` reads `actuator.csv` files of 1 to 20 MB, the largest that are read. ``run`` (effort
quick) calibrates copies of `studies/gelatin_actuator` with 1, 2 and 4 times its readings. The slope
is that of the largest pair, in MB of memory for a MB of file, and for a thousand readings;
``exponent`` is the slope of ln(memory above the smallest) by ln(size), of the two largest: 1
is linear.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
STUDY = ROOT / "studies" / "gelatin_actuator"
SIZES_MB = (0.5, 5.0, 10.0, 19.5)
COPIES = (1, 2, 4)
PEAK = """
import resource, sys
from bayesdeg import cli
code = cli.exit_code()
sys.stderr.write(f"peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.1f}\\n")
sys.exit(code)
"""


def peak_of(*words: object) -> float:
    """Return the most memory that a command takes in its own process [MB]."""
    done = subprocess.run(
        [sys.executable, "-c", PEAK, *map(str, words)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{words} ended with {done.returncode}: {done.stderr[-2000:]}")
    return float(done.stderr.split()[-1])


def study_of(folder: Path, table: pd.DataFrame, *, others: bool) -> Path:
    """Write a study with these readings of actuators, and with the films of the original."""
    folder.mkdir()
    for path in STUDY.glob("*.csv") if others else ():
        (folder / path.name).write_bytes(path.read_bytes())
    table.to_csv(folder / "actuator.csv", index=False)
    (folder / "study.toml").write_bytes((STUDY / "study.toml").read_bytes())
    return folder


def repeated(table: pd.DataFrame, times: int) -> pd.DataFrame:
    """Return the readings as those of so many times the specimens."""
    return pd.concat(
        [table.assign(specimen_id=table["specimen_id"] + f"_{k}") for k in range(times)]
    )


def growth(sizes: list[float], peaks: list[float]) -> dict[str, object]:
    """Return sizes, peaks, slope and exponent."""
    more = [peak - peaks[0] for peak in peaks]
    steps = [size - sizes[0] for size in sizes]
    exponent = math.log(more[-1] / more[-2]) / math.log(steps[-1] / steps[-2])
    slope = (peaks[-1] - peaks[-2]) / (sizes[-1] - sizes[-2])
    return {"sizes": sizes, "peaks_mb": peaks, "slope": slope, "exponent": exponent}


def checked(top: Path, table: pd.DataFrame) -> dict[str, object]:
    """Return how the memory of ``check`` grows with the file [MB]."""
    whole = len(table.to_csv(index=False)) / 1e6
    sizes, peaks = list[float](), list[float]()
    for wanted in SIZES_MB:
        folder = study_of(
            top / f"check {wanted}", repeated(table, round(wanted / whole)), others=False
        )
        sizes.append((folder / "actuator.csv").stat().st_size / 1e6)
        peaks.append(peak_of("check", folder))
    return growth(sizes, peaks)


def run(top: Path, table: pd.DataFrame) -> dict[str, object]:
    """Return how the memory of ``run`` grows with the readings [thousands], from ``run.json``."""
    sizes, peaks = list[float](), list[float]()
    for times in COPIES:
        folder, out = top / f"run {times}", top / f"out {times}"
        study_of(folder, repeated(table, times), others=True)
        peak_of("run", folder, "--effort", "quick", "--out", out, "--quiet")
        memory = json.loads((out / "run.json").read_bytes())["memory"]
        sizes.append(len(table) * times / 1e3)
        peaks.append(max(memory.values()))
    return growth(sizes, peaks)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print nothing but the result")
    asked = parser.parse_args()
    table = pd.read_csv(STUDY / "actuator.csv", comment="#")
    with tempfile.TemporaryDirectory() as name:
        told = {"check": checked(Path(name), table), "run": run(Path(name), table)}
    if asked.json:
        print(json.dumps(told, indent=1))
        return
    for command, found in told.items():
        print(f"{command}: {found}")


if __name__ == "__main__":
    main()
