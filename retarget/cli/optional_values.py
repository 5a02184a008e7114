"""Options that may stand alone or with a value: typer knows only the second, so the usual value is put in here."""

from collections.abc import Sequence
from itertools import pairwise

from hardware.realtime import USUAL_PRIORITY
from retarget.cli.control_socket import USUAL
from retarget.viewer.door import PORT

__all__ = ["with_values"]

USUAL_VALUES = {"--realtime": str(USUAL_PRIORITY), "--control-socket": USUAL, "--view": str(PORT)}


def with_values(words: Sequence[str]) -> list[str]:
    """The words of a command line, with a value behind each of these options that has none."""
    found: list[str] = []
    for word, after in pairwise((*words, "-")):
        found.append(word)
        if word in USUAL_VALUES and after.startswith("-"):
            found.append(USUAL_VALUES[word])
    return found
