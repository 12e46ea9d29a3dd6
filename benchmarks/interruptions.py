"""Ctrl-C at many moments of a command: it must end with one line and exit code 3, or be done.

As from a terminal, the signal goes to the command and its worker processes.

    python benchmarks/interruptions.py --moments 40 run studies/treloar_uniaxial --effort quick

Each moment starts the command anew in one folder, so that later ones also go on from checkpoints.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

FIRST = 0.05  # s: the interpreter itself has begun
PATIENCE = 120.0  # s until a command that does not end counts as hung
ENDS = (0, 3)


def interrupted(command: list[str], seconds: float, number: int) -> str:
    """Send a signal after so many seconds; return what was wrong, or an empty text."""
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True
    ) as running:
        time.sleep(seconds)
        with suppress(ProcessLookupError):  # it is done
            os.killpg(running.pid, number)
        try:
            said = running.communicate(timeout=PATIENCE)[1].decode()
        except subprocess.TimeoutExpired:
            running.kill()
            return "did not end"
    if "Traceback" in said:
        return f"traceback: {said.strip().splitlines()[-1]}"
    return "" if running.returncode in ENDS else f"exit code {running.returncode}"


def main() -> int:
    """Interrupt at moments spread evenly over the logarithm of time; print what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--moments", type=int, default=40)
    parser.add_argument("--last", type=float, default=8.0, help="seconds")
    parser.add_argument("--signal", default="SIGINT")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    asked = parser.parse_args()
    number = getattr(signal, asked.signal)
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "bayesdeg", *asked.command]
        if "run" in asked.command:
            command += ["--out", str(Path(folder) / "run")]
        for seconds in np.geomspace(FIRST, asked.last, asked.moments):
            if fault := interrupted(command, float(seconds), number):
                faults += 1
                print(f"{seconds:.2f} s: {fault}")
    print(f"{asked.moments} moments, {faults} faults")
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
