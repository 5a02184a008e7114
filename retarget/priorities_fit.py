"""Whether a priority file is for the body that it was given to: a robot's file moves no human, nor the other way."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from retarget.catalogue import Kind, find
from retarget.errors import ConfigError, Problem
from retarget.frames import SENSORS
from retarget.priorities import LookAtTask, OrientationTask, PositionTask, Priorities
from retarget.schema_errors import listed

__all__ = ["FOR_HUMANS", "check_for_human", "naming_file"]

FOR_HUMANS = "human, paper"
"""The shipped priority files of the human's stage."""

_GIVE_HUMAN = f"Give the human a priority file of its own (shipped: {FOR_HUMANS})"


def check_for_human(priorities: Priorities, name: str) -> None:
    """Raise ConfigError for tasks of which no performer can wear anything, and which would do nothing.

    name: of the priority file, or its path.
    """
    where = str(find(Kind.PRIORITIES, name))
    problems = [
        Problem(
            f"task {task.type} of level {priorities.levels[level].name!r} names nothing that a performer wears",
            where=where,
            found=listed(task.of),
            allowed=listed(SENSORS),
            next_step=_GIVE_HUMAN,
        )
        for level, _, task in priorities.tasks()
        if isinstance(task, PositionTask | OrientationTask | LookAtTask)
        and not task.optional
        and not set(task.of) & set(SENSORS)
    ]
    if problems:
        raise ConfigError.from_problems(problems, title=f"{where}: {len(problems)} problems")


@contextmanager
def naming_file(name: str, *, robot: str) -> Iterator[None]:
    """What a robot refuses in a priority file is said with the file, and with what to do. name: of it, or its path."""
    try:
        yield
    except ConfigError as error:
        where = str(find(Kind.PRIORITIES, name))
        own = f"{robot} brings its own (those of the human are {FOR_HUMANS})"
        step = f"Name frames of {robot}, or leave --priorities out: {own}"
        problems = [
            problem if problem.where else replace(problem, where=where, next_step=f"{problem.next_step} {step}".strip())
            for problem in error.problems
        ]
        raise ConfigError.from_problems(problems) from error
