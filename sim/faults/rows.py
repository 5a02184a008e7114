"""The rows of the fault table: faults of sender, bus, servos and host, and the required reactions."""

import re
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from unittest.mock import patch

import numpy as np

from retarget.live.admission import Datagram
from retarget.types import HumanPosture, RobotPosture
from sim.emulator.faults import Direction, Fault, FaultKind
from sim.faults.bench import BEFORE_ARMING, Bench
from sim.faults.reactions import EVER, Idle, Reaction, Row
from sim.faults.sender import SenderFault, encoded, flapping, frozen, lost, moved, pausing, silent, swapped

# Faults of a sender and its datagrams.

FLOOD_HZ = 130_000.0
_NO_NUMBER = "NaN or Infinity: leave the pose out, or say tracked: false"
_NO_POSE = "pose that is no number or no rotation"
_FIRST_NUMBER = re.compile(rb'"p": \[[^,]+,')


def later(act: Callable[[Bench], object]) -> Callable[[Bench, float], object]:
    """Return an injection that acts when it is due."""
    return lambda bench, at: bench.at(at, lambda: act(bench))


def _sender(make: Callable[[], SenderFault]) -> Callable[[Bench, float], object]:
    return later(lambda bench: bench.sender.faults.append(make()))


def _number(text: bytes) -> Callable[[Bench, float], object]:
    """Replace a number of every position."""

    def garble(time: float, datagram: bytes) -> list[bytes]:
        return [_FIRST_NUMBER.sub(b'"p": [' + text + b",", datagram)]

    return later(lambda bench: bench.sender.garbles.append(garble))


def _no_rotation(bench: Bench) -> None:
    def garble(time: float, datagram: bytes) -> list[bytes]:
        turned = datagram.replace(b"]}", b'], "q": [0.0, 0.0, 0.0, 0.0]}')
        return [turned.replace(b'"axes"', b'"quaternion": "wxyz", "axes"')]

    bench.sender.garbles.append(garble)


