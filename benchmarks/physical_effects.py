"""Effects planted by physics of a laboratory, never by the rule of the entry that explains them.

Each entry of the catalogue that can show in readings has a mechanism here that comes from
mechanics, gas flow, chemistry, optics or a slip of the pen: another geometry that is meshed, water
that diffuses, stress that relaxes, paper whose fibres are cut, a crack that leaks, a form filled in
on another basis. Nothing of `bayesdeg.causes` is called. Where the entry's rule is the same physics
its sizes are known, and intervals can be held against them; elsewhere the rule is an
approximation, and what is asked is whether the entry is named.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hidden_studies import (
    ONLY_IN,
    REFUSED,
    HiddenStudy,
    designs,
    experimented,
    is_stiff,
    write_folder,
)
from numpy.typing import NDArray
from physics.fields import (
    Diffusion,
    Drying,
    Elastic,
    Field,
    FieldActuator,
    FieldMap,
    Memory,
    Softened,
    Viscous,
    Water,
    reacted,
)
from physics.mounting import Bond, Mounting

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import ForwardMap, Inputs, Prediction, gravity_direction
from bayesdeg.actuator.mesh import COARSE, FINE
from bayesdeg.actuator.status import Resolution
from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import find
from bayesdeg.data.settings import Dimensions, Settings
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.experiment import Design
from bayesdeg.laboratory.truth import HiddenEffect, Truth
from bayesdeg.laboratory.writing import TRUTH_FILE, Provenance

Floats = NDArray[np.float64]
Tables = Mapping[str, pd.DataFrame]
Remembering = Callable[[FieldActuator, float], Memory]
Mounted = Callable[[float], Mounting]

ATMOSPHERE = 101.3  # kPa
GRAVITY = 9.81  # m/s²
MOST_DEGRADED = 30.5  # D_R after long burial [%], see `bayesdeg.laboratory.truth.Truth`
WORST = 25.0  # %, at which sizes that grow with the degradation rate are given
FRESH = 0.5  # %, below which nothing has degraded
MIDDLE = Resolution(
    along=1.8, across=1.3, up=2.5
)  # of paper that comes off; on `COARSE` it does a sixth too much
STEEPNESS = 0.068  # d ln C/dD of the reference material [1/%]
ENERGY, SHARPNESS = 0.02, 0.1  # m [C1] and beta of Ogden and Roxburgh
EQUATION_6 = 0.8574  # dry mass lost over the degradation rate of the dry basis
MOISTURE = 0.2  # by total mass, before degradation
DRY_DENSITY = 3.0 / (2.0 / 1.35 + 1.0 / 1.26)  # g/cm³, of gelatin and glycerol 2 : 1 by mass
USUAL_REACH = 5.5  # mm; curvature at 25 % falls by 4 %, as with a usual skin (1 mm: by a third)
DENSE = "B"  # the batch with too little water
MELTING, OF_FILMS = 80.0, 22.0  # °C, of the helices, and at which films were pulled
MOST_SPECIMENS = 100  # of a study
ALIKE = 0.1  # relative scatter, from actuator to actuator, of how its paper was bonded
#: Designs with fewer actuators where a field is solved for each: degradation rates and copies.
SMALL: Mapping[str, tuple[tuple[float, ...], int]] = {
    "careful": ((0.0, 10.0, 25.0), 3),
    "history": ((0.0, 10.0, 25.0), 2),
}


@dataclass(frozen=True)
class Tests:
    """Tests of actuators as arrays of specimens by readings.

    Parameters
    ----------
    table : pandas.DataFrame
        ``Design.actuator``.
    """

    table: pd.DataFrame

    def column(self, name: str) -> NDArray[np.generic]:
        """Return a column, (n_specimens, n_readings)."""
        groups = self.table.groupby("specimen_id", sort=False)[name]
        return np.stack([group.to_numpy() for _, group in groups])

    @property
    def level(self) -> Floats:
        """Degradation rates that are aimed at, (n_specimens, 1) [%]."""
        return self.column("degradation_pct")[:, :1].astype(float)

    @property
    def held(self) -> Floats:
        """How long each pressure is held [s]."""
        if "time_s" not in self.table:
            return np.zeros(self.column("pressure_kPa").shape)
        return np.diff(self.column("time_s").astype(float), prepend=0.0)


Met = Callable[[Inputs, Tests], Inputs]


@dataclass(frozen=True)
class Physical:
    """One effect as it happens in a laboratory.

    Parameters
    ----------
    cause : str
        Entry of the catalogue that stands for it.
    values : mapping of str to float
        What the entry's sizes come to.
    exact : bool
        Whether that is so at every reading; else it is about so.
    met : callable, optional
        What the mechanics meets of what was set and cast.
    read : callable, optional
        What is read of what the mechanics does.
    memory : callable, optional
        Of the material of an actuator, at a degradation rate [%].
    mounting : callable, optional
        How an actuator of a degradation rate is bonded and held.
    moulded : callable, optional
        Dimensions of an actuator of a degradation rate.
    recorded : callable, optional
        Tables as they are written down, from those that would be right, and a generator.
    noted, noted_of_films : mapping
        Further columns of actuators, each with its values by the number of the copy, and of films.
    """

    cause: str
    values: Mapping[str, float]
    exact: bool = True
    met: Met | None = None
    read: Callable[[Prediction, Tests], Prediction] | None = None
    memory: Remembering | None = None
    mounting: Mounted | None = None
    moulded: Callable[[float], Dimensions] | None = None
    recorded: Callable[[Tables, np.random.Generator], Tables] | None = None
    noted: Mapping[str, tuple[object, ...]] = field(default_factory=dict)
    noted_of_films: Mapping[str, Any] = field(default_factory=dict)

    @property
    def is_solved(self) -> bool:
        """Whether a field or another mesh is solved for each actuator."""
        return any((self.memory, self.mounting, self.moulded))

    @property
    def shows_in_readings(self) -> bool:
        """Whether readings of actuators differ, and not only what is written beside them."""
        return self.is_solved or bool(self.met or self.read)


def design_with(effects: Sequence[Physical], whole: Design, name: str) -> Design:
    """Return the tests, with what is noted beside them; fewer actuators where each is solved."""
    table = whole.actuator
    copy = table["specimen_id"].str[-1].astype(int)
    noted: dict[str, Any] = {}
    of_films: dict[str, Any] = {}
    for one in effects:
        noted |= {key: copy.map(lambda k, of=v: of[k - 1]) for key, v in one.noted.items()}
        of_films |= one.noted_of_films
    kept = np.ones(len(table), dtype=bool)
    if any(one.is_solved for one in effects) and name in SMALL:
        levels, copies = SMALL[name]
        kept = (table["degradation_pct"].isin(levels) & (copy <= copies)).to_numpy()
    actuator = table.assign(**noted)[kept].reset_index(drop=True)
    return replace(whole, actuator=actuator, tensile=whole.tensile.assign(**of_films))


def forward_with(effects: Sequence[Physical], design: Design, forward: ForwardMap) -> ForwardMap:
    """Return a map of actuators in which all effects are at work."""
    tests = Tests(design.actuator)
    mechanics = forward
    for one in effects:
        mechanics = _solving(one, tests, mechanics)

    def answered(inputs: Inputs) -> Prediction:
        for one in effects:
            inputs = one.met(inputs, tests) if one.met else inputs
        prediction = mechanics(inputs)
        for one in effects:
            prediction = one.read(prediction, tests) if one.read else prediction
        return prediction

    return answered


def _solving(one: Physical, tests: Tests, finer: ForwardMap) -> ForwardMap:
    """Return a map whose readings are multiplied by what an effect changes on a coarser mesh."""
    levels = tests.level[:, 0]
    if one.moulded is not None:
        return _reshaped(one.moulded, levels, finer)
    if one.memory is None and one.mounting is None:
        return finer
    memory = one.memory or elastic
    mounting = one.mounting or (lambda level: Mounting())
    return FieldMap(
        Geometry(Dimensions()),
        COARSE if one.mounting is None else MIDDLE,
        tests.held,
        lambda actuator, place: memory(actuator, float(levels[place])),
        mounting=lambda place: mounting(float(levels[place])),
        finer=finer,
    )


def _reshaped(
    moulded: Callable[[float], Dimensions], levels: Floats, finer: ForwardMap
) -> ForwardMap:
    """Return a map of actuators of other dimensions, by the ratio of two coarse meshes."""

    def answered(inputs: Inputs) -> Prediction:
        fine = finer(inputs)
        shape, ratios = fine.curvature.shape, np.ones((2, *fine.curvature.shape))
        for level in np.unique(levels):
            here = np.flatnonzero(levels == level)
            asked = _specimens(inputs, here, shape)
            changed, plain = (
                ExactMap(Geometry(dimensions), COARSE)(asked)
                for dimensions in (moulded(float(level)), Dimensions())
            )
            ratios[0][:, here] = changed.curvature / plain.curvature
            ratios[1][:, here] = changed.bend_angle / plain.bend_angle
        curvature, angle = fine.curvature * ratios[0], fine.bend_angle * ratios[1]
        return replace(fine, curvature=curvature, bend_angle=angle)

    return answered


def _specimens(inputs: Inputs, places: NDArray[np.intp], shape: tuple[int, ...]) -> Inputs:
    arrays: dict[str, Any] = {
        one.name: np.broadcast_to(value, shape)[:, places]
        for one in fields(inputs)
        if isinstance(value := getattr(inputs, one.name), np.ndarray)
    }
    return replace(inputs, **arrays)


def elastic(actuator: FieldActuator, level: float) -> Memory:
    """Return a body without a memory."""
    return Elastic(Field(actuator.body.constants))


def _times(inputs: Inputs, factor: float | Floats) -> Inputs:
    """Return inputs of a body that is stiffer by a factor, and its paper not."""
    return replace(inputs, c1=factor * inputs.c1, c2=factor * inputs.c2, c3=factor * inputs.c3)


def _burial(level: float | Floats) -> Floats:
    """Return the hours in the soil over the time constant, for a degradation rate [%]."""
    return -np.log1p(-np.asarray(level) / MOST_DEGRADED)


def _either(generator: np.random.Generator) -> float:
    return float(generator.choice([-1.0, 1.0]))


def dry_basis(moisture: float | Floats) -> Floats:
    """Return water over dry matter for a moisture content by total mass."""
    return np.asarray(moisture / (1.0 - moisture))


def on_dry_basis(rate: Floats) -> Floats:
    """Return the rates that the same weighings give by dry mass, for rates by total mass [%]."""
    water = dry_basis(MOISTURE * (1.0 - rate / 100.0))
    return 100.0 * (1.0 - water / dry_basis(MOISTURE))


def volume_kept(rate: Floats, lost: float = EQUATION_6) -> Floats:
    """Return the share of a part's volume that is left at degradation rates of the wet basis [%].

    Dry matter is lost by Eq. 6 of the source, whose rates are of the dry basis; what is left holds
    the water that its moisture content says.
    """
    water = dry_basis(MOISTURE * (1.0 - rate / 100.0))
    dry = 1.0 - lost * (1.0 - water / dry_basis(MOISTURE))
    return dry * (1.0 / DRY_DENSITY + water) / (1.0 / DRY_DENSITY + dry_basis(MOISTURE))


def misgauged(weight: float, stated: float) -> Met:
    """Return pressures of a gauge whose span was set against a weight, stated as another."""
    return lambda inputs, tests: replace(inputs, pressure=inputs.pressure * weight / stated)


def viscous(share: float, time: float) -> Remembering:
    """Return bodies of whose stress a share relaxes with a time [s]."""
    return lambda actuator, level: Viscous(actuator.body.constants, shares=(share,), times=(time,))


def softened(share: float) -> Remembering:
    """Return bodies that the largest energies of their points soften by a share in the end."""

    def memory(actuator: FieldActuator, level: float) -> Memory:
        return Softened(actuator.body.constants, r=1.0 / share, m=ENERGY, beta=SHARPNESS)

    return memory


def from_surfaces(reach: float) -> Remembering:
    """Return bodies that are degraded from their surfaces, by diffusion and reaction [mm]."""

    def memory(actuator: FieldActuator, level: float) -> Memory:
        rate = reacted(Diffusion.on(actuator.mesh.body), reach, level)
        factor = np.exp(STEEPNESS * (rate - level))
        return Elastic(Field(actuator.body.constants * factor[..., None]))

    return memory


def off_end(share: float) -> Mounted:
    """Return paper that has come off from the free end, by a share of the length at 25 %."""
    return lambda level: Mounting(Bond(off_end=share).grown(level, WORST))


FILLING, TURNING, SETTLED = 0.25, 2.0, 8.0
"""Of a regulator [s]: time constant of the chambers behind its open valve, time in which its knob
is turned from one setting to the next, and time after that before anything is read."""
STEP = 0.02  # s


def behind_valve(settings: Floats, friction: float) -> Floats:
    """Return pressures in chambers behind a regulator that vents, whose valve rubs [kPa].

    The spring that the knob sets and the chambers push on either side of a diaphragm, which moves
    once their difference exceeds the friction of its valve, and opens the inlet or the vent as far
    as it exceeds it. Air then flows in proportion.

    Parameters
    ----------
    settings : array, shape (..., n)
        From one to the next of which the knob is turned, the first from 0 [kPa].
    friction : float
        Over the area of the diaphragm [kPa].
    """
    knob, inside = np.zeros(settings.shape[:-1]), np.zeros(settings.shape[:-1])
    found = np.zeros(settings.shape)
    share = -np.expm1(-STEP / FILLING)
    for place in range(settings.shape[-1]):
        last, knob = knob, settings[..., place]
        for time in np.arange(STEP, TURNING + SETTLED, STEP):
            spring = last + (knob - last) * min(time / TURNING, 1.0)
            net = spring - inside
            inside = inside + share * np.sign(net) * np.maximum(np.abs(net) - friction, 0.0)
        found[..., place] = inside
    return found


# what happens, by the entry that stands for it: each of a size over the usual one


def other_weather(size: float, generator: np.random.Generator) -> Physical:
    """A sealed gauge shows how far the air's pressure has fallen since it was sealed."""
    fallen = 8.0 * size

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        absolute = inputs.pressure + ATMOSPHERE - fallen
        return replace(inputs, pressure=np.maximum(absolute - ATMOSPHERE, 0.0))

    return Physical("pressure_offset", {"offset": fallen}, met=met)


