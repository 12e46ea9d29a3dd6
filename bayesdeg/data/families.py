"""Families of actuators: constraint layers, and segments with channels.

The dimensions of a pneunet are `bayesdeg.data.settings.Dimensions`.
"""

from dataclasses import dataclass, field, fields
from math import hypot, isfinite, pi, sqrt
from typing import Literal, Protocol, get_args

Kind = Literal["pneunet", "ribbed", "cylindrical", "mesh"]
ConstraintKind = Literal["paper", "film", "elastomer", "none"]
StressUnit = Literal["MPa", "kPa"]
Passive = Literal["open", "pressurised", "solid", "none"]
Section = Literal["block", "round"]

KINDS: tuple[Kind, ...] = get_args(Kind)
CONSTRAINTS: tuple[ConstraintKind, ...] = get_args(ConstraintKind)
PASSIVES: tuple[Passive, ...] = get_args(Passive)
SECTIONS: tuple[Section, ...] = get_args(Section)

#: Limits of a dimension [mm] and of the number of chambers; no mesh can be made beyond them.
SMALLEST_MM, LARGEST_MM, MOST_CHAMBERS = 1e-3, 2000.0, 200
#: Share of a round section's radius up to which channels may reach; thinner material cannot be
#: meshed.
INSIDE_ROUND = 0.97


READ = {"is_read": True}
"""Fields that are not keys of ``study.toml``, since they follow from a file."""


class Mould(Protocol):
    """The dimensions of an actuator of any family, all in mm."""

    @property
    def kind(self) -> Kind:
        """The family."""

    @property
    def length(self) -> float:
        """Outer length [mm]."""

    @property
    def width(self) -> float:
        """Outer width [mm]."""

    @property
    def height(self) -> float:
        """Outer height [mm]."""

    @property
    def constraint_room(self) -> tuple[float, float]:
        """Heights between which a layer runs through solid material [mm]."""

    @property
    def usual_height(self) -> float:
        """Default height of the constraint layer [mm]."""

    @property
    def beam_bending(self) -> float:
        """Bend angle over p/C1 of a beam of this section, without bulging walls [rad]."""

    def problems(self) -> tuple[str, ...]:
        """Say why no actuator can have these dimensions.

        For each reason what is wrong and, after a semicolon, what to do; empty if possible.
        """