def _garbage_in_place(time: float, datagram: bytes) -> list[bytes]:
    return [datagram[: len(datagram) // 2], b"", b"\x00\xff" * 20, datagram, b'{"poses": [[[[']


def _clock_jump(by: float) -> Callable[[Bench, float], object]:
    def jump(bench: Bench) -> None:
        before = bench.sender.stamp
        bench.sender.stamp = lambda time: before(time) + by

    return later(jump)


def _reordered(bench: Bench) -> None:
    kept: list[bytes] = []

    def garble(time: float, datagram: bytes) -> list[bytes]:
        kept.append(datagram)
        del kept[:-3]
        return [kept[-1], kept[-2], kept[-1]] if len(kept) % 3 == 0 else []

    bench.sender.garbles.append(garble)


def _other_sender(address: str) -> Callable[[Bench, float], object]:
    """Let another sender send whole poses."""

    def begin(bench: Bench) -> None:
        def other(first: float, last: float) -> list[Datagram]:
            stamp = bench.sender.stamp(last)  # only its address differs
            payload = encoded(stamp, {name: np.array([5.0, 5.0, 1.0]) for name in bench.sender.frames.names})
            return [Datagram(bench.clock.now(), (address, 50_000), payload)]

        bench.sender.others.append(other)

    return later(begin)


def _flood(bench: Bench) -> None:
    def other(first: float, last: float) -> list[Datagram]:
        begun = bench.sender.begun
        times = np.linspace(first, last, round(FLOOD_HZ * (last - first)), endpoint=False)
        return [Datagram(begun + float(time), ("127.0.0.1", 50_001), b"x" * 64) for time in times]

    bench.sender.others.append(other)


STREAM_ROWS: tuple[Row, ...] = (
    Row("stream silent", Reaction.HOLD, 0.150, _sender(lambda: silent(0.0, EVER))),
    Row("stream silent for ever", Reaction.STOP, 5.0, _sender(lambda: silent(0.0, EVER)), after=5.3),
    Row("stream silent for a while", Reaction.RESUME, 1.3, _sender(lambda: pausing(0.4)), back=0.4, after=1.6),
    Row("flapping stream", Reaction.HOLD, 0.150, _sender(flapping), back=EVER, after=1.6),
    Row("not a number", Reaction.HOLD, 0.150, _number(b"NaN"), counted=_NO_NUMBER),
    Row("infinite number", Reaction.HOLD, 0.150, _number(b"1e999"), counted=_NO_POSE),
    Row("quaternion of zeros", Reaction.HOLD, 0.150, later(_no_rotation), counted=_NO_POSE),
    Row(
        "teleport of a wrist",
        Reaction.HOLD,
        0.150,
        _sender(lambda: moved("r_wrist", 0.0, EVER, (0.0, 0.0, 0.8))),
        said="r_wrist",
        counted="position that no human can have reached",
    ),
    Row(
        "wrist frozen",
        Reaction.OUT,
        0.300,
        _sender(lambda: frozen("l_wrist", 0.0, EVER)),
        sensor="l_wrist",
        said="l_wrist",
    ),
    Row("wrist lost", Reaction.OUT, 0.300, _sender(lambda: lost("l_wrist", 0.0, EVER)), sensor="l_wrist"),
    Row("ankle lost", Reaction.HOLD, 0.300, _sender(lambda: lost("l_ankle", 0.0, EVER))),
    Row("pelvis lost", Reaction.HOLD, 0.300, _sender(lambda: lost("pelvis", 0.0, EVER)), performer="six"),
    Row(
        "left and right swapped",
        Reaction.HOLD,
        0.100,
        _sender(lambda: swapped("l_wrist", "r_wrist", 0.0, EVER)),
        said="jumped farther than a human can",
    ),
    Row("late, reordered, twice", Reaction.NONE, 0.0, later(_reordered), counted="repeated"),
    Row("sender's clock jumps forward", Reaction.REBASE, 1.0, _clock_jump(3600.0), after=1.4),
    Row("sender's clock jumps back", Reaction.REBASE, 1.0, _clock_jump(-3600.0), after=1.4),
    Row(
        "malformed and truncated",
        Reaction.NONE,
        0.0,
        later(lambda bench: bench.sender.garbles.append(_garbage_in_place)),
        counted="not JSON in UTF-8",
    ),
    Row(
        "unlisted source",
        Reaction.NONE,
        0.0,
        _other_sender("10.9.8.7"),
        said="not on the allow-list",
        counted="sender not on the allow-list",
    ),
    Row(
        "second source",
        Reaction.NONE,
        0.0,
        _other_sender("127.0.0.1"),
        said="127.0.0.1:50000 sends too",
        counted="a second source",
    ),
    Row("flood", Reaction.MAY_HOLD, 0.0, later(_flood), idle=Idle.ANY, counted="a second source"),
)


# Faults of the bus and of servos.

BUS = "main"
ELBOW, HEAD = 6, 19
"""Ids of a servo that moves a lot, and of one that hardly does."""
SLIP_RAD = 0.25


def on_line(fault: Fault) -> Callable[[Bench, float], object]:
    """Return the injection of a fault of the emulated line."""
    return later(lambda bench: bench.lines[BUS].faults.add(fault, bench.clock.now()))


def _slip(bench: Bench) -> None:
    """Block a shaft away from its goal."""
    servo, now = bench.servo(HEAD), bench.clock.now()
    servo.jam(True, now)
    servo.shaft.position += SLIP_RAD / servo.servo_model.tick_rad


def _unwritable(bench: Bench) -> None:
    for port in bench.ports.values():
        port.writes_fail = True
    bench.trace.writes_fail = True


def _reset(bench: Bench) -> None:
    bench.servo(ELBOW).reboot(bench.clock.now())


def _garbage() -> Callable[[Bench, float], object]:
    return on_line(Fault(FaultKind.SHORT, value=20.0))


BUS_ROWS: tuple[Row, ...] = (
    Row("servo unplugged", Reaction.STOP, 0.100, on_line(Fault(FaultKind.MISSING, ids=(ELBOW,))), Idle.ONLY_READS),
    Row("1 % of packets damaged", Reaction.NONE, 0.0, on_line(Fault(FaultKind.FLIP, rate=0.01)), Idle.ANY),
    Row("30 % of packets damaged", Reaction.STOP, 0.100, on_line(Fault(FaultKind.FLIP, rate=0.3)), Idle.ANY),
    Row(
        "30 % of answers damaged",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.CRC_STORM, rate=0.3, direction=Direction.TO_HOST)),
        Idle.ANY,
    ),
    Row("garbage on the bus", Reaction.TORQUE_OFF, 0.050, _garbage(), Idle.ONLY_READS, watchdog=0.100),
    Row(
        "every answer damaged",
        Reaction.TORQUE_OFF,
        0.050,
        on_line(Fault(FaultKind.CRC_STORM, direction=Direction.TO_HOST)),
        Idle.ONLY_READS,
        watchdog=0.100,
    ),
    Row("writes fail, reads succeed", Reaction.GONE, 0.120, later(_unwritable), Idle.REFUSES, watchdog=0.120),
    Row(
        "servo warm",
        Reaction.SLOW,
        1.1,
        on_line(Fault(FaultKind.OVER_TEMPERATURE, value=62.0, ids=(ELBOW,))),
        said="hotter than 60",
        after=2.0,
    ),
    Row(
        "servo too hot",
        Reaction.STOP,
        1.1,
        on_line(Fault(FaultKind.OVER_TEMPERATURE, value=78.0, ids=(ELBOW,))),
        Idle.REFUSES,
        said="hotter than 65",
        after=1.2,
    ),
    Row(
        "brown-out of a servo",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.UNDER_VOLTAGE, value=3.0, ids=(ELBOW,), end=0.3)),
        Idle.ANY,
    ),
    Row("reset of a servo", Reaction.STOP, 0.100, later(_reset), Idle.ANY),
    Row(
        "reset of a servo, soon back",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.UNDER_VOLTAGE, ids=(HEAD,), end=0.01)),
        Idle.ANY,
    ),
    Row(
        "overload shutdown", Reaction.STOP, 0.100, later(lambda b: b.servo(ELBOW).overload(b.clock.now())), Idle.REFUSES
    ),
    Row("following error for 0.2 s", Reaction.STOP, 0.250, later(_slip), Idle.ANY),
    Row(
        "adapter unplugged",
        Reaction.TORQUE_OFF,
        0.050,
        on_line(Fault(FaultKind.UNPLUG)),
        Idle.ONLY_READS,
        watchdog=0.100,
    ),
)


