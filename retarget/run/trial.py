"""A robot tried without a performer and a bus: whether a run could begin."""

from functools import partial

from retarget.errors import ConfigError
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import PerformerInput
from retarget.model.human import build_human
from retarget.model.human_dimensions import proportional_dimensions
from retarget.model.robot import RobotBody
from retarget.run.controllers import RobotMotion
from retarget.run.options import RunOptions
from retarget.run.prepare import performance_of, robot_part, scene_of, stage_priorities
from retarget.safety.clearance import TIGHTEN
from retarget.schema.performer import load_performer
from retarget.sources.open import open_source
from retarget.types import FloatArray, RunState

STATURE = 1.7
"""[m] of the person for whom a robot is tried."""
LONGEST_APPROACH_S, REFUSED_S = 30.0, 1.0
"""An approach that takes longer, or that stands for so long in front of what the gate refuses, does not get there."""


def try_robot(robot: RobotBody, options: RunOptions) -> None:
    """Build what a run builds of a robot, for a person of average proportions; no way is tried. Raises RetargetError as
    the run would."""
    for_human, for_robot, _ = stage_priorities(robot, options)
    assert for_robot is not None, "there is a robot"
    human, performer = build_human(proportional_dimensions(STATURE)), load_performer(options.performer_name)
    Reconstructor(human, for_human, performer)
    scene, dt = scene_of(robot, options), 1.0 / robot.profile.safety.rate_hz
    robot_part(robot, for_robot, human, options, scene, dt=dt, goes_to_rest=False)


def try_approach(robot: RobotBody, options: RunOptions) -> None:
    """Try the approach of a run without any bus: from the postures `rest` and `stand` to the performer of the sample
    recording, through the gate. Raises RetargetError as the run would, and ConfigError where the gate does not let it
    get there."""
    for_human, for_robot, _ = stage_priorities(robot, options)
    assert for_robot is not None, "there is a robot"
    performer, dt = load_performer(options.performer_name), 1.0 / robot.profile.safety.rate_hz
    performance = performance_of(partial(open_source, "sample"), options.playback)(performer, robot)
    first = performance.samples.sample(0)
    assert first is not None, "a recording begins with a valid sample"
    human = build_human(performance.dimensions)
    for posture in ("rest", "stand"):
        reconstructor = Reconstructor(human, for_human, performer)
        follower, gate, _ = robot_part(
            robot, for_robot, human, options, scene_of(robot, options), dt=dt, goes_to_rest=False
        )
        motion = RobotMotion(robot, reconstructor, follower, gate, first=first, dt=dt, motion_dt=dt)
        start = robot.posture(getattr(robot.profile.postures, posture))[robot.servo_columns]
        if not _gets_there(motion, start, dt=dt):
            near = "" if gate.clearance is None else gate.clearance.in_the_way(follower.observers.names)
            raise ConfigError(
                f"the gate refuses the way from posture `{posture}` to a performer who stands, so no run begins",
                where=str(robot.profile.path),
                found=f"{near} come too near to each other" if near else "a goal is beyond the limits",
                allowed="a way on which nothing comes too near to anything else",
                next_step=f"Move the posture `{posture}`, or {TIGHTEN}",
            )


def _gets_there(motion: RobotMotion, start: FloatArray, *, dt: float) -> bool:
    """Whether the approach from joint positions (n,), rad, gets to where following begins."""
    commanded, refused_s = motion.begin(start), 0.0
    for _ in range(round(LONGEST_APPROACH_S / dt)):
        wanted = motion.target(RunState.APPROACH, commanded, PerformerInput(), speed_override=1.0)
        goal, target = motion.check(commanded, wanted)
        commanded = motion.next(commanded, goal, target)
        motion.lead_from(commanded, wanted)
        if motion.approach.arrived:
            return True
        refused_s = refused_s + dt if motion.refused(commanded) else 0.0
        if refused_s > REFUSED_S:
            return False
    return False
