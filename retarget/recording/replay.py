"""A recorded run once more: the sensors, servos and clock of then, through the pipeline of now."""

import platform
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import retarget
from hardware.bus import ServoBus
from hardware.clock import Clock
from hardware.guard import Guard
from hardware.guard_state import StopCause
from retarget.errors import InputError
from retarget.performer import Performer
from retarget.pipeline import Watch
from retarget.prepare import Prepared, prepare_for
from retarget.record import Record
from retarget.recording.configs import Configs, as_then
from retarget.recording.cursor import Cursor
from retarget.recording.cycles import Asked
from retarget.recording.difference import Difference, goal_difference, posture_difference
from retarget.recording.played import Played
from retarget.recording.session import Session
from retarget.recording.stand_ins import ReplayedBus, ReplayedClock, ReplayedSamples
from retarget.robot_body import RobotBody
from retarget.run_result import RunResult
from retarget.samples import Performance

__all__ = ["Replayed", "refuse_other_robot", "replay", "what_computes"]

Tell = Callable[[str], object]


@dataclass(frozen=True, eq=False)
class Replayed:
    """result: of the run as it is now. difference: from what was recorded. changed: what is another than then."""

    result: RunResult
    difference: Difference
    changed: tuple[str, ...]


def replay(
    played: Played, configs: Configs | None = None, *, watch: Watch | None = None, tell: Tell = lambda text: None
) -> Replayed:
    """Run it again. configs: None: those of then. watch: `on_tick` of it is told. tell: as of `prepare_for`.

    Raises RetargetError for what cannot be run any more; InputError where robot or performer are others now.
    """
    if configs is None:
        with as_then(played.recording) as then:
            return replay(played, then, watch=watch, tell=tell)
    session, has_robot = played.recording.session, bool(played.recording.session.joints)
    cursor = Cursor(played.cycles, has_robot=has_robot, dt=session.dt)
    samples, bus, clock = ReplayedSamples(played, cursor), ReplayedBus(played, cursor), ReplayedClock(cursor)

    def perform(performer: Performer, robot: RobotBody | None) -> Performance:
        _refuse_other_performer(session, performer)
        if robot is not None:
            refuse_other_robot(session, robot)
        return Performance(samples, session.size, session.notes, session.intake_times)

    def make_bus(robot: RobotBody, clock: Clock) -> ServoBus:
        return bus

    robot = configs.robot
    with prepare_for(
        perform, configs.options, clock=clock, make_bus=make_bus, parks=session.parks, tell=tell, robot=robot
    ) as prepared:
        result = prepared.run(_watch(played, cursor, prepared, watch or Watch()))
    if robot is None:
        difference = posture_difference(played, result.record.human.q)
    else:
        difference = goal_difference(played, bus, robot)
    return Replayed(result, difference, (*what_computes(session), *configs.told))


def what_computes(session: Session) -> tuple[str, ...]:
    """What computes it is another than when it was recorded: version, numpy, kind of machine; a sentence each."""
    changed = []
    if session.version != retarget.__version__:
        changed.append(f"recorded by retarget {session.version}, this is {retarget.__version__}")
    for what, was, found in (
        ("with numpy", session.numpy, np.__version__),
        ("on", session.machine, platform.machine()),
    ):
        if was != found:
            changed.append(f"recorded {what} {was}, this is {found}")
    return tuple(changed)


def refuse_other_robot(session: Session, robot: RobotBody) -> None:
    """Raise InputError where the robot has other servos than it had."""
    joints = robot.joint_map.joints
    if joints != session.joints:
        missing = [joint for joint in session.joints if joint not in joints]
        added = [joint for joint in joints if joint not in session.joints]
        found = "; ".join(
            f"{what} {', '.join(names)}" for what, names in (("without", missing), ("with", added)) if names
        )
        raise InputError(
            "the robot has other servos than when it was recorded",
            where=robot.profile.name,
            found=found or "another order of them",
            allowed=f"the profile of then, of {session.robot}, which is attached to the recording",
        )


def _refuse_other_performer(session: Session, performer: Performer) -> None:
    if tuple(performer.sensors) != session.sensors:
        raise InputError(
            "the performer wears other sensors than when it was recorded",
            where=performer.name,
            found=", ".join(performer.sensors),
            allowed=", ".join(session.sensors),
        )


def _watch(played: Played, cursor: Cursor, prepared: Prepared, watch: Watch) -> Watch:
    """Who looks on: it asks for what was asked for then."""
    guard = None if prepared.side is None else prepared.side.guard
    texts = played.recording.texts

    def stop_asked() -> bool:
        cursor.before()
        if guard is not None:
            guard.paused = cursor.asked(Asked.PAUSED)
            if cursor.asked(Asked.OUTSIDE):
                _stop(guard, texts.get((cursor.cycle, "outside"), ""))
        return cursor.asked(Asked.STOP)

    def cut_asked() -> bool:
        cursor.before()
        return cursor.asked(Asked.CUT)

    def on_row(record: Record, row: int) -> None:
        if guard is None:
            cursor.look()

    return Watch(watch.on_tick, stop_asked, cut_asked, lambda: "stopped, as recorded", on_row, watch.every)


def _stop(guard: Guard, told: str) -> None:
    """Stop as somebody outside did; told: cause and reason."""
    name, _, reason = told.partition(": ")
    cause = next((cause for cause in StopCause if cause.value == name), StopCause.REQUESTED)
    guard.stop(reason or "as recorded", cause)
