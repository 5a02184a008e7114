"""Errors that stop a command before anything moves: bad files, bad configurations, bad options.

Each carries one or more `Problem`s (what, where, found, allowed, next step) and renders all of them as one message, so
that a user can correct a file in one go. The command line prints the message and ends with exit code 2. The root of
the tree, `RetargetError`, lives in `hardware.errors`, because `hardware` imports nothing from here.
"""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from shlex import quote
from typing import Self

from hardware.errors import RetargetError, describe

MAX_SHOWN = 20
"""At most this many problems are spelled out in one message; the rest are counted."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong. Empty parts are left out of the text.

    what: the fault in a few words. where: "file", "file:line" or "file:line: key". found: what stands there.
    allowed: what may stand there. next_step: what the user should do, one sentence (a full stop is added).
    line: of the file, from 1, to list problems in the file's order; 0 where there is none.
    """

    what: str
    where: str = ""
    found: str = ""
    allowed: str = ""
    next_step: str = ""
    line: int = 0

    def render(self) -> str:
        """One line of text."""
        return describe(
            what=self.what,
            where=self.where,
            found=self.found or None,
            allowed=self.allowed or None,
            then=self.next_step,
        )


class RefusedError(RetargetError):
    """Refused before anything moved. Not raised itself: see `InputError`, `ConfigError`, `UsageError`."""

    def __init__(
        self, what: str, *, where: str = "", found: object = "", allowed: object = "", next_step: str = ""
    ) -> None:
        """One problem; `found` and `allowed` are turned into text. Several: `from_problems`."""
        problem = Problem(what, where, str(found), str(allowed), next_step)
        super().__init__(problem.render())
        self.problems: tuple[Problem, ...] = (problem,)

    @classmethod
    def from_problems(cls, problems: Sequence[Problem], *, title: str = "") -> Self:
        """All problems of one file as one error, by line. `title` heads the list when there is more than one."""
        if not problems:
            raise ValueError("an error needs at least one problem")
        error = cls(problems[0].what)
        error.problems = tuple(sorted(problems, key=attrgetter("line")))
        error.args = (_render_all(error.problems, title),)
        return error


class InputError(RefusedError):
    """Bad data from outside: a motion file, a stream address, a recording."""


class ConfigError(RefusedError):
    """A configuration (robot profile, priorities, performer) that cannot be used."""


class UsageError(RefusedError):
    """A command line option that cannot be used: unknown name, unwritable path, impossible combination."""


def nearest(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """At most three known names closest in spelling to `name`, best first; empty when none is near."""
    spelled: dict[str, str] = {}
    for candidate in known:
        spelled.setdefault(candidate.casefold(), candidate)
    matches = difflib.get_close_matches(name.casefold()[:100], list(spelled), n=3, cutoff=0.6)
    return tuple(spelled[match] for match in matches)


RENAMED = {
    "uphold": "deflection_compensation",
    "servo_lead": "lag_compensation",
    "reserve": "speed_margin",
    "off_stops": "soft_limits",
    "late": "tracking_delay",
    "following_error_lasting": "following_error_sustained",
    "steady": "balanced",
    "lasting": "balanced_sustained",
    "held": "fixed_base",
    "run --trouble": "--perturb",
    "stop --cut": "--torque-off",
    "stop --socket": "`retarget stop PATH`",
    "servo --drive-mode": "--register drive_mode=BITS",
    "cut": "torque_off",
}
"""Names of version 0.1.0 and what they are called now: keys and files of configurations, options (with their command),
words of the control socket. An old name is refused with the new one."""


def renamed_to(name: str, known: Iterable[str] | None = None) -> str:
    """A next step with the new name of `name`, where that is one of the known names (None: any); else ""."""
    new = RENAMED.get(name)
    return f"It is called {new} now" if new is not None and (known is None or new in known) else ""


def suggest(name: str, known: Iterable[str]) -> str:
    """A next step for an unknown name: its new name if it was renamed, "Did you mean a, b or c?", or "" when nothing
    is near."""
    known = tuple(known)
    if renamed := renamed_to(name, known):
        return renamed
    near = nearest(name, known)
    if not near:
        return ""
    return "Did you mean " + (near[0] if len(near) == 1 else ", ".join(near[:-1]) + " or " + near[-1]) + "?"


def install_step(*packages: str) -> str:
    """A next step: install packages that retarget can use, in the versions that it takes. They are named themselves,
    not by an extra, so the line is right beside an installed wheel and beside a checkout."""
    import re
    from importlib.metadata import PackageNotFoundError, requires

    try:
        required = requires("retarget") or []
    except PackageNotFoundError:  # run from a folder without being installed
        required = []
    taken = {re.split(r"[^\w-]", one, maxsplit=1)[0]: one.partition(";")[0].strip() for one in required}
    return "Install into this environment: pip install " + " ".join(quote(taken.get(one, one)) for one in packages)


def _render_all(problems: Sequence[Problem], title: str) -> str:
    if len(problems) == 1:
        return problems[0].render()
    lines = [title or f"{len(problems)} problems"]
    lines += [f"  {problem.render()}" for problem in problems[:MAX_SHOWN]]
    if len(problems) > MAX_SHOWN:
        lines.append(f"  ... and {len(problems) - MAX_SHOWN} more.")
    return "\n".join(lines)
