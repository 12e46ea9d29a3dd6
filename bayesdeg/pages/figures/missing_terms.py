"""What a misfit looks like that no cause accounts for: readings, and the term that fits them."""

from bayesdeg.pages.drawing import PageFigure, Shown, Sketch
from bayesdeg.pages.figures.criticism import discrepancy_figure
from bayesdeg.pages.summaries import BASE


def _missing_terms(shown: Shown) -> Sketch | None:
    readings, terms = shown.tables["missing_terms_readings"], shown.tables["missing_terms"]
    if readings is None or terms is None:
        return None
    rows = readings.rename(columns={"term": "discrepancy"}).assign(model=BASE)
    taken = terms.loc[terms["behind"].notna() & terms["share"].notna(), "formula"].astype(str)
    figure = discrepancy_figure(
        rows,
        degrades=shown.run.degrades,
        line="the term" if len(taken) == 1 else "both terms",
        points="measured less model",
    )
    return Sketch(figure, {"terms": list(taken)})


FIGURES = (
    PageFigure(
        "missing-terms",
        "misfit",
        _missing_terms,
        "Residuals of the model, fitted jointly with the terms that would remove them: "
        "{{ terms | join(' and ') }}.",
        ("missing_terms_readings", "missing_terms"),
    ),
)
