"""The rows of the fault table, read from `rows.yaml`: what is injected, what a robot must do, and when.

Injections act on the sender, host, bus and servos of a bench. The table names them.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from enum import Enum
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import yaml

from hardware.guard import CheckedGoal
from hardware.guard_state import StopCause
from retarget.live.admission import Datagram
from retarget.types import FloatArray, RobotPosture, RunState
from sim.emulator.faults import Fault
from sim.faults import sender
from sim.faults.bench import BEFORE_ARMING, Bench
from sim.faults.sender import encoded
from sim.physics.perturbation import Push


class Reaction(Enum):
    """The required reaction of a moving robot."""

    NONE = "goes on"
    MAY_HOLD = "goes on, or holds"
    OUT = "the sensor takes no part"
    HOLD = "holds: brakes and stands, torque on"
    RESUME = "holds, and goes on by itself"
    REBASE = "follows the new clock"
    STAND = "brakes and stands, torque on"
    SLOW = "goes on at half its speed"
    STOP = "stops: brakes, goes to rest, torque off, latched"
    STANDS = "stops: brakes, cannot go to rest, stands with torque on, latched"
    TORQUE_OFF = "torque off at once, latched"
    GONE = "the servos stop by themselves"
    GATED = "the desired posture is not sent"


class Idle(Enum):
    """The required reaction to a fault before the bus is opened."""

    GOES_ON = "begins"
    REFUSES = "does not begin, torque off"
    ONLY_READS = "does not begin, nothing written"
    ANY = "begins or not, torque off in the end"


@dataclass(frozen=True)
class Row:
    """One fault. inject: injects it into a bench at a time (s after following began; below 0: before the bus opens).

    Times are in s from the onset. limit: of the reaction; held: of the hold before it. cause, then: of the reported
    stop, and of the end of its braking. sensor: judged for OUT. said: pattern of a message. counted: reason of unused
    data. watchdog: until every servo has stopped by itself. refusal: texts of the refusal of an idle run. back: until
    data are good again. after: length of following. ends: until the run has ended. performer: the performer file. mass:
    with simulated mechanics behind the wire. recorded: the performer is a recording with a fault of its sensors. alone:
    not run beside another fault. approach: injected on the approach too.

    Beside another fault: chance: factor by which chance may delay the reaction; stretches: factor by which long ticks
    delay the other's; suspends: the host is suspended for the limit; hides: name of a row whose fault it ends.
    """

    name: str
    inject: Callable[[Bench, float], object]
    reaction: Reaction = Reaction.NONE
    limit: float = 0.0
    held: float = 0.150
    idle: Idle = Idle.GOES_ON
    cause: StopCause | None = None
    then: StopCause | None = None
    sensor: str = ""
    said: str = ""
    counted: str = ""
    watchdog: float | None = None
    refusal: tuple[str, ...] = ()
    back: float | None = None
    after: float = 0.55
    ends: float | None = None
    performer: str = "five"
    mass: bool = False
    recorded: bool = False
    alone: bool = False
    approach: bool = False
    chance: float = 1.0
    stretches: float = 1.0
    suspends: bool = False
    hides: str = ""


Act = Callable[..., object]
"""Injects a fault into a bench, now. The arguments after the bench come from the table."""
FLOOD_HZ = 130_000.0
"""Datagrams per second of a flood: about as many as a process can send over loopback."""
OVERRUN = 1.2
"""Delay of a tick, in periods."""
INWARDS = "l_hip_yaw", -1.2, 1.0
"""A joint, the angle (rad) at which the left leg meets the right one, and the speed towards it (rad/s), slow enough for
a robot that has just resumed."""

# Injections into a sender and its datagrams, besides those of `sender`.


def reordered(bench: Bench) -> None:
    """Send datagrams in threes, repeated and out of order."""
    kept: list[bytes] = []

    def garble(time: float, datagram: bytes) -> list[bytes]:
        kept.append(datagram)
        del kept[:-3]
        return [kept[-1], kept[-2], kept[-1]] if len(kept) % 3 == 0 else []

    bench.sender.garbles.append(garble)


def other_sender(bench: Bench, address: str) -> None:
    """Add a sender of whole poses that differs by its address."""

    def other(first: float, last: float) -> list[Datagram]:
        poses = {name: np.array([5.0, 5.0, 1.0]) for name in bench.sender.frames.names}
        return [Datagram(bench.clock.now(), (address, 50_000), encoded(bench.sender.stamp(last), poses))]

    bench.sender.others.append(other)


def flood(bench: Bench) -> None:
    """Add a sender of FLOOD_HZ datagrams per second."""

    def other(first: float, last: float) -> list[Datagram]:
        times = np.linspace(first, last, round(FLOOD_HZ * (last - first)), endpoint=False)
        return [Datagram(bench.sender.begun + float(time), ("127.0.0.1", 50_001), b"x" * 64) for time in times]

    bench.sender.others.append(other)


# Injections into the host.


def wall_clock(bench: Bench, by: float) -> None:
    """Set the wall clock `by` s ahead."""
    for patched in (
        patch("time.time", lambda: datetime.now(UTC).timestamp() + by),
        patch("time.time_ns", lambda: int(1e9 * (datetime.now(UTC).timestamp() + by))),
    ):
        patched.start()
        bench.undo.append(patched.stop)


def raising(bench: Bench) -> None:
    """Raise an exception in the next tick."""

    def broken(now: float) -> object:
        raise ArithmeticError("forced")

    bench.stream.read = broken  # type: ignore[method-assign, assignment]


def rest_refused(bench: Bench) -> None:
    """Let the gate refuse every goal on the trajectory to rest, as it does with an obstacle there."""
    gate, supervisor = bench.machine.gate, bench.machine.supervisor
    check = gate.check

    def refusing(last: CheckedGoal, target: FloatArray | None, **given: Any) -> CheckedGoal | None:
        return None if supervisor.state is RunState.GO_TO_REST else check(last, target, **given)

    gate.check = refusing  # type: ignore[method-assign]


def late(bench: Bench, times: float = np.inf) -> None:
    """Make a tick of a moving robot longer than its period, so many times."""
    seen: list[float] = []

    def delay() -> None:
        if len(seen) < times:
            seen.append(bench.clock.now())
            bench.trace.acted += seen if len(seen) == 1 else []
            bench.clock.advance(OVERRUN / bench.robot.profile.safety.rate_hz)

    bench.delays.append(delay)


def _following(bench: Bench, change: Callable[[RobotPosture], RobotPosture], times: float = np.inf) -> None:
    follower, seen = bench.machine.follower, list[float]()
    start, step = follower.start, follower.step

    def changed(posture: RobotPosture) -> RobotPosture:
        if len(seen) == times:
            return posture
        seen.append(bench.clock.now())
        bench.trace.acted += seen if len(seen) == 1 else []
        return change(posture)

    follower.start = lambda human: changed(start(human))  # type: ignore[method-assign]
    follower.step = lambda human, dt: changed(step(human, dt))  # type: ignore[method-assign]


def not_finite(bench: Bench, times: float = np.inf) -> None:
    """Make the posture of the robot's stage NaN, so many times."""

    def broken(posture: RobotPosture) -> RobotPosture:
        return replace(posture, q=np.full_like(posture.q, np.nan), joint_positions=posture.joint_positions + np.nan)

    _following(bench, broken, times)


