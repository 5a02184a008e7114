"""Rows of the fault table: what goes wrong in the host itself, or is done to it."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from unittest.mock import patch

import numpy as np

from retarget.follow import RobotPosture
from retarget.human_posture import HumanPosture
from sim.faults.bench import BEFORE_ARMING, Bench
from sim.faults.reaction import Idle, Reaction, Row
from sim.faults.stream_rows import later

__all__ = ["HOST_ROWS"]

HOUR_S = 3600.0
OVERRUN = 1.2
"""Periods that a tick takes longer."""
INWARDS = "l_hip_yaw", -1.2, 1.5
"""A joint, rad, that turns the left leg into the right one, and the speed (rad/s) at which it is asked for."""


def _wall_clock(by: float) -> Callable[[Bench, float], object]:
    """Somebody sets the wall clock."""

    def leap(bench: Bench) -> None:
        for patched in (
            patch("time.time", lambda: datetime.now(UTC).timestamp() + by),
            patch("time.time_ns", lambda: int(1e9 * (datetime.now(UTC).timestamp() + by))),
        ):
            patched.start()
            bench.undo.append(patched.stop)

    return later(leap)


def _raising(bench: Bench) -> None:
    def broken(now: float) -> object:
        raise ArithmeticError("forced")

    bench.stream.read = broken  # type: ignore[method-assign, assignment]


def _follower(
    change: Callable[[Bench, RobotPosture], RobotPosture], times: int | None = None
) -> Callable[[Bench], None]:
    """What the robot's stage finds is something else, so many times."""

    def hurt(bench: Bench) -> None:
        follower, left = bench.side._follower, [times]
        step, cued = follower.step, _cue(bench)

        def changed(human: HumanPosture, dt: float) -> RobotPosture:
            posture = step(human, dt)
            if left[0] == 0:
                return posture
            left[0] = None if left[0] is None else left[0] - 1
            cued()
            return change(bench, posture)

        follower.step = changed  # type: ignore[method-assign]

    return hurt


def _cue(bench: Bench) -> Callable[[], None]:
    """Notes when it is first called."""
    known: list[float] = []

    def cued() -> None:
        if not known:
            known.append(bench.clock.now())
            bench.trace.acted.extend(known)

    return cued


def _when_following(act: Callable[[Bench], None]) -> Callable[[Bench, float], object]:
    """Done to what is there only once the bus is open; of an idle run: before it arms."""
    return lambda bench, at: bench.at(max(at, BEFORE_ARMING), lambda: act(bench))


def _late(times: int | None = None) -> Callable[[Bench], None]:
    """To find a goal takes longer than a tick may, so many times."""

    def hurt(bench: Bench) -> None:
        left, cued = [times], _cue(bench)

        def dawdle() -> None:
            if left[0] == 0:
                return
            left[0] = None if left[0] is None else left[0] - 1
            cued()
            bench.clock.advance(OVERRUN / bench.robot.profile.safety.rate_hz)

        bench.thinking.append(dawdle)

    return hurt


def _not_finite(bench: Bench, posture: RobotPosture) -> RobotPosture:
    return replace(posture, q=np.full_like(posture.q, np.nan), joint_positions=posture.joint_positions + np.nan)


def _inwards(bench: Bench, posture: RobotPosture) -> RobotPosture:
    """A stage that has lost its observers turns a leg into the other, within all limits of the joint."""
    joint, angle, speed = INWARDS
    servos, dt = bench.robot.joint_map, 1.0 / bench.robot.profile.safety.rate_hz
    if not bench.side._sent.size:
        return posture  # nothing has been sent yet
    column = servos.joints.index(joint)
    goal, sent, moved = posture.joint_positions.copy(), bench.side._sent, bench.side._moved
    change = 0.5 * float(servos.max_acceleration[column]) * dt * dt
    way = np.clip(angle - sent[column], -speed * dt, speed * dt)
    goal[column] = sent[column] + np.clip(way, moved[column] - change, moved[column] + change)
    q = posture.q.copy()
    q[bench.robot.servo_columns] = goal
    bench.trace.asked.append((bench.clock.now(), goal))
    return replace(posture, q=q, joint_positions=goal)


def _suspended(bench: Bench) -> None:
    bench.clock.advance(1.0)


def _signal(bench: Bench) -> None:
    bench.stop_asked = True


HOST_ROWS: tuple[Row, ...] = (
    Row("wall clock an hour on", Reaction.NONE, 0.0, _wall_clock(HOUR_S)),
    Row("wall clock an hour back", Reaction.NONE, 0.0, _wall_clock(-HOUR_S)),
    Row("solver not finite", Reaction.STAND, 0.050, _when_following(_follower(_not_finite)), Idle.REFUSES),
    Row("solver not finite once", Reaction.MAY_HOLD, 0.0, _when_following(_follower(_not_finite, 1)), Idle.REFUSES),
    Row("deadline missed", Reaction.HOLD, 0.030, _when_following(_late())),
    Row("deadline missed once", Reaction.NONE, 0.0, _when_following(_late(1))),
    Row("clearance below margin", Reaction.GATED, 0.0, _when_following(_follower(_inwards)), after=1.2),
    Row("exception in the tick", Reaction.STOP, 0.020, later(_raising), Idle.ANY, said=""),
    Row("kill -9", Reaction.GONE, 0.120, later(Bench.kill), Idle.ONLY_READS, watchdog=0.120),
    Row("stopped for a second", Reaction.STOP, 1.020, later(_suspended), watchdog=0.120),
    Row("SIGINT, SIGTERM", Reaction.STOP, 0.020, later(_signal), ends=4.0),
    Row(
        "person stops it",
        Reaction.STOP,
        0.020,
        _when_following(lambda bench: bench.guard.stop("space bar")),
        Idle.REFUSES,
    ),
)