@dataclass(frozen=True)
class Constraint:
    """The inextensible layer that makes the actuator bend under pressure.

    Parameters
    ----------
    kind : {"paper", "film", "elastomer", "none"}
        Paper and film are the same membrane with its bending stiffness. An elastomer is a slab of
        a different material in place of the actuator's own, bonded to it. With none, no layer
        limits stretch; the curvature is still read along that plane.
    height : float, optional
        Height of its mid-plane above the bottom [mm]; by default the layer lies on the bottom, or
        in the middle of an actuator with two halves.
    thickness : float
        Of an elastomer slab [mm]; a membrane's is that of the paper.
    c1, c2, c3 : float
        Yeoh constants of an elastomer [kPa].

    Examples
    --------
    >>> Constraint("film", height=9.25).height
    9.25
    """

    kind: ConstraintKind = "paper"
    height: float | None = None
    thickness: float = 0.0
    c1: float = 0.0
    c2: float = 0.0
    c3: float = 0.0

    @property
    def is_there(self) -> bool:
        """Whether there is a layer."""
        return self.kind != "none"

    @property
    def is_membrane(self) -> bool:
        """Whether it is a membrane."""
        return self.kind in ("paper", "film")

    @property
    def is_slab(self) -> bool:
        """Whether it is an elastomer slab of finite thickness."""
        return self.kind == "elastomer"

    @property
    def constants(self) -> tuple[float, float, float]:
        """Yeoh constants of an elastomer [MPa]."""
        return 1e-3 * self.c1, 1e-3 * self.c2, 1e-3 * self.c3

    def height_in(self, mould: Mould) -> float:
        """Return the height of the plane in an actuator [mm].

        Examples
        --------
        >>> Constraint().height_in(RibbedDimensions())
        9.25
        """
        if self.height is not None:
            return self.height
        return max(mould.usual_height, 0.5 * self.thickness if self.is_slab else 0.0)

    def slab_in(self, mould: Mould) -> tuple[float, float]:
        """Return the heights of the lower and the upper face of a slab [mm].

        Examples
        --------
        >>> Constraint("elastomer", thickness=1.0, c1=60.0).slab_in(RibbedDimensions())
        (8.75, 9.75)
        """
        middle = self.height_in(mould)
        return middle - 0.5 * self.thickness, middle + 0.5 * self.thickness

    def problems(self, mould: Mould) -> tuple[str, ...]:
        """Say why the layer does not fit in an actuator of these valid dimensions.

        What is wrong and, after a semicolon, what to do; empty if it fits.

        Examples
        --------
        >>> Constraint(height=13.0).problems(RibbedDimensions())[0].partition("; ")[2]
        'give [constraint] height from 8.75 to 9.75 mm'
        """
        low, high = mould.constraint_room
        if not self.is_slab:
            at = self.height_in(mould)
            if low <= at <= high:
                return ()
            return (
                f"the constraint layer at {at:g} mm would cut the channels or leave the actuator; "
                f"give [constraint] height from {low:g} to {high:g} mm",
            )
        wrong, slack = self._wrong_constants(), 1e-9
        bottom, top = self.slab_in(mould)
        if wrong or (low - slack <= bottom and top <= high + slack):
            return wrong
        return (
            f"an elastomer layer from {bottom:g} to {top:g} mm would cut the channels or "
            "leave the actuator; choose [constraint] height and thickness so that it "
            f"lies between {low:g} and {high:g} mm",
        )

    def _wrong_constants(self) -> tuple[str, ...]:
        """Say what is wrong with an elastomer; as in the body, ∂W/∂I₁ > 0 at every strain."""
        if not (isfinite(self.thickness) and self.thickness >= SMALLEST_MM):
            return (
                f"an elastomer layer {self.thickness:g} mm thick is too thin; "
                f"give [constraint] thickness of at least {SMALLEST_MM:g} mm",
            )
        if not (isfinite(self.c1) and self.c1 > 0.0):
            return (
                f"an elastomer layer with C1 = {self.c1:g} kPa has no stiffness; give C1 above 0",
            )
        lowest = -sqrt(3.0 * self.c1 * max(self.c3, 0.0))
        if self.c3 >= 0.0 and (self.c2 >= 0.0 or self.c2 > lowest):
            return ()
        return (
            f"an elastomer with C2 = {self.c2:g} and C3 = {self.c3:g} kPa loses all stiffness when "
            f"stretched; give C3 of at least 0 and C2 above {lowest:g} kPa",
        )


