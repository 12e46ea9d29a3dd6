"""What the pipeline tells whoever waits for it."""

from typing import Protocol


class Progress(Protocol):
    """Receives the state of the work, to show it."""

    def stage(self, name: str, total: float | None = None) -> None:
        """Begin a stage of so many steps; None if their number is not known."""

    def advance(self, steps: float = 1.0, note: str = "") -> None:
        """Report steps done, with a note on the state of the stage."""


class Silent:
    """Shows nothing."""

    def stage(self, name: str, total: float | None = None) -> None:
        """Ignore."""

    def advance(self, steps: float = 1.0, note: str = "") -> None:
        """Ignore."""