def leaking_crack(size: float, generator: np.random.Generator) -> Physical:
    """Air flows through a thin hose and out of a crack, each by P₁² − P₂² as a laminar gas does."""
    share = 0.15 * size  # of the hose in the resistance of both

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        supply = (inputs.pressure + ATMOSPHERE) ** 2
        inside = np.sqrt((1.0 - share) * supply + share * ATMOSPHERE**2)
        return replace(inputs, pressure=inside - ATMOSPHERE)

    return Physical("pressure_loss", {"fraction": share}, exact=False, met=met)


def wrong_weight(size: float, generator: np.random.Generator) -> Physical:
    """The gauge's span was set against a weight that is not the stated one."""
    gain = 0.04 * size * _either(generator)
    return Physical("gauge_gain", {"gain": gain}, met=misgauged(1.0 + gain, 1.0))


def concentrated(size: float, generator: np.random.Generator) -> Physical:
    """Cast walls dried more, or less, than films: a gel's modulus goes with its concentration²."""
    log_ratio = 0.15 * size * _either(generator)
    concentration = np.exp(0.5 * log_ratio)
    return Physical(
        "film_mismatch", {"log_ratio": log_ratio}, met=lambda i, t: _times(i, concentration**2)
    )


def dense_batch(size: float, generator: np.random.Generator) -> Physical:
    """The second batch of actuators was mixed with too little water."""
    missing = 0.09 * size
    concentration = 1.0 / (1.0 - missing)

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        dense = tests.column("batch")[:, :1] == DENSE
        return _times(inputs, np.where(dense, concentration**2, 1.0))

    values = {"second": 2.0 * float(np.log(concentration))}
    batches = {"batch": ("A", DENSE, "A")}
    return Physical(
        "batch_stiffness", values, met=met, noted=batches, noted_of_films={"batch": "A"}
    )