@dataclass(frozen=True)
class RibbedDimensions:
    """Dimensions of a ribbed segment as moulded, before shrinkage; all lengths in mm.

    A block with rectangular slits across, joined by passages along its middle. The defaults are
    those of the ribbed segment of Marchese, Katzschmann and Rus, doi:10.1089/soro.2014.0022, as far
    as stated.

    Parameters
    ----------
    length, width, height : float
        Outer length, width and height, including both halves [mm].
    channels : int
        Number of slits in a row, centred along the length.
    channel_length, channel_width, channel_height : float
        One slit: along and across the actuator, and its depth [mm].
    pitch : float
        From one slit to the next [mm]. The default leaves ribs of 1.76 mm, one of the factors in
        the authors' sum of the cavity, which does not say which dimension it is: assumed.
    cover : float
        Material over the slits [mm]; not stated by the authors. The default is what remains with a
        centre layer of 1 mm onto which the slits open: assumed.
    passage_width, passage_height : float
        The passages through the ribs, on the floor of the slits [mm]; which factor is which, and
        their place on the floor, are assumed.
    passive : {"open", "pressurised", "solid", "none"}
        The other half, a mirror image: its channels open to the air, under the same pressure,
        or absent (solid); or no other half.

    Examples
    --------
    >>> RibbedDimensions().problems()
    ()
    >>> round(RibbedDimensions().end_wall, 9), round(RibbedDimensions().floor, 9)
    (1.84, 9.75)
    """

    length: float = 37.8
    width: float = 32.0
    height: float = 18.5
    channels: int = 13
    channel_length: float = 1.0
    channel_width: float = 25.4
    channel_height: float = 3.1
    pitch: float = 2.76
    cover: float = 5.65
    passage_width: float = 0.65
    passage_height: float = 1.34
    passive: Passive = "open"

    @property
    def kind(self) -> Kind:
        """The family."""
        return "ribbed"

    @property
    def is_mirrored(self) -> bool:
        """Whether the other half has channels too."""
        return self.passive in ("open", "pressurised")

    @property
    def end_wall(self) -> float:
        """Material before the first and after the last slit [mm]."""
        return 0.5 * (self.length - self._row)

    @property
    def side_wall(self) -> float:
        """Material beside the slits [mm]."""
        return 0.5 * (self.width - self.channel_width)

    @property
    def floor(self) -> float:
        """Height of the floor of the slits above the bottom [mm]."""
        return self.height - self.cover - self.channel_height

    @property
    def usual_height(self) -> float:
        """Default height of the constraint layer: the middle, or the bottom [mm]."""
        return 0.0 if self.passive == "none" else 0.5 * self.height

    @property
    def constraint_room(self) -> tuple[float, float]:
        """Heights between which a layer runs through solid material [mm]."""
        return (self.cover + self.channel_height if self.is_mirrored else 0.0), self.floor

    @property
    def beam_bending(self) -> float:
        r"""Bend angle over p/C1 of a beam of the section through a slit [rad].

        .. math:: \theta = \frac{p A z_c}{6 C_1 I} n l, \qquad I = \int z^2 dA

        with A and :math:`z_c` the cross-section of a slit and the height of its middle above the
        default plane of the constraint, which does not stretch; n slits of length l bend, ribs do
        not.
        """
        plane, top, low = self.usual_height, self.height - self.cover, self.floor
        whole = self.width * ((self.height - plane) ** 3 + plane**3) / 3.0
        slits = 2 if self.is_mirrored else 1
        air = slits * self.channel_width * ((top - plane) ** 3 - (low - plane) ** 3) / 3.0
        moment = self.channel_width * (top - low) * (0.5 * (top + low) - plane)
        return moment / (6.0 * (whole - air)) * self.channels * self.channel_length

    @property
    def _row(self) -> float:
        return (self.channels - 1) * self.pitch + self.channel_length

    def problems(self) -> tuple[str, ...]:
        """Say why no actuator can have these dimensions, see `Mould.problems`.

        Examples
        --------
        >>> RibbedDimensions(cover=7.0).problems()[0].partition("; ")[2]
        'give a smaller cover or channel_height'
        """
        wrong = _wrong_values(self)
        if wrong:
            return tuple(wrong)
        if self.channels > 1 and self.channel_length >= self.pitch:
            wrong.append(
                f"slits {self.channel_length:g} mm long leave no ribs at a pitch of "
                f"{self.pitch:g} mm; give a smaller channel_length or a larger pitch"
            )
        elif self._row >= self.length:
            wrong.append(
                f"{self.channels} slits at a pitch of {self.pitch:g} mm take {self._row:g} mm and "
                f"leave no end walls in the length ({self.length:g} mm); "
                "give fewer channels, a smaller pitch or a larger length"
            )
        if self.channel_width >= self.width:
            wrong.append(
                f"slits {self.channel_width:g} mm wide leave no side walls in the width "
                f"({self.width:g} mm); give a smaller channel_width or a larger width"
            )
        room = 0.5 * self.height if self.is_mirrored else self.height
        if self.cover + self.channel_height >= room:
            half = "half height" if self.is_mirrored else "height"
            wrong.append(
                f"cover and slits ({self.cover + self.channel_height:g} mm) leave nothing under "
                f"the slits in the {half} ({room:g} mm); "
                "give a smaller cover or channel_height"
            )
        if not wrong and self.channels > 1:
            sides = {
                "width": (self.passage_width, self.channel_width),
                "height": (self.passage_height, self.channel_height),
            }
            wrong = [
                f"passage_{side} of {passage:g} mm exceeds the slits' {slit:g} mm; "
                f"give at most channel_{side}"
                for side, (passage, slit) in sides.items()
                if passage > slit
            ]
        return tuple(wrong)


