"""Joint radians <-> servo ticks for all servos of a robot, with direction, zero, gear, coupled pairs and whole
turns."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.errors import BusError, HardwareError, describe
from hardware.servo import ServoSpec

TICK_ROUND_OFF = 1e-6
"""Round-off, ticks, by which a limit may miss its tick."""


def _values(servos: Sequence[ServoSpec], name: str) -> FloatArray:
    return np.array([getattr(servo, name) for servo in servos], dtype=np.float64)


class CoupledPair:
    """Two servos and their two joints, as last axis (..., 2) in the order of the coupling.

    columns (2,): in servo order. tick_rad (2,): largest turn of each joint by one tick of both servos, rad. reach (2,):
    half of it, the rounding error.
    """

    def __init__(self, servos: Sequence[ServoSpec], columns: Sequence[int]) -> None:
        pair = [servos[column] for column in columns]
        coupling = pair[0].coupling
        assert coupling is not None
        self.columns = np.array(columns, dtype=np.intp)
        self._turn = np.array(coupling.matrix, dtype=np.float64).T  # (2, 2) joints = shafts @ it
        self._back = np.array(coupling.inverse, dtype=np.float64).T  # (2, 2) shafts = joints @ it
        self._zero, self._scale = _values(pair, "zero_tick"), _values(pair, "ticks_per_rad")  # (2,) [tick], [tick/rad]
        self._lower, self._upper = _values(pair, "lower"), _values(pair, "upper")  # (2,) [rad]
        self.tick_rad: FloatArray = _combined(1.0 / np.abs(self._scale), np.abs(self._turn))  # (2,) [rad]
        self.reach: FloatArray = self.tick_rad / 2.0

    def turned(self, shafts: FloatArray) -> FloatArray:
        """Return joint angles (or rates) for those of the shafts."""
        return _combined(shafts, self._turn)

    def exact_ticks(self, joints: FloatArray) -> FloatArray:
        """Return unrounded shaft ticks for joint angles, rad."""
        return self._zero + self._scale * _combined(joints, self._back)

    def nearest_ticks(self, joints: FloatArray) -> FloatArray:
        """Return whole shaft ticks for joint angles, rad. A joint inside its limits stays inside: if rounding would
        move it out, the goal is first moved in by `reach`."""
        ticks: FloatArray = np.rint(self.exact_ticks(joints))
        inside = (joints >= self._lower) & (joints <= self._upper)
        back = self.turned((ticks - self._zero) / self._scale)
        room = TICK_ROUND_OFF * self.tick_rad
        over = (inside & ((back < self._lower - room) | (back > self._upper + room))).any(axis=-1, keepdims=True)
        if not over.any():
            return ticks
        moved = np.where(inside, np.clip(joints, self._lower + self.reach, self._upper - self.reach), joints)
        return np.where(over, np.rint(self.exact_ticks(moved)), ticks)

    def tick_ends(self, *, slack: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """The lowest and highest shaft ticks, (2,) each, over all joint angles within the limits and `slack`
        rad."""
        corners = np.array([[low, high] for low in (0, 1) for high in (0, 1)])
        ends = self.exact_ticks(np.where(corners, self._upper + slack, self._lower - slack))
        return ends.min(axis=0), ends.max(axis=0)

    def fastest_shafts(self, max_velocity: FloatArray) -> FloatArray:
        """The highest shaft speeds (2,) for joint speeds `max_velocity` (2,), rad/s."""
        return _combined(max_velocity, np.abs(self._back))


def _combined(pairs: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return vectors (..., 2) @ matrix (2, 2), in a fixed order of operations."""
    return np.asarray(pairs[..., :1] * matrix[0] + pairs[..., 1:] * matrix[1])


def coupling_problems(servos: Sequence[ServoSpec]) -> list[str]:
    """The findings about the couplings of `servos`."""
    by_joint = {servo.joint: servo for servo in servos}
    found: list[str] = []
    for coupling in dict.fromkeys(servo.coupling for servo in servos if servo.coupling is not None):
        problems = list(coupling.problems())
        for joint in coupling.joints:
            if joint not in by_joint:
                problems.append(f"{joint}: coupled, and no servo has it")
            elif by_joint[joint].coupling != coupling:
                problems.append(f"{joint}: its servo does not say that it is coupled, or says it differently")
        problems += [
            f"{servo.joint}: coupled with {' and '.join(coupling.joints)}, and none of them"
            for servo in servos
            if servo.coupling == coupling and servo.joint not in coupling.joints
        ]
        found += problems or _beyond_the_servos([by_joint[joint] for joint in coupling.joints])
    return found