def warm_room(size: float, generator: np.random.Generator) -> Physical:
    """Helices melt: a modulus goes with the square of their share, linear to the melting point."""
    melting = OF_FILMS + (MELTING - OF_FILMS) / size

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        warmth = tests.column("temperature_C")[:, :1].astype(float)
        return _times(inputs, ((melting - warmth) / (melting - OF_FILMS)) ** 2)

    return Physical(
        "temperature_softening",
        {"softening": 2.0 / (melting - 24.0)},
        exact=False,
        met=met,
        noted={"temperature_C": (19.0, 22.0, 27.0)},
        noted_of_films={"temperature_C": OF_FILMS},
    )


def cut_fibres(size: float, generator: np.random.Generator) -> Physical:
    """Enzymes cut the paper's fibres at a constant rate, at which its stiffness decays."""
    softening = 1.4 * size
    rate = softening / float(_burial(WORST))

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        left = np.exp(-rate * _burial(tests.level))
        return replace(inputs, paper_stiffness=inputs.paper_stiffness * left)

    return Physical("paper_softening", {"softening": softening}, exact=False, met=met)


def shrunken(size: float, generator: np.random.Generator) -> Physical:
    """Actuators are as small as what is left of their mass and water makes them."""
    lost = EQUATION_6 * min(size, 1.15)

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        kept = volume_kept(tests.level, lost)
        return replace(inputs, linear_scale=inputs.linear_scale * np.cbrt(kept))

    values = {"lost_volume": float(1.0 - volume_kept(np.array(WORST), lost))}
    return Physical("degraded_shrinkage", values, exact=False, met=met)


