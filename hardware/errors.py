"""The root of the error tree, and the errors of the servo side.

A message says what is wrong, where, what was found, what is allowed, and what to do next. The command line turns every
`RetargetError` into one message on stderr and exit code 2 (`TorqueError`: 1); a stop of the guard while running is a
state, not an error.
"""

import re


class RetargetError(Exception):
    """Root of every error that a user can cause or meet. Its text stands alone: no traceback is needed to act on it."""


class HardwareError(RetargetError):
    """Anything wrong on the servo side: models, maps, buses, the guard."""

    def __init__(
        self, what: str, *, where: str = "", found: object = None, allowed: object = None, then: str = ""
    ) -> None:
        """what: the fault in a few words, with the other parts of `describe`; or, without any, a whole message."""
        whole = not where and found is None and allowed is None and not then
        super().__init__(what if whole else describe(what=what, where=where, found=found, allowed=allowed, then=then))


class BusError(HardwareError):
    """A bus cannot be opened, read or written."""


class GuardError(HardwareError):
    """The guard refuses a command in its present state."""


class TorqueError(HardwareError):
    """A run failed, and torque could not be switched off: the operator has to cut the power."""


_ODD = re.compile("[^ -~\\n\\t]")
SPACES = "\u00a0\u2002\u2003\u2007\u2009\u202f\u3000"
"""Spaces that typesetters and names use: Python counts them as not printable, and they do no harm."""


def printable(text: str, *, one_line: bool = False) -> str:
    """The text in which what acts on a terminal or cannot be shown (control characters, changes of the direction of
    writing, halves of surrogate pairs) is spelled as Python spells it: `\\x1b`. one_line: ends of lines and tabs, too.
    """
    plain = _ODD.sub(lambda found: _spelled(found[0]), text)
    return plain.replace("\n", "\\n").replace("\t", "\\t") if one_line else plain


def _spelled(letter: str) -> str:
    return letter if letter.isprintable() or letter in SPACES else repr(letter)[1:-1]


def counted(number: int, what: str) -> str:
    """A number of things: "1 tick", "2 ticks"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def describe(*, what: str, where: str = "", found: object = None, allowed: object = None, then: str = "") -> str:
    """Compose a message in the project's order: where, what, found, allowed, what next; empty parts are left out.
    Names in `where` and `found` stay on one line, whatever they are made of."""
    text = f"{printable(where, one_line=True)}: {what}" if where else what
    if found is not None:
        text += f"; found {printable(str(found), one_line=True)}"
    if allowed is not None:
        text += f"; allowed: {allowed}"
    if then and then[-1] not in ".?!":
        then += "."
    return f"{text}. {then}" if then else f"{text}."
