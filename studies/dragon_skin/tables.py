"""Tables of the results, for the page and the terminal."""

from typing import Any

from rich.console import Console
from rich.table import Table

from dragon_skin.causes import CAUSES
from dragon_skin.record import CASES, TAKES
from dragon_skin.words import label


def tables(results: dict[str, Any]) -> list[dict[str, Any]]:
    """Return all tables in the order of the page."""
    return [
        _posteriors(results),
        _supported(results),
        _mechanical(results),
        _search(results),
        _held_out(results),
        _recipe(results),
        _repeats(results),
        _meshes(results),
        _accuracy(results),
        _comsol(results),
    ]


def show(results: dict[str, Any], answers: list[str], console: Console) -> None:
    """Print the answers and the tables."""
    for answer in answers:
        console.print(answer + "\n")
    for content in tables(results)[:6]:
        # what a cause means is on the page
        shown = [i for i, name in enumerate(content["header"]) if name != "meaning"]
        table = Table(*(content["header"][i] for i in shown), title=content["title"])
        for row in content["rows"]:
            table.add_row(*(row[i] for i in shown))
        console.print(table)


def _posteriors(results: dict[str, Any]) -> dict[str, Any]:
    rows = []
    for name, posterior in results["posterior"].items():
        modulus, sampling = posterior["modulus_kPa"], results["sampling"][name]
        rows.append(
            [
                name,
                f"{modulus['mean']:.1f} ± {modulus['sd']:.1f}",
                f"{modulus['q05']:.0f} … {modulus['q95']:.0f}",
                f"{posterior['c1']['mean']:.2f} ± {posterior['c1']['sd']:.2f}",
                f"{posterior['noise']['mean']:.2f}",
                f"{results['log_evidence'][name]:.1f}",
                f"{sampling['r_hat']:.3f}",
                f"{sampling['effective']:.0f}",
            ]
        )
    header = [
        "model",
        "E [kPa]",
        "5 … 95 % [kPa]",
        "C1 [kPa]",
        "noise [mm]",
        "ln evidence",
        "R̂",
        "ESS",
    ]
    return _table("Posterior by emcee", header, rows)


def _supported(results: dict[str, Any]) -> dict[str, Any]:
    posterior = results["posterior"]["supported"]
    rows = [
        [
            label(name),
            f"{r['gain']:+.1f} ± {r['gain_error']:.1f}",
            f"{r['modulus_kPa']:.0f} ± {r['modulus_sd_kPa']:.0f}",
            f"{posterior[f'{name}_size']['mean']:.2f} ± {posterior[f'{name}_size']['sd']:.2f}",
            CAUSES[name].words,
        ]
        for name, r in results["one_by_one"]["removed"].items()
    ]
    header = ["taken away", "Δ ln evidence", "E without it [kPa]", "its size [mm]", "meaning"]
    return _table("Each supported cause taken away", header, rows)


def _mechanical(results: dict[str, Any]) -> dict[str, Any]:
    everything = results["posterior"]["everything"]
    rows = []
    for name, a in results["one_by_one"]["added"].items():
        parameter = CAUSES[name].parameter
        assert parameter is not None
        rows.append(
            [
                label(name),
                f"{a['gain']:+.1f} ± {a['gain_error']:.1f}",
                f"{a['modulus_kPa']:.0f} ± {a['modulus_sd_kPa']:.0f}",
                f"{a['mean']:.2f} ± {a['sd']:.2f} {parameter.unit}",
                f"{everything[name]['correlation_with_ln_c1']:+.2f}",
                CAUSES[name].words,
            ]
        )
    header = [
        "added",
        "Δ ln evidence",
        "E with it [kPa]",
        "its value",
        "correlation with ln C1",
        "meaning",
    ]
    title = "Each mechanical cause added to the supported ones; correlation with everything active"
    return _table(title, header, rows)