def entangled(size: float, generator: np.random.Generator) -> Physical:
    """Entanglements add r (√I₂ − √3) to the energy of all that is made of the gel, films too."""
    ratio = 0.4 * size

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        return replace(inputs, second_invariant=ratio * inputs.c1)

    def recorded(tables: Tables, generator: np.random.Generator) -> Tables:
        films = tables["tensile"]
        stretch = films["stretch"].to_numpy(float)
        # in uniaxial tension I₂ = 2 λ + λ⁻²; C1 is that of the film's own first readings
        root = np.sqrt(2.0 * stretch + stretch**-2)
        added = ratio * _first_constant(films) * (1.0 - stretch**-3) / root
        stress = films["stress_MPa"] + added
        return {**tables, "tensile": films.assign(stress_MPa=stress.round(6))}

    return Physical("second_invariant", {"ratio": ratio}, met=met, recorded=recorded)


def _first_constant(films: pd.DataFrame) -> Floats:
    """Return C1 of each reading's film, from its stress at small stretch: σ = 2 C1 (λ − λ⁻²)."""
    basis = 2.0 * (films["stretch"] - films["stretch"] ** -2)
    small = films["stretch"] < films.groupby("degradation_pct")["stretch"].transform("min") * 1.2
    kept = films[small].assign(basis=basis[small])
    stress = kept.groupby("degradation_pct")["stress_MPa"].sum()
    found = stress / kept.groupby("degradation_pct")["basis"].sum()
    return films["degradation_pct"].map(found).to_numpy(float)


