"""What a study is to do: the dimensions of the actuator, the priors, the options."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Literal

from bayesdeg.laws import Law
from bayesdeg.measure.mixture import Recipe

Effort = Literal["quick", "standard", "thorough"]

EFFORTS: tuple[Effort, ...] = ("quick", "standard", "thorough")
MODES = ("uniaxial", "equibiaxial", "planar")

#: Limits of a dimension [mm] and of the number of chambers; beyond them no mesh can be made.
SMALLEST_MM, LARGEST_MM, MOST_CHAMBERS = 1e-3, 2000.0, 200


@dataclass(frozen=True)
class Dimensions:
    """Dimensions of the actuator as moulded, before shrinkage; all lengths in mm.

    Parameters
    ----------
    length, width : float
        Outer length and width [mm]; the defaults are stated by doi:10.3389/frobt.2021.760485.
    height : float
        Outer height [mm]; the default of this and of everything below is assumed.
    chambers : int
        Number of chambers in a row.
    floor, roof, side_wall, end_wall : float
        Material under, over, beside and at the ends of the chambers [mm].
    chamber_wall : float
        Wall on each side of a gap [mm]; with ``gap = 0`` the divider is twice this.
    gap : float
        Open slot between neighbouring chambers, from the top down [mm]; 0 for solid dividers.
    channel_width, channel_height : float
        The channel on the floor that joins the chambers [mm].
    channel_roof : float
        Material over the channel under a slot [mm].

    Examples
    --------
    >>> Dimensions().problems()
    ()
    """

    length: float = 50.0
    width: float = 10.0
    height: float = 10.0
    chambers: int = 5
    floor: float = 2.0
    roof: float = 2.0
    side_wall: float = 2.0
    end_wall: float = 3.0
    chamber_wall: float = 1.5
    gap: float = 2.0
    channel_width: float = 2.0
    channel_height: float = 1.5
    channel_roof: float = 1.0

    def problems(self) -> tuple[str, ...]:
        """Say why no actuator can be made of these dimensions.

        Returns
        -------
        tuple of str
            One sentence a reason; empty if the dimensions are possible. What follows from a
            dimension that is itself impossible is left out.

        Examples
        --------
        >>> Dimensions(side_wall=5.0).problems()
        ('the two side walls (10 mm) leave no chamber in the width (10 mm)',)
        """
        return self._wrong_values() or self._wrong_sums()

    def _wrong_values(self) -> tuple[str, ...]:
        wrong = [
            f"{entry.name} must be above 0, not {getattr(self, entry.name):g}"
            for entry in fields(self)
            if entry.name not in ("chambers", "gap") and not getattr(self, entry.name) > 0.0
        ]
        wrong += [
            f"{entry.name} must be between {SMALLEST_MM:g} and {LARGEST_MM:g} mm, not {value:g}"
            for entry in fields(self)
            if entry.name != "chambers"
            and (value := getattr(self, entry.name)) > 0.0
            and not SMALLEST_MM <= value <= LARGEST_MM
        ]
        if not isinstance(self.chambers, int) or not 1 <= self.chambers <= MOST_CHAMBERS:
            wrong.append(
                f"chambers must be a whole number from 1 to {MOST_CHAMBERS}, not {self.chambers}"
            )
        if not self.gap >= 0.0:
            wrong.append(f"gap must not be below 0, not {self.gap:g}")
        return tuple(wrong)

    def _wrong_sums(self) -> tuple[str, ...]:
        dividers = (self.chambers - 1) * (2.0 * self.chamber_wall + self.gap)
        along = 2.0 * self.end_wall + dividers
        across, upward = 2.0 * self.side_wall, self.floor + self.roof
        wrong = []
        if along >= self.length:
            wrong.append(
                f"end walls, chamber walls and gaps ({along:g} mm) leave no chamber in the length "
                f"({self.length:g} mm)"
            )
        if across >= self.width:
            wrong.append(
                f"the two side walls ({across:g} mm) leave no chamber in the width "
                f"({self.width:g} mm)"
            )
        if upward >= self.height:
            wrong.append(
                f"floor and roof ({upward:g} mm) leave no chamber in the height "
                f"({self.height:g} mm)"
            )
        return tuple(wrong) or self._wrong_channel()

    def _wrong_channel(self) -> tuple[str, ...]:
        if self.chambers == 1:
            return ()
        wide, high = self.width - 2.0 * self.side_wall, self.height - self.floor - self.roof
        slot_bottom = self.floor + self.channel_height + self.channel_roof
        wrong = []
        if self.channel_width > wide:
            wrong.append(
                f"the channel ({self.channel_width:g} mm) is wider than the chambers ({wide:g} mm)"
            )
        if self.channel_height > high:
            wrong.append(
                f"the channel ({self.channel_height:g} mm) is higher than the chambers "
                f"({high:g} mm)"
            )
        elif self.gap > 0.0 and slot_bottom >= self.height:
            wrong.append(
                f"floor, channel and channel roof ({slot_bottom:g} mm) leave no slot in the height "
                f"({self.height:g} mm)"
            )
        return tuple(wrong)


@dataclass(frozen=True)
class Settings:
    """The contents of ``study.toml``, defaults filled in.

    Parameters
    ----------
    title : str
        Heading of the report; empty if not given.
    seed : int
        Seed from which every random number of the study comes.
    dimensions : Dimensions
        The actuator as moulded.
    paper_thickness_mm : float
        Thickness of the strain-limiting paper [mm].
    recipe : Recipe
        Parts by mass and densities of what films are poured of.
    priors : mapping of str to Law
        Only the priors that the study states; all other parameters keep theirs.
    degradation_sd_pct : float
        Standard error of a degradation rate where none is recorded [%].
    candidates : tuple of str, optional
        Causes to be tried; ``None`` for all.
    effort : {"quick", "standard", "thorough"}
        How much is spent on sampling.
    fit_modes : tuple of str
        Modes of loading whose tensile curves are fitted; others are held out and only predicted.
    order : int
        Order of the polynomials of the degradation rate that Yeoh's constants are, 0 to 3.
    virtual : bool
        Whether the data come from a virtual experiment.
    note : str
        Free text shown in the report.

    Examples
    --------
    >>> Settings().dimensions.chambers
    5
    """

    title: str = ""
    seed: int = 20211124
    dimensions: Dimensions = field(default_factory=Dimensions)
    paper_thickness_mm: float = 0.1
    recipe: Recipe = field(default_factory=Recipe)
    priors: Mapping[str, Law] = field(default_factory=dict)
    degradation_sd_pct: float = 1.0
    candidates: tuple[str, ...] | None = None
    effort: Effort = "standard"
    fit_modes: tuple[str, ...] = MODES
    order: int = 2
    virtual: bool = False
    note: str = ""
