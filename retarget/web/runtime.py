"""Stand-in until the installer is merged."""

from pathlib import Path


def runtime_folder() -> Path | None:
    """The folder of the runtime; None where it is not installed."""
    return None
