"""How long an update of the gelatin study takes, and how near it is to a run with all readings.

    uv run python benchmarks/update.py --json

Of the study's readings some are set aside, the rest is run at standard effort, and they enter that
run by `bayesdeg update`: all readings of one specimen, or the last one of it. The posterior of the
final model, which is fitted to the published counts of ruptures too, is compared with that of the
whole study, sampled at thorough effort. The keys of the document:

update_seconds           largest time of an update by the clock on the wall, in a process that has
                         imported the library and loaded its kernels [s]
cpu_seconds              largest computing time of such an update, whatever the machine does besides
                         [s]
command_seconds          largest time of the command, from its start to its end [s]
command_cpu_seconds      largest computing time of the command [s]
mean_shift               largest difference of a posterior mean from that of the whole study, in
                         its standard deviations
sd_difference            largest relative difference of a standard deviation
bands_difference         largest difference of a median band, in widths of the 50 % band
rupture_difference       largest difference of a probability of rupture [–]
details                  by what was set aside: causes of the final model, method, effective draws,
                         Pareto k, the parameters that differ most, and the differences without the
                         update

--keep FOLDER keeps the runs, and takes those that are there.
"""

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from forward_case import machine

import bayesdeg as bd

Json = dict[str, object]

STUDY = Path("studies/gelatin_actuator")
SPECIMEN, LAST = "A10-2", 240.0  # of a middle rate, and the largest pressure [kPa]
CASES = ("specimen", "reading")
SEED = 99
PROGRAM = Path(sys.executable).with_name("bayesdeg")


def set_aside(case: str, folder: Path) -> tuple[Path, Path]:
    """Write the study without some rows, and these rows, unless there; return both places."""
    study, rows = folder / f"without_{case}", folder / f"{case}.csv"
    if rows.exists():
        return study, rows
    shutil.copytree(STUDY, study, dirs_exist_ok=True)
    table = pd.read_csv(STUDY / "actuator.csv", comment="#", dtype=str)
    chosen = table["specimen_id"] == SPECIMEN
    if case == "reading":
        chosen &= table["pressure_kPa"].astype(float) == LAST
    table[chosen].to_csv(rows, index=False)
    table[~chosen].to_csv(study / "actuator.csv", index=False)
    return study, rows


def run_of(study: Path, report: Path) -> Path:
    """Run a study as a user does, unless that was done."""
    if not (report / "run.json").exists():
        command = (PROGRAM, "run", study, "--out", report, "--workers", "1", "--quiet")
        subprocess.run(command, check=True)
    return report


def whole(folder: Path, causes: tuple[str, ...]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return summary and bands of the whole study at thorough effort, from a file if there."""
    name = "+".join(("whole", *sorted(causes)))
    files = folder / f"{name}.csv", folder / f"{name}_bands.csv"
    if not all(file.exists() for file in files):
        model = bd.Model(bd.read_study(STUDY)).with_causes(*causes)
        fit = bd.calibrate(model, effort="thorough", seed=SEED, workers=1, progress=False)
        fit.summary().to_csv(files[0])
        bands = bd.predict(fit, pressure=range(10, 241, 10), degradation=range(0, 26, 5))
        bands.to_csv(files[1], index=False)
    return pd.read_csv(files[0], index_col="parameter"), pd.read_csv(files[1])


def differences(found: pd.DataFrame, wanted: pd.DataFrame) -> Json:
    """Return by how much means and standard deviations differ, and which most."""
    mean = ((found["mean"] - wanted["mean"]) / wanted["sd"]).abs()
    sd = (found["sd"] / wanted["sd"] - 1.0).abs()
    return {
        "mean_shift": float(mean.max()),
        "mean_of": str(mean.idxmax()),
        "sd_difference": float(sd.max()),
        "sd_of": str(sd.idxmax()),
    }


def predicted(report: Path, table: str, wanted: pd.DataFrame) -> pd.DataFrame:
    """Return a table of a run beside what the posterior of the whole study predicts."""
    found = pd.read_csv(report / f"{table}.csv").query("pressure_kPa > 0")
    return found.merge(wanted, on=["degradation_pct", "pressure_kPa"], suffixes=("", "_all"))


def bands_difference(report: Path, wanted: pd.DataFrame) -> float:
    """Return the largest difference of a median band, in widths of the 50 % band."""
    both = predicted(report, "bands", wanted)
    width = both["q75_all"] - both["q25_all"]
    return float(((both["q50"] - both["q50_all"]).abs() / width).max())


def rupture_difference(report: Path, wanted: pd.DataFrame) -> float:
    """Return the largest difference of a probability of rupture [–]."""
    both = predicted(report, "rupture", wanted)
    return float((both["probability"] - both["probability_all"]).abs().max())


def command_seconds(command: tuple[object, ...]) -> tuple[float, float]:
    """Run a command; return its time by the clock on the wall, and its computing time [s]."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def measured(folder: Path) -> Json:
    """Return the document."""
    details: dict[str, Json] = {}
    for case in CASES:
        study, rows = set_aside(case, folder)
        report = run_of(study, folder / f"run_{case}")
        causes = json.loads((report / "verdict.json").read_text("utf-8"))["predicted_with"]
        summary, bands = whole(folder, tuple(causes))
        bd.update(report, rows, out=folder / "warm", progress=False)  # loads the kernels
        shutil.rmtree(folder / "warm")
        start, cpu = time.perf_counter(), time.process_time()
        found = bd.update(report, rows, out=folder / f"updated_{case}", progress=False)
        seconds, cpu = time.perf_counter() - start, time.process_time() - cpu
        ask = (PROGRAM, "update", report, rows, "--out", folder / "command", "--quiet")
        command, command_cpu = command_seconds(ask)
        shutil.rmtree(folder / "command")
        moved = found.summary()
        before = moved[["mean_before", "sd_before"]].set_axis(["mean", "sd"], axis=1)
        details[case] = {
            "update_seconds": seconds,
            "cpu_seconds": cpu,
            "command_seconds": command,
            "command_cpu_seconds": command_cpu,
            "causes": causes,
            "method": found.method,
            "effective": found.effective,
            "pareto_k": found.pareto_k,
            "effective_by_weights": found.entry.posteriors["final"].weights_effective,
            **differences(moved, summary),
            "bands_difference": bands_difference(found.folder, bands),
            "rupture_difference": rupture_difference(found.folder, bands),
            "without_update": differences(before, summary),
        }
    keys = (
        *("update_seconds", "cpu_seconds", "command_seconds", "command_cpu_seconds"),
        *("mean_shift", "sd_difference", "bands_difference", "rupture_difference"),
    )
    largest = {key: float(np.max([one[key] for one in details.values()])) for key in keys}
    return {**largest, "details": {"machine": machine(), **details}}


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the whole document")
    parser.add_argument("--keep", type=Path, help="folder of runs that are kept")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        document = measured(folder)
    if options.json:
        print(json.dumps(document, indent=1))
        return
    for key, value in document.items():
        if key != "details":
            print(f"{key:20} {value:.3g}")


if __name__ == "__main__":
    main()