def leg_inwards(bench: Bench) -> None:
    """Turn a leg into the other within all limits of the joint, without observers."""
    joint, angle, speed = INWARDS

    def turned(posture: RobotPosture) -> RobotPosture:
        servos, dt = bench.robot.joint_map, 1.0 / bench.robot.profile.safety.rate_hz
        if len(bench.trace.postures) < 2:
            return posture  # nothing has been sent yet
        column = servos.joints.index(joint)
        (_, before), (_, sent) = bench.trace.postures[-2:]
        goal, moved = posture.joint_positions.copy(), sent - before
        change = 0.5 * float(servos.max_acceleration[column]) * dt * dt
        towards = np.clip(angle - sent[column], -speed * dt, speed * dt)
        bench.machine.follower.stop = lambda dt: None  # type: ignore[method-assign]
        goal[column] = sent[column] + np.clip(towards, moved[column] - change, moved[column] + change)
        q = posture.q.copy()
        q[bench.robot.servo_columns] = goal
        bench.trace.desired.append((bench.clock.now(), goal))
        return replace(posture, q=q, joint_positions=goal)

    _following(bench, turned)


# Injections into the bus and into servos.


def line(bench: Bench, **keys: Any) -> None:
    """Begin a fault of the emulated lines. keys: as in a fault file."""
    for one in bench.lines.values():
        one.faults.add(Fault(**keys), bench.clock.now())


def reset(bench: Bench, device: int, boot_time: float | None = None) -> None:
    """Reset a servo, which starts within its boot time, s, or another one."""
    servo = bench.servo(device)
    servo.boot_time = servo.boot_time if boot_time is None else boot_time
    servo.reboot(bench.clock.now())


