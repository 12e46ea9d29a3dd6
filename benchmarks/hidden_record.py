"""Judged studies in one file, the data behind the published figures."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

Json = dict[str, Any]

LEFT_OUT = ("tried", "factors", "supported", "statistic", "left")  # no figure is made of these


def read_record(path: Path | None) -> dict[tuple[int, str, int, int], Json]:
    """Return recorded studies by seed, effort, number and draw; none where there is no file."""
    if path is None or not path.exists():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    return {_key(one): one for one in map(json.loads, lines)}


def write_record(path: Path, studies: Iterable[Json]) -> None:
    """Write studies to a file, one a line, in the order of seed, effort, number and draw."""
    once = {_key(one): _short(one) for one in studies}
    lines = (json.dumps(one, ensure_ascii=False) for _, one in sorted(once.items()))
    part = path.with_suffix(".part")
    part.write_text("\n".join(lines) + "\n", encoding="utf-8")
    part.replace(path)


def _key(one: Json) -> tuple[int, str, int, int]:
    return one["seed"], one["effort"], one["number"], one.get("draw", 0)


def _short(one: Json) -> Json:
    """Return what figures are made of; of rivals, those of what was hidden."""
    kept = {key: _rounded(value) for key, value in one.items() if key not in LEFT_OUT}
    rivals = one["confusable"]
    return kept | {"confusable": {n: rivals[n] for n in one["hidden"] if n in rivals}}


def _rounded(value: object) -> object:
    """Return numbers with six digits."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {key: _rounded(inner) for key, inner in value.items()}
    return [_rounded(inner) for inner in value] if isinstance(value, list) else value
