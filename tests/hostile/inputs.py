"""The table of hostile inputs, and how each is made of a sound study."""

import os
import random
import stat
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TABLE = Path(__file__).with_name("inputs.toml")
DEEP = 5000
#: More than any file of a study may have, without taking room on the disk [bytes].
SPARSE = 300_000_000


@dataclass(frozen=True)
class Hostile:
    """One input, and the command that must refuse it."""

    command: str
    file: str
    name: str
    change: dict[str, Any]
    said: tuple[str, ...]

    def __str__(self):
        return "-".join(filter(None, (self.file, self.name, self.command)))


def hostile_inputs():
    """Return every case with every command of its group."""
    groups = tomllib.loads(TABLE.read_text(encoding="utf-8"))["group"]
    return [
        Hostile(
            *(command, group["file"], name, change),
            tuple(group.get("said", [group["file"]] if group["file"] else [])),
        )
        for group in groups
        for name, change in group.get("cases", {"": {}}).items()
        for command in group["commands"]
    ]


def spoil(folder, case):
    """Make the input of a sound folder."""
    if not case.file:
        return
    path = folder / case.file
    change = case.change
    if "special" in change:
        _replace(path, change["special"])
        return
    text = change["put"].replace("@DEEP@", "[" * DEEP + "]" * DEEP)
    if "find" in change:
        before = path.read_text(encoding="utf-8")
        assert change["find"] in before, f"{case}: {change['find']!r} is not there to be found"
        text = before.replace(change["find"], text, 1)
    path.write_text(text, encoding="utf-8")


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
        case "sparse":
            path.write_bytes(content)
            os.truncate(path, SPARSE)
        case "missing":
            pass
        case _:
            raise ValueError(kind)


def listing(folder):
    """Return everything below a folder with its size and time of change."""
    found = {(str(path), path.lstat()) for path in folder.rglob("*")}
    return {
        (path, one.st_size, one.st_mtime_ns) for path, one in found if not stat.S_ISDIR(one.st_mode)
    } | {(path, 0, 0) for path, one in found if stat.S_ISDIR(one.st_mode)}