def cockled(size: float, generator: np.random.Generator) -> Physical:
    """Paper cockled while it was wet: waves of height a and length ℓ are longer by (π a/ℓ)²."""
    wave, height = 8.0, 8.0 / np.pi * np.sqrt(0.015 * size)  # mm

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        return replace(inputs, paper_slack=np.asarray((np.pi * height / wave) ** 2))

    return Physical("paper_slack", {"slack": 0.015 * size}, met=met)


def dried_on_paper(size: float, generator: np.random.Generator) -> Physical:
    """The gel went on drying on its paper, each actuator a little more or less than the others."""
    mismatch, [own] = min(0.017 * size, 0.027), generator.spawn(1)
    scatter = own.standard_normal(MOST_SPECIMENS)

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        factor = 1.0 + ALIKE * scatter[: len(tests.level), None]
        return replace(inputs, paper_mismatch=mismatch * factor)

    return Physical("initial_curvature", {"mismatch": mismatch}, exact=False, met=met)


def wetter_walls(size: float, generator: np.random.Generator) -> Physical:
    """Walls kept another share of their water than the films whose volume ratio was weighed."""
    scale = 1.0 + 0.12 * size * _either(generator)
    return Physical(
        "shrinkage_reading",
        {"scale_error": scale - 1.0},
        met=lambda inputs, tests: replace(
            inputs, linear_scale=np.cbrt(inputs.linear_scale**3 * scale**3)
        ),
    )


def weighty(size: float, generator: np.random.Generator) -> Physical:
    """Gelatin and glycerol have a weight."""
    density = min(1150.0 * size, 1600.0)  # kg/m³

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        mounts = tests.column("mount")
        along, up = np.moveaxis(
            np.array([[gravity_direction(str(m)) for m in row] for row in mounts]), -1, 0
        )
        weight = density * GRAVITY * 1e-6 * 1e3  # kN/m³
        return replace(inputs, weight_along=weight * along[None], weight_up=weight * up[None])

    values = {"density": density}
    return Physical("gravity", values, exact=False, met=met)


