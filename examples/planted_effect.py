"""An effect is planted in a virtual experiment and found again.

``bayesdeg simulate`` made the study that ``bayesdeg init`` writes: four actuators from a finer
finite element model than the one that calibrates, with 14 kPa hidden in the pressure. What was
planted is known here; the calibration sees the readings alone.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import bayesdeg as bd


def main() -> None:
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made) / "mine"
        subprocess.run([sys.executable, "-m", "bayesdeg", "init", folder], check=True)
        study = bd.read_study(folder)
        base = bd.calibrate(bd.Model(study), effort="quick", seed=1)
        print(bd.criticise(base, seed=1))


if __name__ == "__main__":
    main()