def _beyond_the_servos(pair: Sequence[ServoSpec]) -> list[str]:
    if any(servo.problems() for servo in pair):
        return []  # `ServoSpec.problems` has reported it
    found: list[str] = []
    map_of_pair = CoupledPair(pair, (0, 1))
    names = " and ".join(servo.joint for servo in pair)
    fastest = map_of_pair.fastest_shafts(np.array([servo.max_velocity for servo in pair]))
    for servo, low, high, speed in zip(pair, *map_of_pair.tick_ends(), fastest, strict=True):
        if low < servo.lowest_tick - 0.5 or high > servo.highest_tick + 0.5:
            found.append(
                f"{servo.joint}: the limits of {names} need ticks {low:.0f} to {high:.0f} of servo {servo.id}; "
                f"allowed: {servo.lowest_tick} to {servo.highest_tick} ({servo.model.name}, {servo.mode})"
            )
        if speed > servo.model.no_load_speed:
            found.append(
                f"{servo.joint}: the max_velocity of {names} together need {speed:.3f} rad/s of servo {servo.id}, "
                f"above the no-load speed {servo.model.no_load_speed:.3f} rad/s of {servo.model.name}"
            )
    for servo, reach in zip(pair, map_of_pair.reach, strict=True):
        if servo.upper - servo.lower < 2.0 * reach:
            found.append(f"{servo.joint}: limits {servo.lower} to {servo.upper} rad are closer than the servos' ticks")
    return found


NO_SERVO = -1
"""Goal tick of a joint without a servo."""


