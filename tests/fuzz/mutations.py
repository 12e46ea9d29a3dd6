"""Changes of a file that keep some of its form, drawn at random."""

import csv
import io
import json
import tomllib

import h5py
import numpy as np
import tomli_w

CELLS = (
    *("", " ", "0", "-1", "1", "1e-320", "1e308", "-1e308", "1e999", "inf", "-inf", "nan", "NaN"),
    *("1,5", "1.5.2", "1_000", "0x10", "1e", "--1", "+3", "1 2", "½", "١٢", "1" * 40, "true"),
    *("=1+1", "@SUM(A1)", "-", "'", '"', "#", "x" * 300, "é", "\u202e", "\x00", "\t", "a\nb"),
    *("specimen_id", "loading", "unloading", "uniaxial", "none", "None", "null", "<b>", "../.."),
)
VALUES = (
    *(None, True, False, 0, -1, 1, 7, 10**18, -(10**18), 10**30, 0.0, -0.5, 1.5, 1e-320, 1e308),
    *(float("inf"), float("-inf"), float("nan"), "", "1", "x", "nan", "../x", "é" * 50, [], {}),
    *([1], [[]], [None], {"a": 1}, {"law": "normal"}, [1, 2, 3], [0.5, "x"], ["yeoh"], {"": {}}),
)
TOKENS = (
    *(b",", b";", b"\n", b"\r\n", b'"', b"#", b"-", b"nan", b"1e999", b"[", b"]", b"{", b"=", b"."),
    *(b"\xff", b"\x00", b"\xef\xbb\xbf", b"\xff\xfe", b"\x1b[2J", b"9" * 30, b"\t", b"'", b"\\"),
)
#: Elements of an array in a file that one change makes at most.
LARGEST = 100_000


def spoilt(name: str, content: bytes, rng: np.random.Generator) -> bytes:
    """Return the content of a file, changed once to a few times."""
    for _ in range(1 + int(rng.geometric(0.5))):
        content = _changed(name, content, rng)
    return content


def _changed(name: str, content: bytes, rng: np.random.Generator) -> bytes:
    ending = name.rpartition(".")[2]
    formed = {"csv": _table, "json": _json, "toml": _toml, "nc": _netcdf}.get(ending)
    # a third of the changes know nothing of the format; nearly all formed ones are still parsed
    if formed is None or rng.random() < 0.33:
        return _bytes(content, rng)
    try:
        return formed(content, rng)
    except (AttributeError, LookupError, OSError, RuntimeError, TypeError, ValueError, csv.Error):
        return _bytes(content, rng)  # an earlier change broke the format


def _bytes(content: bytes, rng: np.random.Generator) -> bytes:
    start = int(rng.integers(len(content) + 1))
    length = int(rng.integers(1 + min(len(content) - start, 1 << int(rng.integers(10)))))
    piece = content[start : start + length]
    match int(rng.integers(6)):
        case 0:
            piece = b""
        case 1:
            piece = piece * int(rng.integers(2, 5))
        case 2:
            piece = rng.bytes(int(rng.integers(1, 9)))
        case 3:
            piece = bytes(byte ^ (1 << int(rng.integers(8))) for byte in piece[:4]) + piece[4:]
        case 4 if len(content) > 1:
            other = int(rng.integers(len(content)))
            piece = content[other : other + length]
        case _:
            piece = TOKENS[rng.integers(len(TOKENS))]
    return content[:start] + piece + content[start + length :]


# ---- tables


def _table(content: bytes, rng: np.random.Generator) -> bytes:
    rows = list(csv.reader(io.StringIO(content.decode(), newline="")))
    i = int(rng.integers(len(rows)))
    j = int(rng.integers(max(1, len(rows[i]))))
    match int(rng.integers(9)):
        case 0:
            del rows[i]
        case 1:
            rows.insert(int(rng.integers(len(rows) + 1)), list(rows[i]))
        case 2:  # a column goes
            rows = [[cell for k, cell in enumerate(row) if k != j] for row in rows]
        case 3:  # a column comes twice, or under another name
            extra = [CELLS[rng.integers(len(CELLS))] if rng.random() < 0.5 else rows[0][j]]
            rows = [
                row + (extra if k == 0 else [row[j] if j < len(row) else ""])
                for k, row in enumerate(rows)
            ]
        case 4:  # a whole column has one value
            value = CELLS[rng.integers(len(CELLS))]
            rows = rows[:1] + [[*row[:j], value, *row[j + 1 :]] for row in rows[1:]]
        case 5:  # numbers of a column in another unit
            factor = float(rng.choice([-1.0, 1e-3, 1e3, 1e-9, 1e9, 0.0]))
            rows = rows[:1] + [
                [*r[:j], *_scaled(r[j : j + 1], factor), *r[j + 1 :]] for r in rows[1:]
            ]
        case _:
            rows[i][j : j + 1] = [CELLS[rng.integers(len(CELLS))]]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _scaled(cells: list[str], factor: float) -> list[str]:
    try:
        return [str(float(cell) * factor) for cell in cells]
    except ValueError:
        return cells


