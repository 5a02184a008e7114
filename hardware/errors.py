"""The root of the error tree, and the errors of the servo side.

The command line prints every `RetargetError` and exits with 2 (`TorqueError`: 1).
"""

import re


class RetargetError(Exception):
    """Root of all errors that a user can cause."""


class HardwareError(RetargetError):
    """An error of the servo side."""

    def __init__(
        self, what: str, *, where: str = "", found: object = None, allowed: object = None, then: str = ""
    ) -> None:
        """what: the fault, or without other parts a whole message."""
        whole = not where and found is None and allowed is None and not then
        super().__init__(what if whole else describe(what=what, where=where, found=found, allowed=allowed, then=then))


class BusError(HardwareError):
    """A bus cannot be used."""


class GuardError(HardwareError):
    """The guard refuses a command."""


class TorqueError(HardwareError):
    """Torque could not be switched off. The operator must cut the power."""


_ODD = re.compile("[^ -~\\n\\t]")
SPACES = "\u00a0\u2002\u2003\u2007\u2009\u202f\u3000"
"""Typographic spaces, which are printable here."""


def printable(text: str, *, one_line: bool = False) -> str:
    """Escape control characters, changes of writing direction and lone surrogates. one_line: also line ends and
    tabs."""
    plain = _ODD.sub(
        lambda found: found[0] if found[0].isprintable() or found[0] in SPACES else repr(found[0])[1:-1], text
    )
    return plain.replace("\n", "\\n").replace("\t", "\\t") if one_line else plain


def counted(number: int, what: str) -> str:
    """Return "1 tick", "2 ticks"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def describe(*, what: str, where: str = "", found: object = None, allowed: object = None, then: str = "") -> str:
    """Compose a message: where, what, found, allowed, next step."""
    text = f"{printable(where, one_line=True)}: {what}" if where else what
    if found is not None:
        text += f"; found {printable(str(found), one_line=True)}"
    if allowed is not None:
        text += f"; allowed: {allowed}"
    if then and then[-1] not in ".?!":
        then += "."
    return f"{text}. {then}" if then else f"{text}."