@dataclass(frozen=True)
class CylindricalDimensions:
    """Dimensions of a segment with straight channels beside its axis, as moulded; lengths in mm.

    A block, or a round bar, with rectangular channels along it, side by side over the middle of its
    width, closed at both ends. The defaults are those of the cylindrical segment of Marchese,
    Katzschmann and Rus, doi:10.1089/soro.2014.0022, as far as stated.

    Parameters
    ----------
    length, width, height : float
        Outer length, width and height, including both halves [mm].
    channels : int
        Number of channels side by side in a half.
    channel_length, channel_width, channel_height : float
        One channel, in the middle of the length [mm].
    pitch : float
        From the middle of one channel to that of the next [mm]; unused for a single channel.
    offset : float
        Height of the channels' middle above the default plane of the constraint layer: the middle,
        or the bottom of an actuator with one half [mm]. Not stated by the authors; the default
        puts the channel in the middle of its half: assumed.
    passive : {"open", "pressurised", "solid", "none"}
        The other half, a mirror image: its channels open to the air, under the same pressure,
        or absent (solid); or no other half, which a round section does not allow.
    section : {"block", "round"}
        Outline across the length: a rectangle, or the ellipse of this width and height; a circle
        where they are the same.

    Examples
    --------
    >>> d = CylindricalDimensions()
    >>> d.problems()
    ()
    >>> round(d.channel_length * d.channel_width * d.channel_height, 1)  # of a half [mm³]
    313.6
    """

    length: float = 61.2
    width: float = 33.5
    height: float = 19.6
    channels: int = 1
    channel_length: float = 40.0
    channel_width: float = 2.8
    channel_height: float = 2.8
    pitch: float = 5.6
    offset: float = 4.9
    passive: Passive = "open"
    section: Section = "block"

    @property
    def kind(self) -> Kind:
        """The family."""
        return "cylindrical"

    @property
    def is_round(self) -> bool:
        """Whether its outline is an ellipse."""
        return self.section == "round"

    @property
    def is_mirrored(self) -> bool:
        """Whether the other half has channels too."""
        return self.passive in ("open", "pressurised")

    @property
    def end_wall(self) -> float:
        """Material before and after the channels [mm]."""
        return 0.5 * (self.length - self.channel_length)

    @property
    def floor(self) -> float:
        """Height of the lower face of the channels above the bottom [mm]."""
        return self.usual_height + self.offset - 0.5 * self.channel_height

    @property
    def cover(self) -> float:
        """Material over the channels [mm]."""
        return self.height - self.floor - self.channel_height

    @property
    def usual_height(self) -> float:
        """Default height of the constraint layer: the middle, or the bottom [mm]."""
        return 0.0 if self.passive == "none" else 0.5 * self.height

    @property
    def constraint_room(self) -> tuple[float, float]:
        """Heights between which a layer runs through solid material [mm]."""
        low = self.is_mirrored or self.is_round
        return (self.height - self.floor if low else 0.0), self.floor

    @property
    def channel_middles(self) -> tuple[float, ...]:
        """Lateral positions of the channels' middles, from the middle of the width [mm].

        Examples
        --------
        >>> CylindricalDimensions(channels=3).channel_middles
        (-5.6, 0.0, 5.6)
        """
        return tuple(self.pitch * (k - 0.5 * (self.channels - 1)) for k in range(self.channels))

    @property
    def beam_bending(self) -> float:
        r"""Bend angle over p/C1 of a beam bent by the pressure on the channels' ends [rad].

        .. math:: \theta = \frac{p A z_c}{6 C_1 I} l, \qquad I = \int z^2 dA

        with A and :math:`z_c` the cross-section of the channels and the height of their middle
        above the default plane of the constraint, which does not stretch, and l their length. It
        is an order of magnitude: walls widened by a channel get shorter, which in an
        incompressible block cancels it all to first order, so a segment hardly bends until its
        channels balloon.
        """
        plane, deep = self.usual_height, 0.5 * self.channel_height
        whole = self.width * ((self.height - plane) ** 3 + plane**3) / 3.0
        if self.is_round:
            whole = pi * self.width * self.height**3 / 64.0
        rows, across = 2 if self.is_mirrored else 1, self.channels * self.channel_width
        air = rows * across * ((self.offset + deep) ** 3 - (self.offset - deep) ** 3) / 3.0
        moment = across * self.channel_height * self.offset
        return moment / (6.0 * (whole - air)) * self.channel_length

    @property
    def _row(self) -> float:
        return (self.channels - 1) * self.pitch + self.channel_width

    def problems(self) -> tuple[str, ...]:
        """Say why no actuator can have these dimensions, see `Mould.problems`.

        Examples
        --------
        >>> CylindricalDimensions(channel_length=70.0).problems()[0].partition("; ")[2]
        'give a smaller channel_length or a larger length'
        """
        return tuple(_wrong_values(self)) or self._wrong_places() or self._wrong_outline()

    def _wrong_outline(self) -> tuple[str, ...]:
        if self.section not in SECTIONS:
            return (f"section is {self.section!r}; give one of {', '.join(SECTIONS)}",)
        if not self.is_round:
            return ()
        if self.passive == "none":
            return (
                "a round section needs both halves, but passive is 'none'; "
                'give passive = "solid", or section = "block"',
            )
        across, up = 0.5 * self._row, self.offset + 0.5 * self.channel_height
        if hypot(across / (0.5 * self.width), up / (0.5 * self.height)) <= INSIDE_ROUND:
            return ()
        return (
            f"a corner of the channels, {across:g} mm beside and {up:g} mm above the axis, lies "
            f"outside the round section of {self.width:g} by {self.height:g} mm; give fewer or "
            "smaller channels, a smaller offset, or a larger width and height",
        )

    def _wrong_places(self) -> tuple[str, ...]:
        wrong = []
        if self.channel_length >= self.length:
            wrong.append(
                f"channels {self.channel_length:g} mm long leave no end walls in the length "
                f"({self.length:g} mm); give a smaller channel_length or a larger length"
            )
        if self.channels > 1 and self.channel_width >= self.pitch:
            wrong.append(
                f"channels {self.channel_width:g} mm wide leave no walls between them at a pitch "
                f"of {self.pitch:g} mm; give a smaller channel_width or a larger pitch"
            )
        elif self._row >= self.width:
            wrong.append(
                f"{self.channels} channels take {self._row:g} mm across and do not fit in the "
                f"width ({self.width:g} mm); give fewer or narrower channels, a smaller pitch or a "
                "larger width"
            )
        lowest, room = 0.5 * self.channel_height, self.height - self.usual_height
        if self.offset <= lowest:
            wrong.append(
                f"channels {self.channel_height:g} mm high, centred {self.offset:g} mm above the "
                f"plane of the constraint, cut it; give an offset above {lowest:g} mm"
            )
        if self.offset + lowest >= room:
            wrong.append(
                f"channels {self.channel_height:g} mm high, centred {self.offset:g} mm above the "
                f"plane of the constraint, do not fit in the {room:g} mm above it; "
                "give a smaller offset or channel_height, or a larger height"
            )
        return tuple(wrong)


