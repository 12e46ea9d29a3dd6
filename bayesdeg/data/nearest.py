"""The known word that a misspelt one was probably meant to be."""

from collections.abc import Iterable
from difflib import get_close_matches


def nearest(word: str, known: Iterable[str], *, cutoff: float = 0.6) -> str | None:
    """Find the known word most like the given one, upper and lower case being the same.

    Parameters
    ----------
    word : str
        The word as it stands.
    known : iterable of str
        What it may have been meant to be.
    cutoff : float
        Least similarity in the sense of `difflib.SequenceMatcher.ratio`.

    Returns
    -------
    str or None
        ``None`` if nothing is similar enough.

    Examples
    --------
    >>> nearest("uniaxal", ["uniaxial", "planar"])
    'uniaxial'
    >>> nearest("shear", ["uniaxial", "planar"]) is None
    True
    """
    by_folded = {entry.casefold(): entry for entry in known}
    matches = get_close_matches(word.casefold(), list(by_folded), n=1, cutoff=cutoff)
    return by_folded[matches[0]] if matches else None


def use_one_of(word: str, known: Iterable[str]) -> str:
    """Word the remedy for a word that is not among the known ones.

    Parameters
    ----------
    word : str
        The word as it stands.
    known : iterable of str
        What may stand there.

    Returns
    -------
    str
        A suggestion if there is one, and always the whole list.

    Examples
    --------
    >>> use_one_of("uniaxal", ["uniaxial", "planar"])
    "did you mean 'uniaxial'? One of uniaxial, planar must stand here"
    >>> use_one_of("biaxial", ["uniaxial", "equibiaxial"])
    "did you mean 'equibiaxial'? One of uniaxial, equibiaxial must stand here"
    """
    known = tuple(known)
    longer = [entry for entry in known if len(word) > 2 and word.casefold() in entry.casefold()]
    best = longer[0] if longer else nearest(word, known)
    suggestion = f"did you mean {best!r}? One of" if best else "one of"
    return f"{suggestion} {', '.join(known)} must stand here"
