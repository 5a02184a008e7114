"""The gait of a robot, from its size: times and sizes of its steps, and how fast it may be asked to walk.

Sizes are shares of what was found for OP3 in physics (`benchmarks.walking`), in the natural units of an inverted
pendulum: a step's time by sqrt(height / g), speeds by sqrt(g height).
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
"""Duration of a step, and of its double support, in sqrt(height / g): 0.592 and 0.048 s of OP3."""
SHORTEST, LONGEST_TIME = 0.9, 1.7
"""Durations of the shortest and of the longest step in time with a performer, as shares of the gait's own. A shorter
step would need faster servos. A longer one, at the same velocity, needs legs that reach farther, hence bend more: they
would look less like the performer's."""
WALKING_HEIGHT = 0.94
"""Height of the centre of mass in the pattern of a walk, as a share of that in `stand`."""
STRAIGHTEST, REACHING, LOWER = 1.032, 1.0745, 0.284
"""Height of the mass over the foot that carries, as a share of that: straighter knees would have to turn too fast.
While both feet are on the floor it is lower, so that legs reach forward and back: by the second less the third for a
step as long as the height, 0.98 of `stand` for short ones of OP3, and 0.91 for 90 mm. Less, and knees need more speed
and acceleration; more, and they bend more than the performer's."""
LIFT = 0.043
"""Greatest height of the foot that swings, as a share of that height: 10 mm of OP3. Knees need torque for more."""
LONGEST = 0.45
"""Longest step, as a share of the height. In a longer one, bent legs of OP3 come too near to its trunk."""
FORWARD, SIDEWAYS, TURN = 0.0972, 0.026, 0.0472
"""Fastest walk, forward and sideways by sqrt(g height), and turn by sqrt(g / height): 0.15 m/s, 0.04 m/s and 0.3 rad/s
of OP3. At 0.18 m/s its hips and knees would have to speed up faster than they can, and it stumbles."""
MOST_EASE_S = 0.9
"""Longest time (s) in which a robot that begins to walk gets to its walking height, and upright."""
LONGEST_STOP_S = 3.8
"""Longest stop (s) of a robot that walks, from the first posture of a path to its end: the supervisor allows 0.2 s
more. A taller robot takes longer, and stays planted."""


def gait_of(robot: RobotBody, stance: Stance, *, dt: float) -> Gait:
    """The gait of a robot in its stance on two soles, in ticks of `dt` s."""
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
    """The fastest that a robot of this gait may be asked to walk: m/s, m/s, rad/s."""
    speed = sqrt(GRAVITY * gait.height)
    return Request(FORWARD * speed, SIDEWAYS * speed, TURN * speed / gait.height)


def clipped(gait: Gait, asked: Request, time: float) -> Request:
    """A velocity that is no faster than the robot may be asked to walk, in a step of so many s: a long step leaves a
    leg little to reach forward, and less to reach sideways, while hips turn as they do on the spot."""
    most = fastest(gait)
    turn = min(max(asked.turn, -most.turn), most.turn)
    reach = gait.longest - 0.5 * gait.width * abs(sin(turn * time))  # soles that turn are before and behind each other
    forward, left = min(most.forward, reach / time), most.left * min(gait.period / time, 1.0)
    length = max(hypot(asked.forward / forward, asked.left / left), 1.0)
    return Request(asked.forward / length, asked.left / length, turn)


def walking_heights(gait: Gait, far: float) -> tuple[float, float]:
    """Heights (m) of the centre of mass in a step of `far` m: while both feet are on the floor and legs reach forward
    and back, and over one of them."""
    high = STRAIGHTEST * gait.height
    return min(high, REACHING * gait.height - LOWER * far), high


# Whether a robot walks: its priority file says so, or `--steps` instead, and its root and legs whether it can.

PLANTED = "both soles stay planted"
"""With these words begins the note for the operator of a robot that does not walk though it is asked to."""
SOLES = 2
"""Soles of a robot that walks."""


def with_steps(
    priorities: Priorities, robot: RobotBody, asked: Steps | None, *, parts: str, mass: bool = False
) -> tuple[Priorities, tuple[str, ...]]:
    """The priorities with `asked` instead of their own `steps`, and notes for the operator: a robot that is too weak to
    stand on one leg, or cannot get its weight over it, stays planted.

    asked: None keeps those of the file. parts: of the robot that follow. mass: whether it has any. Raises UsageError or
    ConfigError where this robot cannot step so, as it is mounted.
    """
    steps = priorities.steps if asked is None else asked
    notes: tuple[str, ...] = ()
    if steps is not None:
        fault = _fault(steps, robot, parts)
        if fault is not None:
            found, next_step = fault
            kind = ConfigError if asked is None else UsageError
            where = f"priorities {priorities.name}, steps" if asked is None else "--steps"
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
    """What makes these steps impossible, and what to do."""
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
    """Why a robot that could be asked to walk stays planted; None: it walks. mass: whether it has any."""
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
    """How fast a robot with mass walks, or why it does not, in words."""
    fault = _fault("walk", robot, "whole")
    why = _unable(robot, mass=True) if fault is None else fault[0]
    if why is not None:
        return f"no: {why}"
    most = fastest(gait_of(robot, plant(robot, robot.profile.postures.stand), dt=1.0 / robot.profile.safety.rate_hz))
    return f"up to {most.forward:.2f} m/s, {most.left:.2f} sideways, {most.turn:.1f} rad/s (--steps walk)"
