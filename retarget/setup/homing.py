"""Homing: the operator places the limp robot in a known posture, and the ticks become its servo calibration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.bus import ServoBus
from hardware.clock import Clock
from hardware.errors import BusError, HardwareError, describe
from hardware.joint_map import JointMap
from retarget.schema.servo_calibration import HomedServo, ServoCalibration
from retarget.types import Notify

READS = 25
"""Cycles of a reading."""
PERIOD = 0.02  # [s] between cycles
STILL_RAD = 0.01  # most that a joint may move during a reading
TRIES = 5
"""Readings of a robot that moves before homing fails."""
FAR = 0.35
"""Largest plausible distance from the profile's zero, rad."""
FULL_TURN = 2.0 * np.pi  # [rad]


@dataclass(frozen=True)
class Homing:
    """Result of homing for all n servos. ticks (n,): on the turn that is nearest to the profile's zero. zero (n,): the
    resulting zero ticks. off (n,): shift from the profile's zero, rad. chosen (n,): the servos that are homed."""

    ticks: TickArray
    zero: TickArray
    off: FloatArray
    chosen: BoolArray

    @property
    def far(self) -> BoolArray:
        """Chosen servos (n,) that are far from the profile's zero."""
        return np.asarray(self.chosen & (np.abs(self.off) > FAR))


def homed_columns(joint_map: JointMap, names: Sequence[str]) -> BoolArray:
    """A mask (n,) of the named joints, or of all without names. Raises HardwareError for unknown joints, and for
    one joint of a coupled pair."""
    unknown = [name for name in names if name not in joint_map.joints]
    if unknown:
        raise HardwareError(
            describe(
                what="unknown joints", where="homing", found=", ".join(unknown), allowed=", ".join(joint_map.joints)
            )
        )
    for servo in joint_map.servos:
        pair = servo.coupling.joints if servo.coupling is not None else ()
        if len(set(pair) & set(names)) == 1:
            pair_text = " and ".join(pair)
            raise HardwareError(
                describe(what="coupled joints are homed together", where="homing", then=f"Name both: {pair_text}")
            )
    return np.array([not names or joint in names for joint in joint_map.joints])


def home(
    bus: ServoBus,
    joint_map: JointMap,
    posture: FloatArray,
    confirm: Callable[[str, bool], bool],
    notify: Notify,
    *,
    clock: Clock,
    chosen: BoolArray,
    name: str = "neutral",
) -> Homing | None:
    """Read the servos of an open bus while the operator holds the robot in `posture` (n,), rad, called `name`.

    joint_map: with the zero ticks of the profile. confirm(question, enter): True if the operator agrees; else homing
    ends with None. enter: True if ENTER alone is a yes. Torque stays off. Raises BusError if torque cannot be switched
    off or a servo is silent, HardwareError if the robot is never still.
    """
    if not _limp(bus, confirm, notify):
        return None
    for _ in range(TRIES):
        if not confirm(f"Place the robot in the posture {name!r} and keep it still. Read now?", True):
            return None
        homing = _placed(bus, joint_map, posture, notify, clock=clock, chosen=chosen)
        if isinstance(homing, Homing):
            return homing
    raise HardwareError("the robot is never still", where="homing", found=homing, then="Support it, and try again")


def home_each(
    bus: ServoBus,
    joint_map: JointMap,
    posture: FloatArray,
    confirm: Callable[[str, bool], bool],
    choose: Callable[[str], str],
    notify: Notify,
    *,
    clock: Clock,
    chosen: BoolArray,
    force: bool = False,
) -> Homing | None:
    """Like `home`, joint after joint, for an operator who cannot hold all of them. Coupled joints come together.

    choose(question): "" reads the joint, "s" skips it, "e" ends. A joint that moves, is silent, or is far from the
    profile's zero (without `force`) is tried again. `chosen` of the result: the joints that were read. Returns None if
    there are none. Raises BusError if torque cannot be switched off.
    """
    if not _limp(bus, confirm, notify):
        return None
    groups = _groups(joint_map, chosen)
    read: list[tuple[BoolArray, Homing]] = []
    for number, group in enumerate(groups, 1):
        places = zip(joint_map.servos, posture, group, strict=True)
        where = " and ".join(
            f"{servo.label} at {angle:+.2f} rad ({np.degrees(angle):.0f} degrees)"
            for servo, angle, now in places
            if now
        )
        word = choose(f"[{number}/{len(groups)}] hold {where}, still")
        while not word:
            homing = _read_joint(bus, joint_map, posture, notify, clock=clock, chosen=group, force=force)
            if homing is not None:
                read.append((group, homing))
                break
            word = choose(f"[{number}/{len(groups)}] again: hold {where}, still")
        if word == "e":
            break
    if not read:
        return None
    ticks, zero, off = np.zeros(len(joint_map), np.int64), np.zeros(len(joint_map), np.int64), np.zeros(len(joint_map))
    for group, homing in read:
        ticks[group], zero[group], off[group] = homing.ticks[group], homing.zero[group], homing.off[group]
    return Homing(ticks, zero, off, np.logical_or.reduce([group for group, _ in read]))