class JointMap:
    """Maps arrays whose last axis is the servo order. A column of a coupled pair is one joint in rad, and one of the
    two servos in ticks.

    tick_rad (n,): turn of the joint per tick, rad. Raises HardwareError with all findings when a servo cannot serve its
    joint, or a joint or (bus, id) is repeated.
    """

    def __init__(self, servos: Sequence[ServoSpec]) -> None:
        found = [problem for servo in servos for problem in servo.problems()]
        found += _twice([servo.joint for servo in servos], "joint")
        found += coupling_problems(servos)
        found += _twice([f"{servo.id} on bus {servo.bus!r}" for servo in servos], "servo id")
        if found:
            raise HardwareError(
                "servos do not fit", where="joint map", found="; ".join(found), then="Correct the profile"
            )
        self.servos = tuple(servos)
        self.joints = tuple(servo.joint for servo in servos)
        self.lower, self.upper = _values(servos, "lower"), _values(servos, "upper")  # (n,) [rad]
        self.max_velocity = _values(servos, "max_velocity")  # (n,) [rad/s]
        self.max_acceleration = _values(servos, "max_acceleration")  # (n,) [rad/s^2]
        self._scale, self._zero = _values(servos, "ticks_per_rad"), _values(servos, "zero_tick")  # [tick/rad], [tick]
        self._shaft = _values(servos, "direction") * _values(servos, "gear")  # (n,) joint -> shaft
        self._lowest = np.array([servo.lowest_tick for servo in servos], dtype=np.int64)  # (n,) [tick]
        self._highest = np.array([servo.highest_tick for servo in servos], dtype=np.int64)  # (n,) [tick]
        columns = {joint: column for column, joint in enumerate(self.joints)}
        couplings = dict.fromkeys(servo.coupling for servo in servos if servo.coupling is not None)
        self._pairs = tuple(CoupledPair(servos, [columns[joint] for joint in one.joints]) for one in couplings)
        self.tick_rad: FloatArray = 1.0 / np.abs(self._scale)
        for pair in self._pairs:
            self.tick_rad[pair.columns] = pair.tick_rad
        self._first_inside, self._last_inside = (ends.astype(np.float64) for ends in self.tick_limits())

    def __len__(self) -> int:
        return len(self.servos)

    def to_ticks(self, positions: FloatArray) -> TickArray:
        """Return goal ticks (..., n) for joint `positions` (..., n), rad.

        An angle inside the limits gets a tick inside. Raises HardwareError for a value that is not finite or beyond the
        travel; it is never clipped.
        """
        exact = self._zero + self._scale * positions
        if not self._pairs:  # nearly always: inside or not, a tick that is inside is the one
            rounded = np.rint(exact)
            if (rounded >= self._first_inside).all() and (rounded <= self._last_inside).all():
                return rounded.astype(np.int64)
        inside = (positions >= self.lower) & (positions <= self.upper)
        nearest: FloatArray = np.minimum(np.maximum(np.rint(exact), self._first_inside), self._last_inside)
        for pair in self._pairs:
            exact[..., pair.columns] = pair.exact_ticks(positions[..., pair.columns])
            nearest[..., pair.columns] = pair.nearest_ticks(positions[..., pair.columns])
        if inside.all():
            return nearest.astype(np.int64)
        if not np.isfinite(exact).all():
            bad = ~np.isfinite(positions)
            bad = bad if bad.any() else ~np.isfinite(exact)
            raise HardwareError(self._complaint(positions, bad, "a joint angle is not a finite number"))
        rounded = np.where(inside, nearest, np.rint(exact))
        beyond = (rounded < self._lowest) | (rounded > self._highest)
        if beyond.any():
            raise HardwareError(self._complaint(positions, beyond, "a joint angle is beyond the servo's travel"))
        return rounded.astype(np.int64)

    def check_goals(self, ticks: TickArray, *, where: str) -> None:
        """Raise BusError for goals (n,) that the servos do not accept."""
        if ticks.shape != self._lowest.shape or ((ticks < self._lowest) | (ticks > self._highest)).any():
            allowed = f"{self._lowest} to {self._highest}"
            raise BusError("goal ticks out of range", where=where, found=ticks, allowed=allowed)

    def to_radians(self, ticks: TickArray | FloatArray) -> FloatArray:
        """Return joint positions (..., n), rad, for shaft `ticks` (..., n)."""
        shafts: FloatArray = (ticks - self._zero) / self._scale
        return self._joints(shafts) if self._pairs else shafts

    def turned(self, ticks: TickArray | FloatArray) -> FloatArray:
        """The turn of the joints (..., n), rad, by `ticks` (..., n) of the shafts."""
        shafts: FloatArray = ticks / self._scale
        return self._joints(shafts) if self._pairs else shafts

    def joint_velocity(self, shaft_velocity: FloatArray) -> FloatArray:
        """Return joint velocities (..., n) for shaft velocities (..., n), rad/s."""
        shafts = shaft_velocity / self._shaft
        return self._joints(shafts) if self._pairs else shafts

    def tick_limits(self, *, slack: float = 0.0) -> tuple[TickArray, TickArray]:
        """The first and last whole tick (n,) within the joint limits and `slack` rad, never beyond the
        travel."""
        ends = np.stack(
            [self._zero + self._scale * (self.lower - slack), self._zero + self._scale * (self.upper + slack)]
        )
        ends.sort(axis=0)
        for pair in self._pairs:
            ends[:, pair.columns] = pair.tick_ends(slack=slack)
        first = np.maximum(np.ceil(ends[0] - TICK_ROUND_OFF).astype(np.int64), self._lowest)
        last = np.minimum(np.floor(ends[1] + TICK_ROUND_OFF).astype(np.int64), self._highest)
        return first, last

    def zeros(self, ticks: TickArray, positions: FloatArray) -> TickArray:
        """The zero ticks (n,) for which shaft `ticks` (n,) are joint `positions` (n,), rad."""
        exact = self._zero + self._scale * positions
        for pair in self._pairs:
            exact[pair.columns] = pair.exact_ticks(positions[pair.columns])
        return np.rint(ticks - (exact - self._zero)).astype(np.int64)

    def known_joints(self, valid: BoolArray) -> BoolArray:
        """The mask (n,) of joints known from the servos `valid` (n,). A coupled joint needs both."""
        known = valid.copy()
        for pair in self._pairs:
            known[pair.columns] = valid[pair.columns].all()
        return known

    def _joints(self, shafts: FloatArray) -> FloatArray:
        for pair in self._pairs:
            shafts[..., pair.columns] = pair.turned(shafts[..., pair.columns])
        return shafts

    def spread(self, joints: Sequence[str], ticks: TickArray) -> TickArray:
        """Return `ticks` (..., n) in the order of `joints` (..., m), with NO_SERVO."""
        column = {joint: index for index, joint in enumerate(self.joints)}
        out = np.full((*ticks.shape[:-1], len(joints)), NO_SERVO, dtype=np.int64)
        for index, joint in enumerate(joints):
            if joint in column:
                out[..., index] = ticks[..., column[joint]]
        return out

    def _complaint(self, positions: FloatArray, bad: BoolArray, what: str) -> str:
        index = int(np.argwhere(bad)[0][-1])
        value = float(positions[tuple(np.argwhere(bad)[0])])
        servo = self.servos[index]
        return describe(
            what=what,
            where=f"joint {servo.joint} (servo {servo.id})",
            found=f"{value} rad",
            allowed=f"{servo.lower:.4f} to {servo.upper:.4f} rad",
            then="Send goals through the gate",
        )


