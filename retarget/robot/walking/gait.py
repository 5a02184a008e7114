"""The gait of a robot, from its size: times and sizes of its steps, and its fastest walk.

Constants were found for OP3 in physics (`benchmarks.walking`), in units of the pendulum.
"""

from math import sqrt

from retarget.arithmetic import hypot, sin
from retarget.errors import ConfigError, UsageError
from retarget.ik.gravity_torque import GRAVITY
from retarget.ik.support_polygon import Stance, plant
from retarget.model.robot import RobotBody
from retarget.robot.balance import ENOUGH, on_one_leg
from retarget.robot.crouch_envelope import MISSED_M
from retarget.robot.walking.pattern import CATCH, EASE, Gait, Request
from retarget.schema.priorities import Priorities, Steps
from retarget.types import MM

STEP_TIMES, DOUBLE_TIMES = 3.76, 0.3
"""Duration of a step and of its double support, in sqrt(height / g)."""
SHORTEST, LONGEST_TIME = 0.9, 1.7
"""Shortest and longest step in time with a performer, relative to the gait's."""
WALKING_HEIGHT = 0.94
"""Height of the centre of mass in a walk, relative to `stand`."""
STRAIGHTEST, REACHING, LOWER = 1.032, 1.0745, 0.284
"""Height of the mass over one foot, relative to the gait's, and on both: at most REACHING less LOWER times the step."""
LIFT = 0.043
"""Greatest height of the swing foot, relative to the gait's."""
LONGEST = 0.45
"""Longest step, relative to the height."""
FORWARD, SIDEWAYS, TURN = 0.0972, 0.026, 0.0472
"""Fastest walk forward and sideways, in sqrt(g height), and turn, in sqrt(g / height)."""
MOST_EASE_S = 0.9
"""Longest time to the walking height and an upright trunk, s."""
LONGEST_STOP_S = 3.8
"""Longest stop of a walking robot, s: the supervisor allows 0.2 s more."""


def gait_of(robot: RobotBody, stance: Stance, *, dt: float) -> Gait:
    """Gait of a robot in its stance on two soles, for ticks of `dt` s."""
    height = WALKING_HEIGHT * float(robot.body.solver_body().centre_of_mass(stance.q[None])[0, 2])
    time = sqrt(height / GRAVITY)
    left, right = (sole.outline.mean(axis=0) for sole in stance.soles)
    width = float(left[1] - right[1])
    ticks = STEP_TIMES * time / dt
    return Gait(
        ticks=round(ticks),
        least_ticks=round(SHORTEST * ticks),
        most_ticks=round(LONGEST_TIME * ticks),
        double_ticks=max(round(DOUBLE_TIMES * time / dt), 2),
        dt=dt,
        height=height,
        width=width,
        lift=LIFT * height,
        longest=LONGEST * height,
    )


def fastest(gait: Gait) -> Request:
    """Greatest velocity of a robot with this gait."""
    speed = sqrt(GRAVITY * gait.height)
    return Request(FORWARD * speed, SIDEWAYS * speed, TURN * speed / gait.height)


def clipped(gait: Gait, request: Request, time: float) -> Request:
    """The request within what the robot can walk in a step of `time` s."""
    most = fastest(gait)
    turn = min(max(request.turn, -most.turn), most.turn)
    reach = gait.longest - 0.5 * gait.width * abs(sin(turn * time))
    forward, left = min(most.forward, reach / time), most.left * min(gait.period / time, 1.0)
    length = max(hypot(request.forward / forward, request.left / left), 1.0)
    return Request(request.forward / length, request.left / length, turn)


def walking_heights(gait: Gait, far: float) -> tuple[float, float]:
    """Heights of the mass in a step of `far` m, m: on both feet, and over one."""
    high = STRAIGHTEST * gait.height
    return min(high, REACHING * gait.height - LOWER * far), high


PLANTED = "both soles stay planted"
"""Beginning of the note for the operator of a robot that stays planted."""
SOLES = 2  # of a robot that walks