# Faults of the host itself.

HOUR_S = 3600.0
OVERRUN = 1.2
"""Periods that a tick takes longer."""
INWARDS = "l_hip_yaw", -1.2, 1.5
"""A joint, the angle (rad) at which the left leg meets the right one, and the speed of the way there (rad/s)."""


def _wall_clock(by: float) -> Callable[[Bench, float], object]:
    """Set the wall clock."""

    def jump(bench: Bench) -> None:
        for patched in (
            patch("time.time", lambda: datetime.now(UTC).timestamp() + by),
            patch("time.time_ns", lambda: int(1e9 * (datetime.now(UTC).timestamp() + by))),
        ):
            patched.start()
            bench.undo.append(patched.stop)

    return later(jump)


def _raising(bench: Bench) -> None:
    def broken(now: float) -> object:
        raise ArithmeticError("forced")

    bench.stream.read = broken  # type: ignore[method-assign, assignment]


def _follower(
    change: Callable[[Bench, RobotPosture], RobotPosture], times: int | None = None
) -> Callable[[Bench], None]:
    """Change the result of the robot's stage, so many times."""

    def inject(bench: Bench) -> None:
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

    return inject


def _cue(bench: Bench) -> Callable[[], None]:
    """Return a function that notes when it is first called."""
    known: list[float] = []

    def cued() -> None:
        if not known:
            known.append(bench.clock.now())
            bench.trace.acted.extend(known)

    return cued