# ---- documents


def _json(content: bytes, rng: np.random.Generator) -> bytes:
    return json.dumps(_tree(json.loads(content), rng)).encode()


def _toml(content: bytes, rng: np.random.Generator) -> bytes:
    return tomli_w.dumps(_tree(tomllib.loads(content.decode()), rng)).encode()


def _tree(document: object, rng: np.random.Generator) -> object:
    """Change one place of a document: put, drop, rename, copy."""
    places = list(_places(document))
    if not places:
        return VALUES[rng.integers(len(VALUES))]
    holder, key = places[rng.integers(len(places))]
    match int(rng.integers(8)):
        case 0:
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder[CELLS[rng.integers(len(CELLS))]] = holder.pop(key)
        case 2:
            other, name = places[rng.integers(len(places))]
            holder[key] = json.loads(json.dumps(other[name], default=str))
        case 3 if isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
            holder[key] *= float(rng.choice([-1.0, 0.0, 1e-3, 1e3, 0.5, 1e12]))
        case _:
            value = VALUES[rng.integers(len(VALUES))]
            holder[key] = json.loads(json.dumps(value)) if isinstance(value, list | dict) else value
    return document


def _places(document: object):
    if isinstance(document, dict):
        keys = list(document)
    elif isinstance(document, list):
        keys = list(range(len(document)))
    else:
        return
    for key in keys:
        yield document, key
        yield from _places(document[key])


# ---- arrays


def _netcdf(content: bytes, rng: np.random.Generator) -> bytes:
    file = io.BytesIO(content)
    with h5py.File(file, "r+") as opened:
        names: list[str] = []
        opened.visit(names.append)
        name = str(rng.choice(names))
        match int(rng.integers(6)):
            case 0:
                del opened[name]
            case 1:
                opened.move(name, name + str(rng.choice(["x", "/x", " "])))
            case 2:
                _other_attribute(opened[name], rng)
            case _:
                if isinstance(opened[name], h5py.Dataset):
                    _other_values(opened, name, rng)
    return file.getvalue()


def _other_attribute(node: h5py.Dataset | h5py.Group, rng: np.random.Generator) -> None:
    names = list(node.attrs) or ["units"]
    name = str(rng.choice(names))
    if rng.random() < 0.3 and name in node.attrs:
        del node.attrs[name]
    else:
        node.attrs[name] = [0, -1, "x", "2", np.nan, [1.0, 2.0], b"\xff", "days since x"][
            rng.integers(8)
        ]


def _other_values(opened: h5py.File, name: str, rng: np.random.Generator) -> None:
    node = opened[name]
    values = np.asarray(node[()])
    match int(rng.integers(5)):
        case 0 if values.dtype.kind in "fi" and values.size:
            at = tuple(int(rng.integers(size)) for size in values.shape)
            node[at] = rng.choice([0, -1, 1e30]) if values.dtype.kind == "i" else _odd(rng)
        case 1 if values.dtype.kind == "f":
            with np.errstate(over="ignore", invalid="ignore"):
                node[...] = values * _odd(rng)
        case 2:  # of another type
            del opened[name]
            opened[name] = np.full(values.shape, "x", dtype=h5py.string_dtype())
        case 3:  # of another shape
            del opened[name]
            opened[name] = np.resize(
                values, min(LARGEST, 1 + int(rng.integers(2 * values.size + 2)))
            )
        case _:
            del opened[name]
            opened[name] = values[..., None] if rng.random() < 0.5 else values.reshape(-1)[:1]


def _odd(rng: np.random.Generator) -> float:
    return float(rng.choice([np.nan, np.inf, -np.inf, -1.0, 0.0, 1e308, 1e-308, 1e6]))