def with_steps(
    priorities: Priorities, robot: RobotBody, requested: Steps | None, *, parts: str, mass: bool = False
) -> tuple[Priorities, tuple[str, ...]]:
    """Priorities with `requested` as their `steps`, and notes for the operator on a robot that stays planted.

    requested: None keeps the file's. mass: True for a robot with mass. Raises UsageError or ConfigError for impossible
    steps.
    """
    steps = priorities.steps if requested is None else requested
    notes: tuple[str, ...] = ()
    if steps is not None:
        fault = _fault(steps, robot, parts)
        if fault is not None:
            found, next_step = fault
            kind = ConfigError if requested is None else UsageError
            where = f"priorities {priorities.name}, steps" if requested is None else "--steps"
            raise kind(f"{steps} is not possible here", where=where, found=found, next_step=next_step)
    if steps == "walk" and (why := _unable(robot, mass=mass)) is not None:
        steps, notes = "planted", (f"{PLANTED}: {why}",)
    if steps == "walk" and priorities.deflection_compensation is None:
        raise ConfigError(
            "a robot walks on servos whose load is known",
            where=f"priorities {priorities.name}",
            found="no deflection_compensation",
            next_step="Choose --steps planted, or --priorities balanced",
        )
    return priorities if steps == priorities.steps else priorities.model_copy(update={"steps": steps}), notes


def _fault(steps: Steps, robot: RobotBody, parts: str) -> tuple[str, str] | None:
    """Reason why these steps are impossible, and next step of the user."""
    name = robot.profile.name
    if steps == "follow" and robot.stands:
        return f"{name} stands on its own soles", "Choose --steps walk, or hang it (--bus physics --mount gantry)"
    if steps != "walk":
        return None
    if not robot.stands:
        return f"{name} does not stand on its own soles", "Choose --steps follow: its feet are free"
    if len(robot.profile.feet) != SOLES:
        return f"{name} has {len(robot.profile.feet)} soles", f"Choose --steps planted: {SOLES} are needed"
    if parts != "whole":
        return f"legs that are kept still (--parts {parts})", "Choose --parts whole"
    left, right = (sole.outline.mean(axis=0) for sole in plant(robot, robot.profile.postures.stand).soles)
    if left[1] <= right[1]:
        return f"{name} has its right foot first among `feet`", "Write the left one first in the profile"
    if "pelvis" not in robot.profile.landmarks:
        return f"{name} has no landmark pelvis", "Name one in the profile, or choose --steps planted"
    return None


def _unable(robot: RobotBody, *, mass: bool) -> str | None:
    load, missed = on_one_leg(robot)
    gait = gait_of(robot, plant(robot, robot.profile.postures.stand), dt=1.0 / robot.profile.safety.rate_hz)
    stop = (1.0 + LONGEST_TIME) * gait.period + max(MOST_EASE_S, CATCH / gait.omega) + EASE / gait.omega
    if missed > MISSED_M:
        return f"its mass does not come over one sole while both are flat ({MM * missed:.1f} mm off)"
    if stop > LONGEST_STOP_S:
        return f"in a walk it would need {stop:.1f} s to stop"
    if load.share > ENOUGH:
        return f"{load}, more than {100 * ENOUGH:.0f}%"
    if mass and robot.profile.imu is None:
        return "it needs an IMU, and its profile has none (on the mock bus it walks without)"
    return None


def walks(robot: RobotBody) -> str:
    """Text on the fastest walk of a robot with mass, or on why it does not walk."""
    fault = _fault("walk", robot, "whole")
    why = _unable(robot, mass=True) if fault is None else fault[0]
    if why is not None:
        return f"no: {why}"
    most = fastest(gait_of(robot, plant(robot, robot.profile.postures.stand), dt=1.0 / robot.profile.safety.rate_hz))
    return f"up to {most.forward:.2f} m/s, {most.left:.2f} sideways, {most.turn:.1f} rad/s (--steps walk)"
