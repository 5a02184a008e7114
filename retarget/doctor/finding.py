"""One thing that was looked at: sound, worth knowing, or to be mended; and a line of text for it."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from retarget.errors import Problem

__all__ = ["Finding", "Level", "mend", "mend_all", "note", "ok"]


class Level(StrEnum):
    """How a thing is. Only MEND counts as wrong."""

    OK = "ok"
    NOTE = "note"
    MEND = "mend"


@dataclass(frozen=True, slots=True)
class Finding:
    """subject: what was looked at, a word or two. what: how it is. then: what to do, "" where nothing is."""

    level: Level
    subject: str
    what: str
    then: str = ""

    def render(self) -> str:
        """One line, printable whatever a sender's names are made of."""
        step = self.then + "." if self.then and self.then[-1] not in ".?" else self.then
        told = f"{self.level:<4} {self.subject}: {self.what}" + (f". {step}" if step else "")
        return "".join(letter if letter.isprintable() else "?" for letter in told)


def ok(subject: str, what: str) -> Finding:
    """Nothing to do."""
    return Finding(Level.OK, subject, what)


def note(subject: str, what: str, then: str = "") -> Finding:
    """Worth knowing; a run may go well all the same."""
    return Finding(Level.NOTE, subject, what, then)


def mend(subject: str, what: str, then: str) -> Finding:
    """Wrong, and what to do."""
    return Finding(Level.MEND, subject, what, then)


def mend_all(subject: str, problems: Iterable[Problem]) -> list[Finding]:
    """The problems of a refusal, each as one that is to be mended."""
    return [Finding(Level.MEND, subject, problem.render()) for problem in problems]