UNKNOWN_MESH_ERROR = 0.05
"""Relative error assumed for a mesh of unknown error: about that of the coarse meshes of ribbed
segments, 5 %; the default actuator's fine mesh has 0.65 %."""


@dataclass(frozen=True)
class MeshDimensions:
    """A part meshed by the user; all lengths in mm.

    Parameters
    ----------
    file : str
        Of the mesh, next to ``study.toml``: Gmsh (.msh), Abaqus (.inp) or VTU, of hexahedra or of
        tetrahedra.
    mesh_error : float
        Relative standard error of curvatures and volumes due to element size, as a finer mesh
        shows it [–]. By default assumed.
    length, width, height : float
        Outer size of the part, as read [mm].
    plane : float
        Height of the constraint, as read [mm].
    bending : float
        See `beam_bending`, as read.
    cells : str
        Cell type, hexahedra or tetrahedra, as read.
    path, content : str
        Path and hash of the file.

    Examples
    --------
    >>> MeshDimensions().problems()[0].partition("; ")[2]
    'give file = "part.msh", a mesh next to study.toml'
    """

    file: str = ""
    mesh_error: float = UNKNOWN_MESH_ERROR
    length: float = field(default=0.0, metadata=READ)
    width: float = field(default=0.0, metadata=READ)
    height: float = field(default=0.0, metadata=READ)
    plane: float = field(default=0.0, metadata=READ)
    bending: float = field(default=0.0, metadata=READ)
    cells: str = field(default="", metadata=READ)
    path: str = field(default="", metadata=READ)
    content: str = field(default="", metadata=READ)

    @property
    def kind(self) -> Kind:
        """The family."""
        return "mesh"

    @property
    def assumption(self) -> str:
        """The assumption about the mesh, as a sentence; empty where its error is stated."""
        if self.mesh_error != UNKNOWN_MESH_ERROR:
            return ""
        return (
            f"the error of {self.file} is not known and is assumed to be "
            f"{100.0 * UNKNOWN_MESH_ERROR:g} %: solve a finer mesh, and give the difference "
            "as [actuator] mesh_error"
        )

    @property
    def usual_height(self) -> float:
        """Height of the constraint layer, from the mesh [mm]."""
        return self.plane

    @property
    def constraint_room(self) -> tuple[float, float]:
        """Heights at which the constraint layer can lie: only that of the mesh [mm]."""
        return self.plane, self.plane

    @property
    def beam_bending(self) -> float:
        """Bend angle over p/C1 of a beam of the mean section [rad]."""
        return self.bending

    def problems(self) -> tuple[str, ...]:
        """Say why no actuator can have these dimensions."""
        if not self.file:
            return ('no mesh is given; give file = "part.msh", a mesh next to study.toml',)
        if not 0.0 < self.mesh_error < 1.0:
            return (f"mesh_error is {self.mesh_error:g}; give a fraction between 0 and 1",)
        return ()


def _wrong_values(mould: RibbedDimensions | CylindricalDimensions) -> list[str]:
    lengths = [e.name for e in fields(mould) if e.name not in ("channels", "passive", "section")]
    wrong = [
        f"{name} is {value:g} mm; give {SMALLEST_MM:g} to {LARGEST_MM:g} mm"
        for name in lengths
        if not (isfinite(value := getattr(mould, name)) and SMALLEST_MM <= value <= LARGEST_MM)
    ]
    if not isinstance(mould.channels, int) or not 1 <= mould.channels <= MOST_CHAMBERS:
        wrong.append(f"channels is {mould.channels}; give a whole number from 1 to {MOST_CHAMBERS}")
    if mould.passive not in PASSIVES:
        wrong.append(f"passive is {mould.passive!r}; give one of {', '.join(PASSIVES)}")
    return wrong
