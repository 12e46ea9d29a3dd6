"""The table of hostile inputs, and how each is made of a sound folder."""

import json
import os
import random
import stat
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TABLE = Path(__file__).with_name("inputs.toml")
DEEP, DIGITS = 5000, 6000
#: More than any file of a study or run may have, without taking room on the disk [bytes].
SPARSE = 300_000_000


@dataclass(frozen=True)
class Hostile:
    """One input, and the command that must refuse it."""

    subject: str
    command: str
    file: str
    name: str
    change: dict[str, Any]
    said: tuple[str, ...]
    signed: bool
    codes: tuple[int, ...]

    def __str__(self):
        return "-".join(filter(None, (self.file, self.name, self.command)))


def hostile_inputs():
    """Return every case with every command of its group."""
    groups = tomllib.loads(TABLE.read_text(encoding="utf-8"))["group"]
    return [
        Hostile(
            *(group["subject"], command, group["file"], name, change),
            tuple(said),
            group.get("signed", False),
            codes,
        )
        for group in groups
        for name, change in group.get("cases", {"": {}}).items()
        for command, said, codes in _commands(group)
    ]


def _commands(group):
    """Commands of a group, words and exit codes of their refusals."""
    said = group.get("said", [group["file"]] if group["file"] else [])
    for command in group.get("commands", ()):
        yield command, said, (2, 3)
    for command, words in group.get("refused", {}).items():
        yield command, [words], (2,)


def spoil(folder, case, redraw=None):
    """Make the input of a sound folder; posteriors are changed by `redraw`."""
    if not case.file:
        return
    path = folder / case.file
    change = case.change
    if "special" in change:
        _replace(path, change["special"])
    elif "draws" in change:
        redraw(path, change["draws"], change.get("of"))
    elif "key" in change:
        _set(path, change["key"].split("."), change["put"])
    else:
        text = _long(change["put"])
        if "find" in change:
            before = path.read_text(encoding="utf-8")
            assert change["find"] in before, f"{case}: {change['find']!r} is not there to be found"
            text = before.replace(change["find"], text, 1)
        path.write_text(text, encoding="utf-8")
    if case.signed and path.is_file():
        forget_hash(folder, case.file)


def _long(text):
    deep = "[" * DEEP + "]" * DEEP
    return text.replace("@DEEP@", deep).replace("@DIGITS@", DIGITS * "9")


def _replace(path, kind):
    content = path.read_bytes() if path.is_file() else b""
    path.unlink(missing_ok=True)
    match kind:
        case "folder":
            path.mkdir()
        case "pipe":
            os.mkfifo(path)
        case "device":
            path.symlink_to("/dev/zero")
        case "binary":
            path.write_bytes(random.Random(1).randbytes(2000))
        case "cut":
            path.write_bytes(content[: len(content) // 2])
        case "sparse":
            path.write_bytes(content)
            os.truncate(path, SPARSE)
        case "missing":
            pass
        case _:
            raise ValueError(kind)


def _set(path, keys, value):
    content = json.loads(path.read_text(encoding="utf-8"))
    inner = content
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    path.write_text(json.dumps(content), encoding="utf-8")


def forget_hash(folder, file):
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    run.get("posteriors", {}).pop(file, None)
    (folder / "run.json").write_text(json.dumps(run), encoding="utf-8")


def listing(folder):
    """Return everything below a folder with its size and time of change."""
    found = {(str(path), path.lstat()) for path in folder.rglob("*")}
    return {
        (path, one.st_size, one.st_mtime_ns) for path, one in found if not stat.S_ISDIR(one.st_mode)
    } | {(path, 0, 0) for path, one in found if stat.S_ISDIR(one.st_mode)}
