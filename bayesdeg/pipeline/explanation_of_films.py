"""What a verdict on films says of modes of tension, in plain words."""

from bayesdeg.criticism.gain import mode_table
from bayesdeg.criticism.held_out import HeldOut
from bayesdeg.criticism.model_readings import ModelReadings
from bayesdeg.criticism.subject import Subject

ANY_CURVE = "any stress–stretch curve in one mode of tension is that of some energy in I₁ alone"


def one_mode(names: str) -> str:
    """Say why a misfit in a single mode names nothing.

    Parameters
    ----------
    names : str
        What it may be, as a list in words.
    """
    return (
        f"It may be {names}, or no more than the form of the law: {ANY_CURVE}, so these films "
        "cannot tell them apart, and nothing is named."
    )


def hidden(names: tuple[str, ...]) -> str:
    """Say which causes a single mode would not have shown; empty if there is none.

    Examples
    --------
    >>> hidden(())
    ''
    >>> hidden(("second_invariant", "stress_measure"))[:57]
    'Whether second_invariant or stress_measure acts these fil'
    """
    if not names:
        return ""
    return f"Whether {' or '.join(names)} acts these films cannot show: {ANY_CURVE}."


def by_mode(subject: Subject, held_out: dict[str, HeldOut]) -> str:
    """Say how far predictions of modes that were left out are off, before and after.

    Parameters
    ----------
    subject : Subject
        The base model.
    held_out : dict of str to HeldOut
        The base model first, the one with all that is named last.

    Returns
    -------
    str
        Empty where no whole modes were held out, or nothing was added.
    """
    whole = isinstance(subject, ModelReadings) and subject.holds_out_modes
    if not whole or len(held_out) < 2:
        return ""
    ends = {name: held_out[name] for name in (next(iter(held_out)), list(held_out)[-1])}
    error = mode_table(subject, ends).pivot(index="mode", columns="model", values="rmse_MPa")
    said = [
        f"{mode} {row.iloc[0]:.3f} → {row.iloc[1]:.3f} MPa"
        for mode, row in error[list(ends)].iterrows()
    ]
    return (
        "Each mode of tension predicted from the others, the root mean square error goes "
        f"{', '.join(said)}."
    )
