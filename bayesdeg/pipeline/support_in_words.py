"""What speaks for the causes that the evidence favours, in plain words."""

from bayesdeg.criticism.discrepancy import MISFIT_LEVEL
from bayesdeg.criticism.support import Support
from bayesdeg.pipeline.judgement import Judgement

FEW_ERRORS = 2.0  # standard errors within which a gain may as well be nothing


def directed(judgement: Judgement) -> str:
    """Say what named where the misfit as a whole does not show it: a test with a p-value each.

    Empty where the misfit as a whole shows it too.
    """
    known = [(one.cause, one.chance) for one in judgement.supported if one.chance is not None]
    if not known or not judgement.misfit.p_value > MISFIT_LEVEL:  # nan where not calibrated
        return ""
    shares = " and ".join(f"p = {p:.2g} in data simulated without {name}" for name, p in known)
    return (
        "What names is a test directed at the candidates, which sees what the misfit as a whole, "
        "measured without a candidate in mind, does not: by chance the best of them gains as much "
        f"evidence with {shares}."
    )


def gains(judgement: Judgement) -> list[str]:
    """Say what each favoured cause adds to the prediction of what was left out, and all of them."""
    known = [one for one in judgement.supported if one.elpd_diff is not None]
    several = len(judgement.supported) > 1
    found = [_gain(one, several=several) for one in known]
    together = known[0].together if known else None
    if several and together is not None:
        found.append(f"All of them together raise it by {together[0]:.1f} ± {together[1]:.1f}.")
    return found


def predicted_with(judgement: Judgement) -> str:
    """Say with which of the causes that cannot be told apart predictions are made."""
    used = judgement.predicted_with
    if not used:
        return ""
    return (
        f"Bands, ruptures and decisions are predicted with {' and '.join(used)}, one of "
        "the possible answers; the others may predict differently where nothing was measured."
    )


def _gain(one: Support, *, several: bool) -> str:
    gain, error = one.elpd_diff or 0.0, one.elpd_diff_se or 0.0
    beside = " beside the others" if several else ""
    text = (
        f"What was left out of the calibration in turn is predicted better with {one.cause}"
        f"{beside} by {gain:.1f} ± {error:.1f} in log density"
    )
    if several and abs(gain) < FEW_ERRORS * error:
        text += (
            ", which is within two standard errors of nothing: held-out specimens neither confirm "
            f"nor contradict {one.cause} by itself"
        )
    return f"{text}."
