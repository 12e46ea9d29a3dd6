"""Progress reports of long work."""

from typing import Protocol


class Progress(Protocol):
    """Receives the state of the work for display."""

    def stage(self, name: str, total: float | None = None) -> None:
        """Begin a stage with this number of steps; None if unknown."""

    def advance(self, steps: float = 1.0, note: str = "") -> None:
        """Report completed steps, with a note on the stage."""


class Silent:
    """Shows nothing."""

    def stage(self, name: str, total: float | None = None) -> None:
        """Ignore."""

    def advance(self, steps: float = 1.0, note: str = "") -> None:
        """Ignore."""
