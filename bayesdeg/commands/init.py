"""``bayesdeg init``: a study to start from."""

import shutil
from pathlib import Path

from bayesdeg.console import errors, output
from bayesdeg.errors import BayesdegError
from bayesdeg.files import reason

STARTER = Path(__file__).with_name("starter")


def init(folder: Path) -> None:
    """Do what `interface.init` says."""
    write_starter(folder)
    output().print(f"wrote a study to {folder}, with data of a virtual experiment", soft_wrap=True)
    for does, command in (
        ("check it", f"bayesdeg check {folder}"),
        ("run it", f"bayesdeg run {folder} --effort quick"),
    ):
        errors.print(f"  {does}: {command}", soft_wrap=True)
    errors.print(
        "then replace its CSV files with your own (delete those for which you have no data) and "
        "remove the lines 'virtual' and 'note' from study.toml",
        soft_wrap=True,
    )


def write_starter(folder: Path) -> tuple[Path, ...]:
    """Copy the starter into a folder.

    Parameters
    ----------
    folder : Path
        Created if it does not exist.

    Returns
    -------
    tuple of Path
        The files written.

    Raises
    ------
    BayesdegError
        If it holds files, is not a folder, or cannot be written to.
    """
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            what = "already holds files" if folder.is_dir() else "is a file"
            raise BayesdegError(f"{folder} {what}; name a new folder")
        folder.mkdir(parents=True, exist_ok=True)
        # in binary, to keep line ends
        return tuple(
            Path(shutil.copyfile(file, folder / file.name)) for file in sorted(STARTER.iterdir())
        )
    except OSError as fault:
        raise BayesdegError(
            f"{folder} cannot be written to ({reason(fault)}); name a different folder"
        ) from fault
