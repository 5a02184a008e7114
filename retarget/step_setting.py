"""Whether a robot steps: its priority file says so, or `--steps` instead, and its root and legs whether it can."""

from retarget.errors import ConfigError, UsageError
from retarget.leg_loads import ENOUGH, one_leg_load
from retarget.priorities import Priorities, Steps
from retarget.robot_body import RobotBody

__all__ = ["with_steps"]

SOLES = 2
"""Of a robot that steps."""


def with_steps(
    priorities: Priorities, robot: RobotBody, asked: Steps | None, *, parts: str
) -> tuple[Priorities, tuple[str, ...]]:
    """The priorities with what was asked instead of their own `steps`, None for neither; and what is to be told: who is
    too weak to stand on one leg stays planted.

    parts: of the robot that follow. Raises UsageError or ConfigError where this robot cannot step so, as it is mounted.
    """
    steps = priorities.steps if asked is None else asked
    notes: tuple[str, ...] = ()
    if steps is not None:
        fault = _fault(steps, robot, parts)
        if fault is not None:
            found, then = fault
            kind = ConfigError if asked is None else UsageError
            where = f"priorities {priorities.name}, steps" if asked is None else "--steps"
            raise kind(f"steps {steps} are not possible here", where=where, found=found, next_step=then)
    if steps == "shift" and (load := one_leg_load(robot)).share > ENOUGH:
        steps = "planted"
        notes = (f"both soles stay planted: {load}, more than {100 * ENOUGH:.0f}%",)
    return priorities if steps == priorities.steps else priorities.model_copy(update={"steps": steps}), notes


def _fault(steps: Steps, robot: RobotBody, parts: str) -> tuple[str, str] | None:
    """What hinders, and what to do."""
    name = robot.profile.name
    if steps == "follow" and robot.stands:
        return f"{name} stands on its own soles", "Choose --steps shift, or hang it (--bus physics --mount gantry)"
    if steps != "shift":
        return None
    if not robot.stands:
        return f"{name} does not stand on its own soles", "Choose --steps follow: its feet are free"
    if len(robot.profile.feet) != SOLES:
        return f"{name} has {len(robot.profile.feet)} soles", f"Choose --steps planted: {SOLES} are needed"
    if parts != "whole":
        return f"legs that are kept still (--parts {parts})", "Choose --parts whole"
    if "pelvis" not in robot.profile.landmarks:
        return f"{name} has no landmark pelvis", "Name one in the profile, or choose --steps planted"
    return None