def slip(bench: Bench, device: int, by: float) -> None:
    """Block a shaft away from its goal, by an angle, rad."""
    servo = bench.servo(device)
    servo.jam(True, bench.clock.now())
    servo.shaft.position += by / servo.servo_model.tick_rad


def press(bench: Bench, frame: str, force: tuple[float, float, float], seconds: float) -> None:
    """Press against a frame of the robot with a force, N."""
    simulation = bench.simulation
    assert simulation is not None, "a robot with mass"
    bench.presses = True
    simulation.push(Push(force, simulation.time, seconds, frame))


def register(bench: Bench, device: int, name: str, value: int) -> None:
    """Replace a servo by one with another register value."""
    servo = bench.servo(device)
    servo.memory.put(name, value)
    servo.tune()


# Injections by their names in the table.


def _sender(make: Callable[..., sender.SenderFault]) -> Act:
    return lambda bench, *words: bench.sender.faults.append(make(*words))


def _garble(make: Callable[..., list[bytes]]) -> Act:
    return lambda bench, *words: bench.sender.garbles.append(lambda time, datagram: make(datagram, *words))


SENDERS = (sender.silent, sender.flapping, sender.pausing, sender.lost, sender.frozen, sender.swapped)
FUNCTIONS = (reordered, other_sender, flood, wall_clock, raising, line, reset, slip, press, register)
ACTS: dict[str, Act] = {
    **{make.__name__: _sender(make) for make in SENDERS},
    **{act.__name__: act for act in FUNCTIONS},
    "moved": _sender(lambda name, by: sender.moved(name, 0.0, sender.EVER, by)),
    "clock_jump": lambda bench, by: bench.sender.jumps.append(by),
    # The first number of every position becomes another text.
    "number": _garble(lambda data, text: [re.sub(rb'"p": \[[^,]+,', b'"p": [' + text.encode() + b",", data)]),
    "no_rotation": _garble(
        lambda data: [
            data.replace(b"]}", b'], "q": [0.0, 0.0, 0.0, 0.0]}').replace(b'"axes"', b'"quaternion": "wxyz", "axes"')
        ]
    ),
    "garbage_in_place": _garble(lambda data: [data[: len(data) // 2], b"", b"\x00\xff" * 20, data, b'{"poses": [[[[']),
    "signal": Bench.interrupt,
    "suspended": lambda bench, length: bench.clock.sleep_until(bench.clock.now() + length),
    "kill": Bench.kill,
    "unwritable": Bench.refuse_writes,
    "overload": lambda bench, device: bench.servo(device).overload(bench.clock.now()),
}
ARMED_ACTS: dict[str, Act] = {
    **{act.__name__: act for act in (late, not_finite, leg_inwards, rest_refused)},
    "operator_stop": lambda bench: bench.guard.latch(StopCause.REQUESTED, "space bar"),
}
"""Injections into objects that exist once the bus is open: in an idle run they act before arming."""


def _injection(entry: object) -> Callable[[Bench, float], object]:
    """The injection of an entry: a name, a mapping from it to arguments, or a list of these."""
    if isinstance(entry, list):
        parts = [_injection(one) for one in entry]
        return lambda bench, at: [part(bench, at) for part in parts]
    ((name, words),) = entry.items() if isinstance(entry, Mapping) else ((str(entry), []),)
    keys = dict(words) if isinstance(words, Mapping) else {}
    places = [] if keys else words if isinstance(words, list) else [words]
    act, earliest = (ARMED_ACTS[name], BEFORE_ARMING) if name in ARMED_ACTS else (ACTS[name], -np.inf)
    return lambda bench, at: bench.at(max(at, earliest), lambda: act(bench, *places, **keys))


TABLE = Path(__file__).with_name("rows.yaml")
ENUMS: dict[str, Any] = {"reaction": Reaction, "idle": Idle, "cause": StopCause, "then": StopCause}


ROWS: tuple[Row, ...] = tuple(
    Row(
        **{key: ENUMS[key][value] if key in ENUMS else value for key, value in entry.items()}
        | {"inject": _injection(entry["inject"]), "refusal": tuple(entry.get("refusal", ()))}
    )
    for entry in yaml.safe_load(TABLE.read_text(encoding="utf-8"))
)
APPROACHED: tuple[Row, ...] = tuple(row for row in ROWS if row.approach)
"""Rows for the approach, where the posture of a performer is neither solved nor gated."""