def _limp(bus: ServoBus, confirm: Callable[[str, bool], bool], notify: Notify) -> bool:
    if not confirm("Torque goes off now: hold the robot, so that it does not fall. Go on?", False):
        return False
    bus.torque(False)
    notify("Torque is off.")
    return True


def _groups(joint_map: JointMap, chosen: BoolArray) -> list[BoolArray]:
    groups: dict[tuple[str, ...], BoolArray] = {}
    for index, servo in enumerate(joint_map.servos):
        if chosen[index]:
            joints = (servo.joint,) if servo.coupling is None else servo.coupling.joints
            groups.setdefault(joints, np.zeros(len(joint_map), np.bool_))[index] = True
    return [*groups.values()]


def _read_joint(
    bus: ServoBus,
    joint_map: JointMap,
    posture: FloatArray,
    notify: Notify,
    *,
    clock: Clock,
    chosen: BoolArray,
    force: bool,
) -> Homing | None:
    try:
        homing = _placed(bus, joint_map, posture, notify, clock=clock, chosen=chosen)
    except BusError as error:
        notify(str(error))
        return None
    if not isinstance(homing, Homing):
        return None
    for index in np.flatnonzero(chosen):
        notify(f"{joint_map.joints[index]}: tick {homing.ticks[index]}, {homing.off[index]:+.3f} rad off the profile")
    if homing.far.any() and not force:
        notify(f"Allowed are {FAR} rad: is it placed, and are its id and direction right? If so: --force")
        return None
    return homing


def _placed(
    bus: ServoBus, joint_map: JointMap, posture: FloatArray, notify: Notify, *, clock: Clock, chosen: BoolArray
) -> Homing | str:
    """Read the chosen joints. Returns the names of those that moved, after a notice. Raises BusError."""
    read = _read(bus, joint_map, clock, chosen)
    moved: FloatArray = np.ptp(joint_map.to_radians(read), axis=0)
    unsteady = chosen & (moved > STILL_RAD)
    if unsteady.any():
        joints, most = _named(joint_map, unsteady), moved[unsteady].max()
        notify(f"The robot moved: {joints} by up to {most:.3f} rad, where {STILL_RAD:g} rad is allowed.")
        return joints
    ticks = np.rint(np.median(read, axis=0)).astype(np.int64)
    profile = np.array([servo.zero_tick for servo in joint_map.servos])
    far = joint_map.zeros(ticks, posture) - profile
    near = _without_turns(joint_map, far)
    return Homing(ticks - (far - near), profile + near, joint_map.turned(near), chosen)


def calibration_of(
    robot: str, joint_map: JointMap, homing: Homing, posture: FloatArray, *, name: str, date: str
) -> ServoCalibration:
    """Make the calibration of a robot's chosen servos."""
    return ServoCalibration(
        robot=robot,
        servos={
            servo.joint: HomedServo(
                id=servo.id,
                model=servo.model.name,
                homing_offset=servo.homing_offset,
                posture=name,
                angle=float(posture[index]),
                tick=int(homing.ticks[index]),
                date=date,
            )
            for index, servo in enumerate(joint_map.servos)
            if homing.chosen[index]
        },
    )


def _read(bus: ServoBus, joint_map: JointMap, clock: Clock, chosen: BoolArray) -> TickArray:
    """Read ticks (READS, n), without jumps of a whole turn. The last ticks are repeated if a servo is silent. Raises
    BusError if a chosen one is silent in more than half of the cycles."""
    rows, answers = [], []
    begun = clock.now()
    for index in range(READS):
        clock.sleep_until(begun + index * PERIOD)
        states = bus.read()
        rows.append(states.position)
        answers.append(states.valid)
    read, answered = np.array(rows), np.array(answers)
    silent = chosen & (2 * answered.sum(axis=0) < READS)
    if silent.any():
        raise BusError(
            describe(
                what=f"no answer from {_named(joint_map, silent)}",
                where="homing",
                then="Check power and wiring, or home the others with --joints",
            )
        )
    first = read[answered.argmax(axis=0), np.arange(len(joint_map))]  # (n,) the first answer of each servo
    read = np.where(np.maximum.accumulate(answered, axis=0), read, first)
    steady: TickArray = first + _without_turns(joint_map, read - first)
    return steady


def _without_turns(joint_map: JointMap, ticks: TickArray) -> TickArray:
    """Wrap differences of ticks (..., n) to half a turn, for encoders without end."""
    models = [servo.model for servo in joint_map.servos]
    turn = np.array([model.ticks if np.isclose(model.travel, FULL_TURN) else 0 for model in models])
    near: TickArray = ticks - turn * np.rint(ticks / np.maximum(turn, 1)).astype(np.int64)
    return near


def _named(joint_map: JointMap, which: BoolArray) -> str:
    return ", ".join(
        f"{servo.joint} (id {servo.id})" for servo, named in zip(joint_map.servos, which, strict=True) if named
    )
