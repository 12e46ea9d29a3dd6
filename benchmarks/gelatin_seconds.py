"""Time of the README's study, from data to report."""

import json
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

Json = dict[str, object]


def gelatin_seconds(effort: str) -> Json:
    """Run the study of the README as a user does, and read off how long it took [s]."""
    program = Path(sys.executable).with_name("bayesdeg")
    command = (program, "run", "studies/gelatin_actuator", "--effort", effort, "--quiet")
    with TemporaryDirectory() as folder:
        start = time.perf_counter()
        subprocess.run((*command, "--out", folder), check=True)
        whole = time.perf_counter() - start
        stages = json.loads((Path(folder) / "run.json").read_text(encoding="utf-8"))["seconds"]
    return {
        f"gelatin_seconds_per_verdict_{effort}": stages["verdict"],
        f"gelatin_seconds_{effort}": whole,
    }
