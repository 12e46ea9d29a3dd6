"""The page of the study: one self-contained HTML file."""

import base64
from typing import Any

from jinja2 import Environment

_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,"><title>{{ title }}</title>
<style>
body { font: 16px/1.55 system-ui, sans-serif; max-width: 58rem; margin: 2rem auto; padding: 0 1rem;
  color: #1c2127; background: #fdfdfc }
.answer { font-size: 1.1rem; border-left: 4px solid #c2561a; padding-left: 1rem }
img { max-width: 100%; height: auto } figure { margin: 1.5rem 0 }
figcaption, .note { color: #555c65; font-size: .9rem }
.scroll { overflow-x: auto; margin: 1.5rem 0 }
table { border-collapse: collapse; font-size: .85rem }
caption { text-align: left; font-weight: 600; padding-bottom: .3rem }
th, td { padding: .25rem .7rem; border-bottom: 1px solid #dfe2e5; text-align: right;
  vertical-align: top }
th:first-child, td:first-child, th:last-child, td:last-child { text-align: left }
</style></head><body><main>
<h1>{{ title }}</h1>
<p>{{ source }} {% if quick %}<strong>Quick run: coarse mesh, few draws.</strong>{% endif %}</p>
<section aria-label="Answers">
{% for text in answers %}<p class="answer">{{ text }}</p>{% endfor %}
</section>
<section><h2>Figures</h2>
{% for figure in figures %}
<figure><img src="data:image/png;base64,{{ figure.image }}" alt="{{ figure.caption }}">
<figcaption>{{ figure.caption }}</figcaption></figure>
{% endfor %}</section>
<section><h2>Numbers</h2>
{% for table in tables %}
<div class="scroll" tabindex="0" role="group" aria-label="{{ table.title }}"><table>
<caption>{{ table.title }}</caption>
<thead><tr>{% for h in table.header %}<th scope="col">{{ h }}</th>{% endfor %}</tr></thead>
<tbody>{% for row in table.rows %}
<tr>{% for cell in row %}<td>{{ cell }}</td>{% endfor %}</tr>{% endfor %}</tbody></table></div>
{% endfor %}</section>
<section><h2>Assumptions</h2>
<ul>{% for text in assumptions %}<li>{{ text }}</li>{% endfor %}</ul></section>
<p class="note">Seed {{ seed }}.</p>
</main></body></html>
"""


def render(**content: Any) -> str:
    """Return the page; the names are those of the template."""
    return Environment(autoescape=True).from_string(_PAGE).render(**content)


def embed(png: bytes) -> str:
    """Return an image as text for the page."""
    return base64.b64encode(png).decode("ascii")
