"""A trial of a robot without a performer and a bus: can a run begin?"""

from functools import partial

from hardware.arrays import TickArray
from hardware.clock import Clock, VirtualClock
from hardware.no_bus import NoBus
from retarget.errors import ConfigError
from retarget.human.reconstruction import Reconstructor
from retarget.human.samples import Playback
from retarget.model.human import build_human
from retarget.model.human_dimensions import proportional_dimensions
from retarget.model.robot import RobotBody
from retarget.run.options import RunOptions
from retarget.run.prepare import performance_of, prepare_for, robot_part, scene_of, stage_priorities
from retarget.safety.clearance import TIGHTEN
from retarget.schema.performer import load_performer
from retarget.sources.open import open_source

STATURE = 1.7  # [m] of an average performer
FOLLOWED_S = 0.2  # [s] of a recording in a trial


def try_robot(robot: RobotBody, options: RunOptions) -> None:
    """Build the stages of a run for a performer of average proportions. Raises RetargetError as the run would."""
    for_human, for_robot, _ = stage_priorities(robot, options)
    assert for_robot is not None, "there is a robot"
    human, performer = build_human(proportional_dimensions(STATURE)), load_performer(options.performer_name)
    Reconstructor(human, for_human, performer)
    scene, dt = scene_of(robot, options), 1.0 / robot.profile.safety.rate_hz
    robot_part(robot, for_robot, human, options, scene, dt=dt, goes_to_rest=False)


def try_approach(robot: RobotBody) -> None:
    """Run the first moments of the demo from postures `rest` and `stand`. Raises RetargetError as the demo would, and
    ConfigError if it stops before it follows."""
    for posture in ("rest", "stand"):
        ticks = robot.joint_map.to_ticks(robot.posture(getattr(robot.profile.postures, posture))[robot.servo_columns])
        options = RunOptions(robot=robot.profile.name, bus="none", playback=Playback(end=FOLLOWED_S))
        perform = performance_of(partial(open_source, "sample"), options.playback)

        def make_bus(_: RobotBody, clock: Clock, start: TickArray = ticks) -> NoBus:
            return NoBus(clock, start=start)

        with prepare_for(
            perform, options, clock=VirtualClock(), make_bus=make_bus, goes_to_rest=False, robot=robot
        ) as prepared:
            run = prepared.run()
        if run.reason is not None:
            pair = run.tally.refused_pair
            raise ConfigError(
                f"a run that begins in posture `{posture}` does not get to a performer who stands",
                where=str(robot.profile.path),
                found=f"{pair.first} and {pair.second} come too near to each other" if pair else run.reason,
                next_step=f"Move the posture `{posture}`, or {TIGHTEN}",
            )
