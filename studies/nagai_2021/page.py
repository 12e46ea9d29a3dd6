"""Figures and the page of the answers."""

import base64
import io
from typing import Any

import numpy as np
from jinja2 import Environment
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from nagai_2021.agreement import MODELS, TARGET
from nagai_2021.published import LEVELS
from nagai_2021.rupture import Walls

Floats = NDArray[np.float64]

COLOURS = ("#7a7f87", "#c2561a", "#1f6fb2", "#14724f")
QUANTILES = (0.05, 0.5, 0.95)

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,"><title>{{ title }}</title>
<style>
body { font: 16px/1.55 system-ui, sans-serif; max-width: 56rem; margin: 2rem auto; padding: 0 1rem;
  color: #1c2127; background: #fdfdfc }
.answer { font-size: 1.15rem; border-left: 4px solid #c2561a; padding-left: 1rem }
img { max-width: 100%; height: auto } figure { margin: 1.5rem 0 }
figcaption, .note { color: #555c65; font-size: .9rem }
.scroll { overflow-x: auto } table { border-collapse: collapse; font-size: .9rem }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #dfe2e5; text-align: right }
th:first-child, td:first-child { text-align: left }
</style></head><body><main>
<h1>{{ title }}</h1>
<p>Nagai, Kurita, Shintake (2021), Front. Robot. AI 8:760485,
<a href="https://doi.org/10.3389/frobt.2021.760485">doi:10.3389/frobt.2021.760485</a>.
Nothing but numbers stated in its text is used; none of its curves is.
{% if quick %}<strong>Quick run: few draws.</strong>{% endif %}</p>
{% for part in parts %}
<section><h2>{{ part.question }}</h2>
<p class="answer">{{ part.answer }}</p>
{% for text in part.texts %}<p>{{ text }}</p>{% endfor %}
{% if part.image %}<figure>
<img src="data:image/png;base64,{{ part.image }}" alt="{{ part.caption }}">
<figcaption>{{ part.caption }}</figcaption></figure>{% endif %}
{% for table in part.tables %}
<div class="scroll" tabindex="0" role="group" aria-label="{{ table.title }}"><table>
<caption>{{ table.title }}</caption>
<thead><tr>{% for h in table.header %}<th scope="col">{{ h }}</th>{% endfor %}</tr></thead>
<tbody>{% for row in table.rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</tbody></table></div>
{% endfor %}
<h3>Assumptions</h3><ul>{% for text in part.assumptions %}<li>{{ text }}</li>{% endfor %}</ul>
</section>{% endfor %}
<p class="note">Seed {{ seed }}, {{ draws }} draws of the material.</p>
</main></body></html>
"""


def render(**content: Any) -> str:
    """Return the page; the names are those of the template."""
    return Environment(autoescape=True).from_string(_PAGE).render(**content)


def embed(png: bytes) -> str:
    """Return an image as text for the page."""
    return base64.b64encode(png).decode("ascii")


def agreement_figure(samples: dict[str, Floats], required: Floats) -> bytes:
    """Draw R² by model against those published, and the D_R error that each would need.

    Parameters
    ----------
    samples : dict of array, shape (n, 6)
        Draws of ln(1 − R²) from the posterior of each model.
    required : array, shape (n, 6)
        Size of the D_R error that gives the published R² [points].
    """
    figure = Figure(figsize=(9.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for i, (name, colour) in enumerate(zip(MODELS, COLOURS, strict=True)):
        low, middle, high = np.exp(np.quantile(samples[name], QUANTILES, axis=0))
        at = LEVELS + 0.6 * (i - 1.5)
        left.vlines(at, low, high, color=colour, lw=3, alpha=0.55, label=name)
        left.plot(at, middle, "_", color=colour, ms=7, mew=2)
    left.plot(LEVELS, np.exp(TARGET), "kD", ms=5, label="published", zorder=5)
    left.set(yscale="log", ylabel="1 − R²  [–]", xticks=LEVELS)
    left.set_title("R² by the posterior of each model")
    left.legend(fontsize=8, frameon=False, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.15))
    degraded = slice(1, None)
    low, middle, high = np.nanquantile(required[:, degraded], QUANTILES, axis=0)
    right.errorbar(
        LEVELS[degraded],
        middle,
        (middle - low, high - middle),
        fmt="o",
        color=COLOURS[1],
        capsize=4,
    )
    right.set(ylabel="error of $D_R$  [points]", ylim=(0, None), xticks=LEVELS[degraded])
    right.set_title("error of $D_R$ needed if nothing else acts")
    _finish(left, right)
    return _png(figure)


def rupture_figure(walls: Walls, probabilities: dict[str, float]) -> bytes:
    """Draw the elongation demanded at 240 kPa against its limit; the probability of the counts."""
    figure = Figure(figsize=(9.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2, 2.4))
    limits = {"limit of the films": walls.limit}
    for i, (name, values) in enumerate({**limits, **walls.demand}.items()):
        low, middle, high = 100.0 * np.quantile(values, QUANTILES, axis=0)
        colour = ("#1c2127", *COLOURS[1:])[i]
        left.fill_between(LEVELS, low, high, color=colour, alpha=0.15, lw=0)
        width = 2.5 if i == 0 else 1.5
        left.plot(LEVELS, middle, color=colour, lw=width, label=name.replace("_", " "))
    left.set(yscale="log", ylabel="elongation, uniaxial equivalent  [%]", xticks=LEVELS)
    left.set(title="demand at 240 kPa and limit")
    left.set_yticks([10, 20, 50, 100, 200], ["10", "20", "50", "100", "200"])
    left.legend(fontsize=8, frameon=False, loc="lower left")
    _finish(left)
    names = list(probabilities)
    values = np.maximum(list(probabilities.values()), 1e-8)
    colours = [COLOURS[3] if "flaws" in name else COLOURS[1] for name in names]
    right.barh(names, values, color=colours, height=0.65)
    right.set(xscale="log", xlim=(1e-8, 1), xlabel="probability of 0, 0, 0, 0, 0, 2 of 3  [–]")
    right.axvline(4.0 / 9.0, color="#1c2127", ls=":", lw=1)
    right.set_title("how probable the published counts are")
    right.invert_yaxis()
    right.tick_params(axis="y", labelsize=7.5)
    right.spines[["top", "right"]].set_visible(False)
    return _png(figure)


def _finish(*panels: Axes) -> None:
    for axes in panels:
        axes.set_xlabel("degradation rate $D_R$  [%]")
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.2)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150)
    return buffer.getvalue()
