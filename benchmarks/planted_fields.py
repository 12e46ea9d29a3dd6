"""Planted studies whose effect is a field with a memory, solved by physics of its own.

    uv run python benchmarks/planted_fields.py

writes the folders 23 to 25 of ``tests/hidden_effects``, beside those of ``planted_studies.py``:
stress that relaxes (`Viscous`), softening by each point's own history (`Softened`), and degradation
that comes in from the surfaces by diffusion and reaction (`reacted`). No function of a cause takes
part. Elastic readings come from the fine mesh, and are multiplied by what the field changes on a
coarse one. What stands there is left alone.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from hidden_studies import HiddenStudy, designs, made
from planted_studies import FOLDER, PLANTED, SEED, fine

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import COARSE
from bayesdeg.console import shown
from bayesdeg.data.settings import Dimensions
from bayesdeg.emulator.workers import pool
from bayesdeg.laboratory.experiment import Design
from bayesdeg.laboratory.fields import (
    Diffusion,
    Elastic,
    Field,
    FieldActuator,
    FieldMap,
    Memory,
    Softened,
    Viscous,
    reacted,
)

LEVELS = (0.0, 10.0, 25.0)
STEEPNESS = 0.068  # d ln C/dD of the reference material [1/%]


@dataclass(frozen=True)
class PlantedField:
    """What is hidden in a study, and how it was tested.

    Parameters
    ----------
    design : str
        As in `hidden_studies.designs`; fewer actuators are tested.
    cause : str
        The entry of the catalogue whose mechanism it is.
    physics : dict
        Its numbers, for the record.
    memory : callable
        Of an actuator at a degradation rate [%].
    copies : int
        Actuators a level.
    """

    design: str
    cause: str
    physics: dict[str, float]
    memory: Callable[[FieldActuator, float], Memory]
    copies: int = 2

    def tests(self) -> Design:
        """Return the design with fewer actuators."""
        whole = designs()[self.design]
        table = whole.actuator
        copy = table["specimen_id"].str[-1].astype(int)
        kept = table["degradation_pct"].isin(LEVELS) & (copy <= self.copies)
        return replace(whole, actuator=table[kept].reset_index(drop=True))


def viscous(actuator: FieldActuator, level: float, *, share: float, time: float) -> Memory:
    """Return a body whose stress relaxes."""
    return Viscous(actuator.body.constants, (share,), (time,))


def softened(
    actuator: FieldActuator, level: float, *, r: float, energy: float, beta: float
) -> Memory:
    """Return a body that its largest energies soften."""
    return Softened(actuator.body.constants, r, energy, beta)


def from_surfaces(actuator: FieldActuator, level: float, *, depth: float) -> Memory:
    """Return a body that is degraded from its surfaces inwards."""
    rate = reacted(Diffusion.on(actuator.mesh.body), depth, level)
    factor = np.exp(STEEPNESS * (rate - level))
    return Elastic(Field(actuator.body.constants * factor[..., None]))


def _field(
    design: str, cause: str, law: Callable[..., Memory], copies: int = 2, **physics: float
) -> PlantedField:
    return PlantedField(design, cause, physics, partial(law, **physics), copies)


FIELDS = {
    23: _field("history", "creep", viscous, share=0.11, time=30.0),
    24: _field("history", "mullins", softened, r=6.0, energy=0.02, beta=0.1),
    25: _field("careful", "degraded_skin", from_surfaces, copies=3, depth=2.0),
}


def plant(number: int, folder: Path, truths: Path) -> None:
    """Make one study; what was hidden in it is written elsewhere."""
    planted = FIELDS[number]
    design = planted.tests()
    specimens = design.actuator.drop_duplicates("specimen_id")
    levels = specimens["degradation_pct"].to_numpy()
    held = _held(design, len(specimens))
    with pool(1) as executor, shown(quiet=False) as progress:
        elastic = fine(executor, partial(progress.stage, f"study {number}"), progress.advance)
        forward = FieldMap(
            Geometry(Dimensions()),
            COARSE,
            held,
            lambda actuator, place: planted.memory(actuator, float(levels[place])),
            finer=elastic,
        )
        study = HiddenStudy(number, planted.cause, planted.design, (), 1.0)
        made(
            study,
            folder,
            forward=forward,
            seed=SEED,
            command=f"python benchmarks/planted_fields.py {number}",
            design=design,
        )
    written = folder / "truth.json"
    truth = json.loads(written.read_text(encoding="utf-8"))
    truth |= {"mechanism": planted.cause, "physics": planted.physics}
    truths.mkdir(parents=True, exist_ok=True)
    (truths / f"{number}.json").write_text(json.dumps(truth, indent=2) + "\n", encoding="utf-8")
    written.unlink()


def _held(design: Design, count: int) -> np.ndarray:
    """Return how long each pressure is held [s], (n_specimens, n_readings)."""
    if "time_s" not in design.actuator:
        return np.zeros((count, len(design.actuator) // count))
    time = design.actuator["time_s"].to_numpy().reshape(count, -1)
    return np.diff(time, axis=1, prepend=0.0)


def main() -> None:
    """Plant the studies that are missing."""
    assert len(PLANTED) < min(FIELDS)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("numbers", nargs="*", type=int, choices=FIELDS, help="by default all")
    truths = FOLDER / "truths"
    for number in parser.parse_args().numbers or FIELDS:
        if not (truths / f"{number}.json").exists():
            plant(number, FOLDER / "studies" / str(number), truths)


if __name__ == "__main__":
    main()