def _search(results: dict[str, Any]) -> dict[str, Any]:
    rounds = results["search"]
    names = list(rounds[0]["tried"])
    rows = [
        [label(name)]
        + [
            f"{r['tried'][name]['gain']:+.1f}" + (" ✓" if r["added"] == name else "")
            if name in r["tried"]
            else ""
            for r in rounds
        ]
        for name in names
    ]
    header = ["cause", *(f"round {i + 1}" for i in range(len(rounds)))]
    return _table("Search: gain in ln evidence by round (✓ added)", header, rows)


def _held_out(results: dict[str, Any]) -> dict[str, Any]:
    rows = [
        [
            name,
            words,
            f"{c['log_score']:.1f} ± {c['log_score_error']:.1f}",
            f"{c['height_error_mm']:+.2f} ± {c['height_sd_mm']:.2f}",
            f"{c['rms_mm']:.2f}",
            f"{100 * c['within_90_pct']:.0f}",
        ]
        for name, cases in results["held_out"].items()
        for words, c in cases.items()
    ]
    header = [
        "model",
        "held out",
        "ln density",
        "height, seen less predicted [mm]",
        "rms of coordinates [mm]",
        "inside 90 % [%]",
    ]
    return _table("Load case predicted from the two others", header, rows)


def _recipe(results: dict[str, Any]) -> dict[str, Any]:
    moduli = results["recipe"]["moduli_kPa"]
    rows = [
        [take, *(_or_beyond(x) for frame in moduli.values() for x in frame[i])]
        for i, take in enumerate(TAKES)
    ]
    frames = ("frame from all six", "frame from the clamp's")
    header = ["take", *(f"{frame}, marker {k}" for frame in frames for k in range(3))]
    title = "E [kPa] by the source's recipe: one marker's height at rest in a frame of held markers"
    return _table(title, header, rows)


def _or_beyond(value: float | None) -> str:
    return "above 450" if value is None else f"{value:.0f}"


def _repeats(results: dict[str, Any]) -> dict[str, Any]:
    rows = [[words, *(f"{x:.2f}" for x in v)] for words, v in results["repeat_scatter_mm"].items()]
    title = "Change from one repeat to the other, rms over coordinates [mm]"
    return _table(title, ["", *CASES], rows)


def _meshes(results: dict[str, Any]) -> dict[str, Any]:
    rows = [
        [
            " × ".join(map(str, m["divisions"])),
            f"{m['unknowns']}",
            *(f"{x:.3f}" for x in m["sag_mm"]),
            *(f"{x:.3f}" for x in m["from_finest_mm"]),
        ]
        for m in results["meshes"]
    ]
    header = [
        "bricks",
        "unknowns",
        *(f"sag, {c} [mm]" for c in CASES),
        *(f"off the finest, {c} [mm]" for c in CASES),
    ]
    return _table("Mesh convergence at E = 263.8 kPa, ball 0; worst of three balls", header, rows)


def _accuracy(results: dict[str, Any]) -> dict[str, Any]:
    accuracy = results["accuracy"]
    rows = [
        [f"map against direct solutions: {name}", f"{x:.3f}"]
        for name, x in accuracy["map_mm"].items()
    ]
    rows += [
        [f"linear in poses and displaced markers, rms: {name}", f"{x:.3f}"]
        for name, x in accuracy["linearisation_rms_mm"].items()
    ]
    return _table("Accuracy: largest distance of a ball, unless stated", ["check", "[mm]"], rows)


def _comsol(results: dict[str, Any]) -> dict[str, Any]:
    c = results["comsol"]
    rows = [
        [
            words,
            ", ".join(f"{x:.2f}" for x in c["sag_mm"][i]),
            ", ".join(f"{x:.2f}" for x in c["comsol_sag_mm"][i]),
            f"{c['sag_ratio'][i]:.3f}",
            f"{c['largest_distance_mm'][i]:.2f}",
        ]
        for i, words in enumerate(CASES)
    ]
    header = ["load case", "sag here [mm]", "sag, COMSOL [mm]", "ratio", "largest distance [mm]"]
    title = "Surface points below the balls at E = 263.824 kPa against the source's COMSOL results"
    return _table(title, header, rows)


def _table(title: str, header: list[str], rows: list[list[str]]) -> dict[str, Any]:
    return {"title": title, "header": header, "rows": rows}