def _twice(names: Sequence[str], kind: str) -> list[str]:
    return [f"{kind} {name} is used {names.count(name)} times" for name in sorted(set(names)) if names.count(name) > 1]


LIMIT_SLACK = 0.05
"""[rad] by which a limp joint may lie beyond its limits."""


def resolve_turns(
    joint_map: JointMap, ticks: TickArray, *, groups: Sequence[Sequence[int]] | None = None, slack: float = LIMIT_SLACK
) -> TickArray:
    """The offset (n,), in whole turns, of every reported tick (n,).

    After power-up a servo of many turns reports a position within one. The turn must put the joint within its limits
    and `slack` rad. Raises HardwareError with all joints for which not exactly one turn does. groups: of `turn_groups`;
    None: all.
    """
    offsets = np.zeros(len(joint_map), dtype=np.int64)
    problems: list[str] = []
    for group in map(list, turn_groups(joint_map) if groups is None else groups):
        turns = [_turns(joint_map, column, int(ticks[column]), slack) for column in group]
        shifts = [np.array(shift, dtype=np.int64) for shift in product(*turns)]
        lower, upper = joint_map.lower[group] - slack, joint_map.upper[group] + slack
        angles = [_angles(joint_map, group, ticks[group] + shift) for shift in shifts]
        found = [shift for shift, q in zip(shifts, angles, strict=True) if bool(np.all((q >= lower) & (q <= upper)))]
        if len(found) == 1:
            offsets[group] = found[0]
            continue
        servos = [joint_map.servos[column] for column in group]
        pairs = zip(servos, group, strict=True)
        names = " and ".join(f"{servo.joint} (id {servo.id}) at tick {ticks[column]}" for servo, column in pairs)
        if found:
            places = [
                ", ".join(f"{round(angle, 3) + 0.0:.3f}" for angle in _angles(joint_map, group, ticks[group] + shift))
                for shift in found[:4]
            ]
            problems.append(f"{names}: may be at " + " or at ".join(places) + " rad")
        else:
            limits = " and ".join(f"{servo.lower:.3f} to {servo.upper:.3f}" for servo in servos)
            problems.append(f"{names}: on no turn within {limits} rad")
    if problems:
        raise HardwareError(
            "the turns of these servos are not known",
            where="joint map",
            found="; ".join(problems),
            then="Switch torque off, move these joints to the middle of their ranges, and try again",
        )
    return offsets


def turn_groups(joint_map: JointMap) -> list[list[int]]:
    """The columns of servos of many turns, coupled pairs together."""
    column = {joint: index for index, joint in enumerate(joint_map.joints)}
    groups: dict[tuple[int, ...], None] = {}
    for index, servo in enumerate(joint_map.servos):
        joints = (servo.joint,) if servo.coupling is None else servo.coupling.joints
        members = tuple(column[joint] for joint in joints)
        if any(joint_map.servos[member].mode.many_turns for member in members):
            groups.setdefault(members if servo.coupling else (index,))
    return [list(group) for group in groups]


def _turns(joint_map: JointMap, column: int, tick: int, slack: float) -> list[int]:
    servo = joint_map.servos[column]
    if not servo.mode.many_turns:
        return [0]
    turn = servo.model.ticks
    first, last = (int(ends[column]) for ends in joint_map.tick_limits(slack=slack))
    lowest = -((tick - first) // turn)
    highest = (last - tick) // turn
    return [turn * count for count in range(lowest, highest + 1)]


def _angles(joint_map: JointMap, group: list[int], ticks: TickArray) -> FloatArray:
    every = np.array([servo.zero_tick for servo in joint_map.servos], dtype=np.int64)
    every[group] = ticks
    return joint_map.to_radians(every)[group]
