"""Coupled pairs of servos, as a joint map needs them: ticks of two servos <-> angles of their two joints."""

from collections.abc import Sequence

import numpy as np

from hardware.arrays import FloatArray
from hardware.servo import ServoSpec

ROUND_OFF = 1e-6
"""Round-off, in ticks, by which a limit may miss the tick that it was written for."""


class CoupledPair:
    """Two servos and their two joints; arrays have the pair as last axis (..., 2), in the order of the coupling.

    columns (2,): where the pair stands in the servo order. reach (2,): how far each joint may turn, rad, when both
    servos are rounded to their nearest ticks.
    """

    def __init__(self, servos: Sequence[ServoSpec], columns: Sequence[int]) -> None:
        pair = [servos[column] for column in columns]
        coupling = pair[0].coupling
        assert coupling is not None
        self.columns = np.array(columns, dtype=np.intp)
        self._turn = np.array(coupling.matrix, dtype=np.float64).T  # (2, 2) joints = shafts @ it
        self._back = np.array(coupling.inverse, dtype=np.float64).T  # (2, 2) shafts = joints @ it
        self._zero = np.array([servo.zero_tick for servo in pair], dtype=np.float64)  # (2,) [tick]
        self._scale = np.array([servo.ticks_per_rad for servo in pair], dtype=np.float64)  # (2,) [tick/rad]
        self._lower = np.array([servo.lower for servo in pair], dtype=np.float64)  # (2,) [rad]
        self._upper = np.array([servo.upper for servo in pair], dtype=np.float64)  # (2,) [rad]
        self.tick_rad: FloatArray = (1.0 / np.abs(self._scale)) @ np.abs(self._turn)  # (2,) [rad] a tick of both servos
        self.reach: FloatArray = self.tick_rad / 2.0

    def turned(self, shafts: FloatArray) -> FloatArray:
        """Return joint angles (or their rates) for those of the shafts, both in rad."""
        return shafts @ self._turn

    def exact_ticks(self, joints: FloatArray) -> FloatArray:
        """Return shaft ticks, not rounded, for joint angles in rad."""
        return self._zero + self._scale * (joints @ self._back)

    def nearest_ticks(self, joints: FloatArray) -> FloatArray:
        """Return whole shaft ticks for joint angles in rad; a joint inside its limits never gets beyond them.

        Where rounding alone would put it there, the goal is moved in by `reach`: then any rounding stays inside.
        """
        ticks: FloatArray = np.rint(self.exact_ticks(joints))
        inside = (joints >= self._lower) & (joints <= self._upper)
        back = self.turned((ticks - self._zero) / self._scale)
        room = ROUND_OFF * self.tick_rad
        over = (inside & ((back < self._lower - room) | (back > self._upper + room))).any(axis=-1, keepdims=True)
        if not over.any():
            return ticks
        moved = np.where(inside, np.clip(joints, self._lower + self.reach, self._upper - self.reach), joints)
        return np.where(over, np.rint(self.exact_ticks(moved)), ticks)

    def tick_ends(self, *, slack: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return the lowest and highest shaft tick (2,) of each servo over all joint angles inside the limits, and
        `slack` rad beyond them."""
        corners = np.array([[low, high] for low in (0, 1) for high in (0, 1)])
        ends = self.exact_ticks(np.where(corners, self._upper + slack, self._lower - slack))
        return ends.min(axis=0), ends.max(axis=0)

    def fastest_shafts(self, max_velocity: FloatArray) -> FloatArray:
        """Return the highest shaft speeds (2,) when both joints move at `max_velocity` (2,), all rad/s."""
        speed: FloatArray = max_velocity @ np.abs(self._back)
        return speed


def coupled_pairs(servos: Sequence[ServoSpec]) -> tuple[CoupledPair, ...]:
    """Return the pairs among sound `servos`, by the first of the two."""
    columns = {servo.joint: index for index, servo in enumerate(servos)}
    couplings = dict.fromkeys(servo.coupling for servo in servos if servo.coupling is not None)
    return tuple(CoupledPair(servos, [columns[joint] for joint in coupling.joints]) for coupling in couplings)


def coupling_problems(servos: Sequence[ServoSpec]) -> list[str]:
    """Return what keeps the coupled ones of `servos` from being driven, one text per finding."""
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
    """Findings about limits of two joints that their servos cannot serve."""
    if any(servo.problems() for servo in pair):
        return []  # told already
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
