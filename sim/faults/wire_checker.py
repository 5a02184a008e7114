"""Judges what a host put on the wires, from the bytes alone: goals inside limits, slow enough, none after a latch.

Shares nothing with the code that it judges: frames of protocol 2.0 are taken apart here once more.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from struct import unpack_from

import numpy as np

from hardware.servo import ServoSpec
from retarget.rotations import FloatArray

HEADER = b"\xff\xff\xfd\x00"
SYNC_WRITE = 0x83
GOAL_POSITION, GOAL_SIZE = 116, 4
TICKS_OF_TOLERANCE = 3
"""Ticks by which a difference of goals may miss a limit: goals are rounded, once for each of the goals in it."""
LATE_S = 0.5
"""Goals further apart than this are no motion from one to the other: torque was off in between."""


@dataclass(frozen=True)
class Sent:
    """A packet of the host. time: s."""

    time: float
    data: bytes


def goal_writes(sent: Sequence[Sent]) -> list[tuple[float, dict[int, int]]]:
    """Times (s) and goals (ticks by id) of every sync write of goal positions."""
    found = []
    for packet in sent:
        at = packet.data.find(HEADER)
        while at >= 0:
            length = int.from_bytes(packet.data[at + 5 : at + 7], "little")
            body = packet.data[at + 7 : at + 7 + length - 2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            if len(body) > 5 and body[0] == SYNC_WRITE and body[1:5] == bytes((GOAL_POSITION, 0, GOAL_SIZE, 0)):
                items = range(5, len(body) - GOAL_SIZE, GOAL_SIZE + 1)
                found.append((packet.time, {body[k]: unpack_from("<i", body, k + 1)[0] for k in items}))
            at = packet.data.find(HEADER, at + 7)
    return found


def violations(sent: Sequence[Sent], servos: Sequence[ServoSpec], dt: float, *, latched: float | None) -> list[str]:
    """What is wrong with the goals of plain servos (no couplings), a line each. latched: s, when the guard latched a
    stop that leaves nothing to send."""
    writes = _once(goal_writes(sent), within=0.5 * dt)
    found = [f"a goal {time - latched:.3f} s after the latch" for time, _ in writes if latched and time > latched]
    for servo in servos:
        times = np.array([time for time, goals in writes if servo.id in goals])
        ticks = np.array([goals[servo.id] for _, goals in writes if servo.id in goals], dtype=np.float64)
        if ticks.size:
            found += _of_servo(servo, times, (ticks - servo.zero_tick) / servo.ticks_per_rad, dt)
    return found


def _once(writes: Sequence[tuple[float, dict[int, int]]], *, within: float) -> list[tuple[float, dict[int, int]]]:
    """Goals that are sent again at once, as on a noisy line, are one goal."""
    found: list[tuple[float, dict[int, int]]] = []
    for time, goals in writes:
        if not (found and goals == found[-1][1] and time - found[-1][0] < within):
            found.append((time, goals))
    return found


def _of_servo(servo: ServoSpec, times: FloatArray, angle: FloatArray, dt: float) -> list[str]:
    """One servo's goals (T,), rad of the joint."""
    step = servo.model.tick_rad / servo.gear
    found = []
    beyond = max(float((servo.lower - angle).max()), float((angle - servo.upper).max()))
    if beyond > step:
        found.append(f"{servo.label}: {beyond:.3f} rad beyond its limits")
    moved, apart = np.diff(angle), np.diff(times)
    near = apart < LATE_S
    fast = np.abs(moved[near]) - servo.max_velocity * dt - TICKS_OF_TOLERANCE * step
    if fast.size and fast.max() > 0.0:
        found.append(f"{servo.label}: {fast.max() / dt:.2f} rad/s too fast")
    both = near[1:] & near[:-1]
    hard = np.abs(np.diff(moved))[both] - servo.max_acceleration * dt**2 - 2 * TICKS_OF_TOLERANCE * step
    if hard.size and hard.max() > 0.0:
        found.append(f"{servo.label}: {hard.max() / dt**2:.0f} rad/s^2 too hard")
    return found
