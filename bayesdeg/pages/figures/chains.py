"""Figure of the chains: rank plots of the ensembles."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import rankdata

from bayesdeg.pages.drawing import MUTED, PageFigure, Shown, Sketch, level_colour, panels, styled
from bayesdeg.pages.folder import POSTERIOR
from bayesdeg.pages.wording import words

BINS = 10  # bins of ranks: 50 draws each at quick effort, or noise dominates
CHANCE = 3.0  # standard deviations of the number of draws in a bin: the band
MOST = 12  # parameters, those that mix worst


def rank_counts(draws: NDArray[np.float64], bins: int = BINS) -> NDArray[np.float64]:
    """Return the rank histogram of each chain, over the expected count of a bin.

    Chains that sample the same law have uniform ranks, so all counts are near 1. A shifted chain
    has a slope, one that is too narrow a hump.

    Parameters
    ----------
    draws : array, shape (n_chains, n_draws)
        Of one parameter.
    bins : int
        Into which the ranks of all draws together are divided.

    Returns
    -------
    array, shape (n_chains, bins)

    References
    ----------
    Vehtari, Gelman, Simpson, Carpenter and Bürkner (2021), doi:10.1214/20-BA1221

    Examples
    --------
    >>> rank_counts(np.array([[0.0, 1.0], [2.0, 3.0]]), bins=2)
    array([[2., 0.],
           [0., 2.]])
    """
    ranks = rankdata(draws, method="average").reshape(draws.shape) - 0.5
    place = np.minimum((ranks * bins / draws.size).astype(int), bins - 1)
    counts = np.stack([np.bincount(row, minlength=bins) for row in place])
    return np.asarray(counts * bins / draws.shape[1], np.float64)


@styled
def rank_figure(posterior: xr.Dataset) -> Figure:
    """Draw the ranks of the draws of each chain, one panel per parameter.

    Parameters
    ----------
    posterior : xarray.Dataset
        Draws by parameter, (chain, draw).
    """
    every = {str(name): rank_counts(values.to_numpy()) for name, values in posterior.items()}
    worst = sorted(every, key=lambda name: -float(np.abs(every[name] - 1.0).max()))[:MOST]
    figure, every_axes = panels(len(worst), columns=4, height=1.5)
    # draws of a chain are thinned, and so nearly independent
    width = CHANCE * np.sqrt(BINS / posterior.sizes["draw"])
    middle = (np.arange(BINS) + 0.5) / BINS
    for axes, name in zip(every_axes, [n for n in every if n in worst], strict=True):
        axes.axhspan(1.0 - width, 1.0 + width, color=MUTED, alpha=0.22, linewidth=0)
        for index, counts in enumerate(every[name]):
            colour = level_colour(index, len(every[name]))
            axes.step(middle, counts, where="mid", color=colour, linewidth=0.9)
        axes.set_title(words(name), fontsize=7.0)
        axes.set_xlim(0.0, 1.0)
        axes.set_ylim(bottom=0.0)
    figure.supxlabel("rank among the draws of all chains, normalised [–]", fontsize=8.0)
    figure.supylabel("draws, over their expected number [–]", fontsize=8.0)
    return figure


def _ranks(shown: Shown) -> Sketch | None:
    # updated draws do not come from chains
    posterior = shown.posterior(POSTERIOR) if shown.run.update is None else None
    if posterior is None or min(posterior.sizes.values(), default=0) < 2:
        return None
    facts = {
        "chains": posterior.sizes["chain"],
        "drawn": min(len(posterior), MOST),
        "parameters": len(posterior),
        "chance": CHANCE,
    }
    return Sketch(rank_figure(posterior), facts)


FIGURES = (
    PageFigure(
        "ranks",
        "posterior",
        _ranks,
        "Ranks of the draws of each of {{ chains }} chains among those of "
        "all, for the final model. If all chains sample the same posterior, every line stays near "
        "1; the band is {{ chance | number(1) }} standard deviations of independent draws. A "
        "sloping chain is shifted against the others, one with a hump is too narrow."
        "{% if drawn < parameters %} The {{ drawn }} of {{ parameters }} parameters that depart "
        "most are drawn.{% endif %}",
        title="Do the chains agree?",
    ),
)
