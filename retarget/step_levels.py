"""The levels of a robot that steps: what priorities ask of one that stands, and two more.

A planted sole stays as high in the hierarchy as the file has it. One that swings drops below soles, balance and
collisions, to a level of its own; and a level above that brings the mass over the sole that is to carry.
"""

from collections.abc import Mapping

from retarget.body import Frame
from retarget.errors import ConfigError
from retarget.priorities import (
    CentreOfMassTask,
    Level,
    OrientationTask,
    PositionTask,
    PreventiveTask,
    Priorities,
    ReactiveTask,
)
from retarget.step_balance import balance_in_motion

__all__ = ["SWINGING", "stepping_priorities", "swinging", "swinging_frames"]

WEIGHT, SWINGING = "weight over the sole that carries", "sole that swings"
"""Names of the levels."""


def swinging(sole: str) -> str:
    """Name of a sole while it swings."""
    return f"swinging_{sole}"


def swinging_frames(frames: Mapping[str, Frame], soles: tuple[str, ...]) -> dict[str, Frame]:
    """Frames by name, and those of soles under the names that they have while they swing."""
    return dict(frames) | {swinging(sole): frames[sole] for sole in soles}


def stepping_priorities(priorities: Priorities, soles: tuple[str, ...]) -> Priorities:
    """These priorities with the levels of steps, below all that keeps a robot on its feet and clear of things.

    soles: names of their frames. Raises ConfigError where they do not plant the soles, or do not look at mass in
    motion.
    """
    _refuse_unplanted(priorities, soles)
    last = max(index for index, level in enumerate(priorities.levels) if _keeps_safe(level, soles))
    names = tuple(swinging(sole) for sole in soles)
    weight = CentreOfMassTask(type="centre_of_mass", mode="over_feet", weight=(1.0, 1.0, 0.0))
    made = (
        Level(name=WEIGHT, tasks=(weight,)),
        Level(
            name=SWINGING,
            tasks=(PositionTask(type="position", of=names), OrientationTask(type="orientation", of=names)),
        ),
    )
    levels = (*priorities.levels[: last + 1], *made, *priorities.levels[last + 1 :])
    return priorities.model_copy(update={"levels": levels})


def _keeps_safe(level: Level, soles: tuple[str, ...]) -> bool:
    """Whether a level plants a sole, keeps the balance or parts what is close."""
    for task in level.tasks:
        if isinstance(task, ReactiveTask | PreventiveTask):
            return True
        if isinstance(task, CentreOfMassTask) and task.mode == "support":
            return True
        if isinstance(task, PositionTask | OrientationTask) and set(soles) & set(task.of):
            return True
    return False


def _refuse_unplanted(priorities: Priorities, soles: tuple[str, ...]) -> None:
    for kind, called in ((PositionTask, "position"), (OrientationTask, "orientation")):
        planted = {name for _, _, task in priorities.tasks() if isinstance(task, kind) for name in task.of}
        missing = [sole for sole in soles if sole not in planted]
        if missing:
            raise ConfigError(
                "steps of a robot whose soles are not planted",
                where=f"priorities {priorities.name}",
                found=f"no task of type {called} for {', '.join(missing)}",
                allowed="tasks of type position and orientation for every sole",
                next_step="Choose --steps planted, or --priorities steady",
            )
    if balance_in_motion(priorities) is None:
        raise ConfigError(
            "steps of a robot whose balance does not look at motion",
            where=f"priorities {priorities.name}",
            found="no task of type centre_of_mass with moving",
            allowed="a centre_of_mass task of mode support with moving, as steady has it",
            next_step="Choose --steps planted, or --priorities steady",
        )