def traced_above(size: float, generator: np.random.Generator) -> Physical:
    """Marks on the side wall, at a height over the bottom, through which a circle is laid."""
    height = 5.0 * size  # mm

    def read(prediction: Prediction, tests: Tests) -> Prediction:
        radius = 1e3 / np.maximum(prediction.curvature, 1e-9) + height
        return replace(prediction, curvature=1e3 / radius)

    return Physical("curvature_reading", {"fibre_height": height}, read=read)


def over_area(size: float, generator: np.random.Generator) -> Physical:
    """Forces on films were divided by the area that two cameras saw, and not by the first."""

    def recorded(tables: Tables, generator: np.random.Generator) -> Tables:
        films = tables["tensile"]
        area = 1.0 / films["stretch"]  # over the first one
        return {
            **tables,
            "tensile": films.assign(stress_MPa=(films["stress_MPa"] / area).round(6)),
        }

    return Physical("stress_measure", {"confusion": 1.0}, recorded=recorded)


def other_pot(size: float, generator: np.random.Generator) -> Physical:
    """Actuators lay in wetter soil than the films by whose moisture their rate is known."""
    shift = 3.0 * size * _either(generator)

    def recorded(tables: Tables, generator: np.random.Generator) -> Tables:
        readings = tables["actuator"]
        names = readings["specimen_id"].drop_duplicates()
        slips = dict(zip(names, 0.5 * generator.standard_normal(len(names)), strict=True))
        rate = readings["degradation_pct"]
        written = (rate - shift - readings["specimen_id"].map(slips)).clip(lower=1.0)
        rate = rate.where(rate <= FRESH, written.round(2))
        return {**tables, "actuator": readings.assign(degradation_pct=rate)}

    return Physical("degradation_misread", {"shift": shift, "scatter": 0.5}, recorded=recorded)


def other_basis(size: float, generator: np.random.Generator) -> Physical:
    """Rates of actuators were computed with water over dry mass: there is one size."""

    def recorded(tables: Tables, generator: np.random.Generator) -> Tables:
        readings = tables["actuator"]
        rates = on_dry_basis(readings["degradation_pct"].to_numpy(float)).round(2)
        return {**tables, "actuator": readings.assign(degradation_pct=rates)}

    excess = WORST / float(on_dry_basis(np.array(WORST))) - 1.0
    return Physical("degradation_scale", {"excess": excess}, exact=False, recorded=recorded)


def relaxing(size: float, generator: np.random.Generator) -> Physical:
    """Stress in the walls relaxes, in paper not."""
    share, time = 0.08 * size, float(generator.uniform(15.0, 40.0))
    values = {"amount": share / (1.0 - share), "time_constant": time / (1.0 - share)}
    return Physical("creep", values, exact=False, memory=viscous(share, time))


def worked(size: float, generator: np.random.Generator) -> Physical:
    """The largest energy of each point so far has softened it, after Ogden and Roxburgh."""
    share = 0.11 * size
    return Physical("mullins", {"softening": share}, exact=False, memory=softened(share))


def drying(size: float, generator: np.random.Generator) -> Physical:
    """Water diffuses out of the walls into dry air while the actuator is tested."""
    water = Water(diffusivity=1e-5, transfer=2e-4, fall=1.0, stiffening=0.25 * size)

    def memory(actuator: FieldActuator, level: float) -> Memory:
        diffusion = Diffusion.on(actuator.mesh.body)
        return Drying(diffusion, actuator.body.constants, water, step=150.0)

    return Physical("humidity_drift", {"stiffening": 0.08 * size}, exact=False, memory=memory)


def eaten_into(size: float, generator: np.random.Generator) -> Physical:
    """What degrades comes in through the faces in the soil, and is used up on its way."""
    values = {"skin_stiffening": 0.7 * size}
    return Physical("degraded_skin", values, exact=False, memory=from_surfaces(USUAL_REACH / size))


def loosened(size: float, generator: np.random.Generator) -> Physical:
    """Paper comes off from the free end, further where more has degraded."""
    mounting = off_end(min(0.45 * size, 0.7))
    return Physical("delamination", {"looseness": size}, exact=False, mounting=mounting)


