"""Joint radians <-> servo ticks, with direction, zero, gear and coupled pairs, for all servos of a robot at once."""

from collections.abc import Sequence

import numpy as np

from hardware.arrays import BoolArray, FloatArray, TickArray
from hardware.errors import HardwareError, describe
from hardware.few_values import all_of
from hardware.servo import ServoSpec
from hardware.transmission import ROUND_OFF, coupled_pairs, coupling_problems

NO_SERVO = -1
"""Goal tick of a joint that no servo drives."""


class JointMap:
    """Maps arrays whose last axis is the profile's servo order; leading axes (ticks of time, say) pass through.

    Of a coupled pair each column is a joint in rad and one of its two servos in ticks. tick_rad (n,): how far a tick
    turns the joint, rad; of a coupled joint, a tick of both servos. Raises HardwareError with every finding at once
    when a servo cannot serve its joint, or a joint or (bus, id) is named twice.
    """

    def __init__(self, servos: Sequence[ServoSpec]) -> None:
        found = [problem for servo in servos for problem in servo.problems()]
        found += _twice([servo.joint for servo in servos], "joint")
        found += coupling_problems(servos)
        found += _twice([f"{servo.id} on bus {servo.bus!r}" for servo in servos], "servo id")
        if found:
            raise HardwareError(
                describe(
                    what="servos do not fit", where="joint map", found="; ".join(found), then="Correct the profile"
                )
            )
        self.servos = tuple(servos)
        self.joints = tuple(servo.joint for servo in servos)
        self.lower = np.array([servo.lower for servo in servos], dtype=np.float64)  # (n,) [rad]
        self.upper = np.array([servo.upper for servo in servos], dtype=np.float64)  # (n,) [rad]
        self.max_velocity = np.array([servo.max_velocity for servo in servos], dtype=np.float64)  # (n,) [rad/s]
        self.max_acceleration = np.array(
            [servo.max_acceleration for servo in servos], dtype=np.float64
        )  # (n,) [rad/s^2]
        self._scale = np.array([servo.ticks_per_rad for servo in servos], dtype=np.float64)  # (n,) [tick/rad]
        self._zero = np.array([servo.zero_tick for servo in servos], dtype=np.float64)  # (n,) [tick]
        self._shaft = np.array(
            [servo.direction * servo.gear for servo in servos], dtype=np.float64
        )  # (n,) joint -> shaft
        self._lowest = np.array([servo.lowest_tick for servo in servos], dtype=np.int64)  # (n,) [tick]
        self._highest = np.array([servo.highest_tick for servo in servos], dtype=np.int64)  # (n,) [tick]
        self._pairs = coupled_pairs(servos)
        self.tick_rad: FloatArray = 1.0 / np.abs(self._scale)
        for pair in self._pairs:
            self.tick_rad[pair.columns] = pair.tick_rad
        self._first_inside, self._last_inside = (ends.astype(np.float64) for ends in self.tick_limits())

    def __len__(self) -> int:
        return len(self.servos)

    def to_ticks(self, positions: FloatArray) -> TickArray:
        """Return goal ticks (..., n) for joint `positions` (..., n) in rad.

        Rounds to the nearest tick, except that an angle inside the limits never becomes a tick beyond them. Raises
        HardwareError when a value is not finite or asks for a tick that the servo does not have: that is a defect
        upstream, never clipped here.
        """
        exact = self._zero + self._scale * positions
        if not self._pairs:  # nearly always: inside or not, a tick that is inside is the one
            rounded = np.rint(exact)
            if all_of(rounded >= self._first_inside) and all_of(rounded <= self._last_inside):
                return rounded.astype(np.int64)
        inside = (positions >= self.lower) & (positions <= self.upper)
        nearest: FloatArray = np.minimum(np.maximum(np.rint(exact), self._first_inside), self._last_inside)
        for pair in self._pairs:
            exact[..., pair.columns] = pair.exact_ticks(positions[..., pair.columns])
            nearest[..., pair.columns] = pair.nearest_ticks(positions[..., pair.columns])
        if all_of(inside):
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

    def to_radians(self, ticks: TickArray) -> FloatArray:
        """Return joint positions (..., n) in rad for shaft `ticks` (..., n)."""
        shafts: FloatArray = (ticks - self._zero) / self._scale
        return self._joints(shafts) if self._pairs else shafts

    def turned(self, ticks: TickArray | FloatArray) -> FloatArray:
        """Return by how many rad the joints (..., n) turn when the shafts turn by `ticks` (..., n)."""
        shafts: FloatArray = ticks / self._scale
        return self._joints(shafts) if self._pairs else shafts

    def joint_velocity(self, shaft_velocity: FloatArray) -> FloatArray:
        """Return joint velocities (..., n) in rad/s for shaft velocities (..., n) in rad/s, in the servo's sense of
        rotation."""
        shafts = shaft_velocity / self._shaft
        return self._joints(shafts) if self._pairs else shafts

    def tick_limits(self, *, slack: float = 0.0) -> tuple[TickArray, TickArray]:
        """Return the first and the last whole tick (n,) inside the joint limits, or `slack` rad beyond them; of a
        coupled servo those that some angles of its two joints need. The ends of the travel are never passed."""
        ends = np.stack(
            [self._zero + self._scale * (self.lower - slack), self._zero + self._scale * (self.upper + slack)]
        )
        ends.sort(axis=0)
        for pair in self._pairs:
            ends[:, pair.columns] = pair.tick_ends(slack=slack)
        first = np.maximum(np.ceil(ends[0] - ROUND_OFF).astype(np.int64), self._lowest)
        last = np.minimum(np.floor(ends[1] + ROUND_OFF).astype(np.int64), self._highest)
        return first, last

    def zeros(self, ticks: TickArray, positions: FloatArray) -> TickArray:
        """Return the zero ticks (n,) with which shaft `ticks` (n,) would be joint `positions` (n,) in rad."""
        exact = self._zero + self._scale * positions
        for pair in self._pairs:
            exact[pair.columns] = pair.exact_ticks(positions[pair.columns])
        return np.rint(ticks - (exact - self._zero)).astype(np.int64)

    def heard(self, valid: BoolArray) -> BoolArray:
        """Return which joints (n,) are known when the servos `valid` (n,) are: of a coupled pair both or none."""
        known = valid.copy()
        for pair in self._pairs:
            known[pair.columns] = valid[pair.columns].all()
        return known

    def _joints(self, shafts: FloatArray) -> FloatArray:
        """Make joint values of shaft values (..., n), in place: those of coupled pairs differ."""
        for pair in self._pairs:
            shafts[..., pair.columns] = pair.turned(shafts[..., pair.columns])
        return shafts

    def spread(self, joints: Sequence[str], ticks: TickArray) -> TickArray:
        """Return `ticks` (..., n) in the order of `joints` (..., m), with NO_SERVO (-1) where no servo drives the
        joint."""
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
    """Findings about `names` that appear more than once."""
    return [f"{kind} {name} is used {names.count(name)} times" for name in sorted(set(names)) if names.count(name) > 1]
