"""The root of the error tree, and the errors of the servo side.

A message says what is wrong, where, what was found, what is allowed, and what to do next. The command line turns every
`RetargetError` into one message on stderr and exit code 2 (`TorqueError`: 1); a stop of the guard while running is a
state, not an error.
"""


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


def counted(number: int, what: str) -> str:
    """A number of things: "1 tick", "2 ticks"."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def describe(*, what: str, where: str = "", found: object = None, allowed: object = None, then: str = "") -> str:
    """Compose a message in the project's order: where, what, found, allowed, what next; empty parts are left out."""
    text = f"{where}: {what}" if where else what
    if found is not None:
        text += f"; found {found}"
    if allowed is not None:
        text += f"; allowed: {allowed}"
    if then and then[-1] not in ".?!":
        then += "."
    return f"{text}. {then}" if then else f"{text}."