def eaten_walls(size: float, generator: np.random.Generator) -> Physical:
    """Soil takes the faces that lie in it off at a constant rate, paper and clamp excepted."""
    at_worst = 0.2 * min(size, 1.6)  # mm

    def moulded(level: float) -> Dimensions:
        lost = at_worst * float(_burial(level) / _burial(WORST))
        whole = Dimensions()
        return replace(
            whole,
            width=whole.width - 2.0 * lost,
            side_wall=whole.side_wall - lost,
            height=whole.height - lost,
            roof=whole.roof - lost,
            gap=whole.gap + 2.0 * lost,
            chamber_wall=whole.chamber_wall - lost,
            channel_roof=whole.channel_roof - lost,
        )

    values = {"lost_share": at_worst / Dimensions().roof}
    return Physical("erosion", values, exact=False, moulded=moulded)


def small_core(size: float, generator: np.random.Generator) -> Physical:
    """The core of the mould was too small, or too large: all walls about it differ as much."""
    more = 0.16 * size * _either(generator)  # mm

    def moulded(level: float) -> Dimensions:
        whole = Dimensions()
        return replace(
            whole,
            roof=whole.roof + more,
            side_wall=whole.side_wall + more,
            end_wall=whole.end_wall + more,
            chamber_wall=whole.chamber_wall + more,
        )

    values = {"excess": more / Dimensions().roof}
    return Physical("wall_thickness", values, exact=False, moulded=moulded)


def rubbing_valve(size: float, generator: np.random.Generator) -> Physical:
    """The valve of the regulator rubs; its knob is turned to zero between cycles."""
    friction = 6.0 * size

    def met(inputs: Inputs, tests: Tests) -> Inputs:
        cycle = tests.column("cycle")[0].astype(int)  # the same tests of all
        rests = np.flatnonzero(np.diff(cycle) != 0) + 1
        settings = np.insert(inputs.pressure, rests, 0.0, axis=-1)
        inside = behind_valve(settings, friction)
        return replace(inputs, pressure=np.delete(inside, rests + np.arange(len(rests)), axis=-1))

    return Physical("hysteresis", {"friction": friction}, met=met)


HAPPENS: Mapping[str, Callable[[float, np.random.Generator], Physical]] = {
    "pressure_offset": other_weather,
    "pressure_loss": leaking_crack,
    "gauge_gain": wrong_weight,
    "film_mismatch": concentrated,
    "batch_stiffness": dense_batch,
    "temperature_softening": warm_room,
    "paper_softening": cut_fibres,
    "degraded_shrinkage": shrunken,
    "second_invariant": entangled,
    "paper_slack": cockled,
    "initial_curvature": dried_on_paper,
    "shrinkage_reading": wetter_walls,
    "gravity": weighty,
    "curvature_reading": traced_above,
    "stress_measure": over_area,
    "degradation_misread": other_pot,
    "degradation_scale": other_basis,
    "erosion": eaten_walls,
    "wall_thickness": small_core,
    "degraded_skin": eaten_into,
    "delamination": loosened,
    "creep": relaxing,
    "humidity_drift": drying,
    "mullins": worked,
    "hysteresis": rubbing_valve,
}
"""By the entry of the catalogue that stands for it."""
LATER = ("hysteresis",)
"""Entries that came after the first two draws, in which they would change what is drawn."""
CHEAP = tuple(
    name
    for name in HAPPENS
    if name not in LATER and not HAPPENS[name](1.0, np.random.default_rng(0)).is_solved
)
"""Those for which nothing is solved; two at once are drawn of them."""
SINGLE_DRAW, PAIR_DRAW, LATER_DRAW = 700, 1000, 2000
"""Numbers of the first study with one effect, each entry in turn, of the first with two, and of the
first with one of `LATER`."""
SIZES = (1.0, 1.3, 1.6)  # over the usual size
#: Show only there: batches and warmth are noted in any design, little scatter shows them.
DESIGN_OF = {
    **ONLY_IN,
    "hysteresis": "history",
    **dict.fromkeys(("delamination", "erosion", "wall_thickness", "degradation_scale"), "careful"),
    **dict.fromkeys(("gauge_gain", "degraded_shrinkage", "temperature_softening"), "careful"),
}


@dataclass(frozen=True)
class PhysicalStudy(HiddenStudy):
    """A study whose effects are planted by physics; ``effects`` only says what their sizes are.

    Parameters
    ----------
    physics : tuple of Physical
        What happens in it.
    """

    physics: tuple[Physical, ...] = ()


