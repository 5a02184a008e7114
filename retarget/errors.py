"""Errors that stop a command before anything moves: bad files, bad configurations, bad options.

Each renders all its `Problem`s as one message, with which the command line ends (exit code 2).
"""

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from shlex import quote
from typing import Self

from hardware.errors import RetargetError, describe

MAX_SHOWN = 20
"""Most problems in one message; the rest are counted."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One fault; empty parts are left out of the text.

    where: "file", "file:line" or "file:line: key". next_step: one sentence without full stop. line: from 1, the order
    of problems; 0 without one.
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
    """Base of `InputError`, `ConfigError` and `UsageError`."""

    def __init__(
        self, what: str, *, where: str = "", found: object = "", allowed: object = "", next_step: str = ""
    ) -> None:
        """An error of one problem; `found` and `allowed` become text."""
        problem = Problem(what, where, str(found), str(allowed), next_step)
        super().__init__(problem.render())
        self.problems: tuple[Problem, ...] = (problem,)

    @classmethod
    def from_problems(cls, problems: Sequence[Problem], *, title: str = "") -> Self:
        """All problems of one file as one error, by line. `title` is the heading of several."""
        if not problems:
            raise ValueError("an error needs at least one problem")
        error = cls(problems[0].what)
        error.problems = tuple(sorted(problems, key=attrgetter("line")))
        error.args = (_render_all(error.problems, title),)
        return error


class InputError(RefusedError):
    """Bad data from outside: a motion file, a stream address, a recording."""


class ConfigError(RefusedError):
    """A configuration (robot profile, priorities, performer) with faults."""


class UsageError(RefusedError):
    """A command line option or argument with faults."""


def nearest(name: str, known: Iterable[str]) -> tuple[str, ...]:
    """At most three known names similar to `name`, best first."""
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
"""New names by those of version 0.1.0: keys, files, options (with their command), words of the control socket."""


def renamed_to(name: str, known: Iterable[str] | None = None) -> str:
    """A next step with the new name of `name`, if that is known (None: any); else ""."""
    new = RENAMED.get(name)
    return f"It is called {new} now" if new is not None and (known is None or new in known) else ""


def suggest(name: str, known: Iterable[str]) -> str:
    """A next step for an unknown name: its new name, "Did you mean a, b or c?", or ""."""
    known = tuple(known)
    if renamed := renamed_to(name, known):
        return renamed
    near = nearest(name, known)
    if not near:
        return ""
    return "Did you mean " + (near[0] if len(near) == 1 else ", ".join(near[:-1]) + " or " + near[-1]) + "?"


def install_step(*packages: str) -> str:
    """A next step: install packages, each by name, not by an extra, so that it is right for a wheel and a checkout."""
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