def _when_following(act: Callable[[Bench], None]) -> Callable[[Bench, float], object]:
    """Return an injection into objects that exist once the bus is open; in an idle run it acts before arming."""
    return lambda bench, at: bench.at(max(at, BEFORE_ARMING), lambda: act(bench))


def _late(times: int | None = None) -> Callable[[Bench], None]:
    """Make the search for a goal longer than a tick, so many times."""

    def inject(bench: Bench) -> None:
        left, cued = [times], _cue(bench)

        def dawdle() -> None:
            if left[0] == 0:
                return
            left[0] = None if left[0] is None else left[0] - 1
            cued()
            bench.clock.advance(OVERRUN / bench.robot.profile.safety.rate_hz)

        bench.on_goal.append(dawdle)

    return inject


def _not_finite(bench: Bench, posture: RobotPosture) -> RobotPosture:
    return replace(posture, q=np.full_like(posture.q, np.nan), joint_positions=posture.joint_positions + np.nan)


def _inwards(bench: Bench, posture: RobotPosture) -> RobotPosture:
    """Act as a stage without observers: turn a leg into the other, within all limits of the joint."""
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


# Servos that are not those of the profile. No run may begin, and all are named at once.

XL430 = 1060
"""Model number."""
OLD = 37
"""A firmware before the bus watchdog."""
SLOW_BAUD = 1
"""Register value of 57,600 bits/s."""


def _register(device: int, name: str, value: int) -> Callable[[Bench], None]:
    """Replace a servo by one with another register value."""

    def put(bench: Bench) -> None:
        servo = bench.servo(device)
        servo.memory.put(name, value)
        servo.tune()

    return put


def _everything(bench: Bench) -> None:
    bench.lines["main"].faults.add(Fault(FaultKind.ID_CLASH, ids=(6,)), bench.clock.now())
    for put in (_MODEL, _FIRMWARE, _BAUD):
        put(bench)


_MODEL, _FIRMWARE = _register(9, "model_number", XL430), _register(13, "firmware_version", OLD)
_BAUD = _register(17, "baud_rate", SLOW_BAUD)
START_ROWS: tuple[Row, ...] = (
    Row(
        "id clash",
        Reaction.STOP,
        0.100,
        on_line(Fault(FaultKind.ID_CLASH, ids=(6,))),
        Idle.ONLY_READS,
        refusal=("l_el (id 6)", "two servos have this id"),
    ),
    Row(
        "wrong model",
        Reaction.NONE,
        0.0,
        later(_MODEL),
        Idle.ONLY_READS,
        refusal=("r_hip_roll (id 9)", "XL430-W250", "XM430-W350"),
    ),
    Row(
        "wrong firmware",
        Reaction.NONE,
        0.0,
        later(_FIRMWARE),
        Idle.ONLY_READS,
        refusal=("r_knee (id 13)", "firmware 37", "no bus watchdog"),
    ),
    Row(
        "wrong baud rate",
        Reaction.STOP,
        0.100,
        later(_BAUD),
        Idle.ONLY_READS,
        refusal=("r_ank_roll (id 17)", "57600"),
    ),
    Row(
        "id clash, wrong model, firmware and baud rate",
        Reaction.STOP,
        0.100,
        later(_everything),
        Idle.ONLY_READS,
        refusal=("l_el (id 6)", "r_hip_roll (id 9)", "r_knee (id 13)", "r_ank_roll (id 17)"),
    ),
)


ROWS: tuple[Row, ...] = (*STREAM_ROWS, *HOST_ROWS, *BUS_ROWS, *START_ROWS)
APPROACHED: tuple[Row, ...] = (
    *STREAM_ROWS,
    *(row for row in HOST_ROWS if not row.name.startswith(("solver", "clearance", "wall clock"))),
)
"""Rows that are injected on the approach, too: the posture of a performer is neither solved nor gated there."""