def drawn_by_physics(number: int, *, seed: int) -> PhysicalStudy:
    """Draw a study: from `SINGLE_DRAW` on one effect, from `PAIR_DRAW` on two at once.

    From `LATER_DRAW` on it is one of `LATER`.
    """
    generator = np.random.default_rng((seed, number))
    pair = PAIR_DRAW <= number < LATER_DRAW
    begun, names = SINGLE_DRAW, tuple(name for name in HAPPENS if name not in LATER)
    if number >= PAIR_DRAW:
        begun, names = (PAIR_DRAW, CHEAP) if pair else (LATER_DRAW, LATER)
    first = names[(number - begun) % len(names)]
    design = DESIGN_OF.get(first, str(generator.choice(["angle", "angle", "careful", "curvature"])))
    size = float(generator.choice(SIZES))
    chosen = [first]
    if pair:
        fitting = [
            name
            for name in CHEAP
            if name != first
            and DESIGN_OF.get(name, design) == design
            and {name, first} not in REFUSED
        ]
        chosen.append(str(generator.choice(fitting)))
    physics = tuple(HAPPENS[name](size, generator) for name in chosen)
    effects = tuple(HiddenEffect(find(one.cause), one.values) for one in physics)
    kind = "pair" if pair else "single"
    return PhysicalStudy(number, kind, design, effects, size, physics=physics)


def made_by_physics(
    study: PhysicalStudy, folder: Path, **how: Any
) -> tuple[Truth, Mapping[str, Floats]]:
    """Write the folder of a study; return the truth, and what each effect changes of the readings.

    ``how`` are the other arguments of `written`. The change is that against a twin, in which it
    alone is missing and all else is as it was. Of what only changes what is written beside the
    readings there is none.
    """
    truth = written(study, study.physics, folder, **how)
    observed, changes = _observed(folder), {}
    for one in study.physics:
        if not one.shows_in_readings:
            continue
        twin = folder.with_name(f"{folder.name}-without-{one.cause}")
        others = tuple(other for other in study.physics if other is not one)
        same = written(study, others, twin, **how, tests_of=study.physics)
        without = _observed(twin)
        if same == truth and without.shape == observed.shape:
            changes[one.cause] = observed - without
    return truth, changes


def written(
    study: PhysicalStudy,
    physics: tuple[Physical, ...],
    folder: Path,
    *,
    forward: ForwardMap,
    seed: int,
    command: str,
    tests_of: tuple[Physical, ...] | None = None,
    tests: Design | None = None,
    dimensions: Dimensions | None = None,
    mesh: Resolution = FINE,
    fits: Callable[[Truth], bool] = is_stiff,
) -> Truth:
    """Write the folder of a study in which given effects are at work; return what is true of it.

    Parameters
    ----------
    study : PhysicalStudy
    physics : tuple of Physical
        What is at work.
    folder : Path
    forward : ForwardMap
        Without effects.
    seed : int
    command : str
        That makes the study.
    tests_of : tuple of Physical, optional
        Effects whose tests are made; by default those at work.
    tests : Design, optional
        By default that which the study names.
    dimensions : Dimensions, optional
        Of the actuators; by default those of the source.
    mesh : Resolution
        Of the forward map.
    fits : callable
        Whether a material may be that of the study.
    """
    design = design_with(
        tests_of or physics, designs()[study.design] if tests is None else tests, study.design
    )
    bare = replace(study, effects=(), physics=())
    acting = forward_with(physics, design, forward)
    made = experimented(bare, forward=acting, seed=seed, design=design, fits=fits)
    tables = made.experiment.tables
    for place, one in enumerate(physics):
        if one.recorded is not None:
            tables = one.recorded(tables, np.random.default_rng((seed, study.number, place)))
    title = f"hidden effect {study.number}"
    settings = Settings(
        title=title, seed=study.number, priors=made.priors, dimensions=dimensions or Dimensions()
    )
    provenance = Provenance(command=command, seed=seed, mesh=vars(mesh))
    experiment = replace(made.experiment, tables=tables)
    write_folder(experiment, settings, folder, provenance=provenance)
    (folder / TRUTH_FILE).unlink()
    return made.truth


def _observed(folder: Path) -> Floats:
    return assemble(read_study(folder)).model.observed
