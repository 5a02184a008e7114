"""Whole turns of servos after power-up: a servo of many turns then reports one turn, wherever its joint is."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from hardware.arrays import FloatArray, TickArray
from hardware.errors import HardwareError, describe
from hardware.joint_map import JointMap

SLACK = 0.05  # [rad] by which a limp joint may lie beyond its limits


def resolve_turns(
    joint_map: JointMap, ticks: TickArray, *, groups: Sequence[Sequence[int]] | None = None, slack: float = SLACK
) -> TickArray:
    """Return what has to be added to every reported tick (n,), a multiple of the ticks of a turn, (n,).

    Of all whole turns those count that put the joint inside its limits (and `slack` rad beyond). Raises HardwareError
    with all joints for which none is left, or more than one. A servo of one turn is never shifted. groups: of those of
    `turn_groups`; None: all.
    """
    offsets = np.zeros(len(joint_map), dtype=np.int64)
    problems: list[str] = []
    for group in map(list, turn_groups(joint_map) if groups is None else groups):
        turns = [_turns(joint_map, column, int(ticks[column]), slack) for column in group]
        found = [
            shift
            for shift in product(*turns)
            if _inside(joint_map, group, ticks[group] + np.array(shift, dtype=np.int64), slack)
        ]
        if len(found) == 1:
            offsets[group] = found[0]
        else:
            problems.append(_problem(joint_map, group, ticks, found))
    if problems:
        raise HardwareError(
            describe(
                what="the servos do not tell on which turn they are",
                where="joint map",
                found="; ".join(problems),
                then="Switch torque off, move these joints to the middle of their ranges, and try again",
            )
        )
    return offsets


def turn_groups(joint_map: JointMap) -> list[list[int]]:
    """Columns whose turns depend on each other: single servos, and coupled pairs. Only those with a servo of many
    turns."""
    column = {joint: index for index, joint in enumerate(joint_map.joints)}
    groups: dict[tuple[int, ...], None] = {}
    for index, servo in enumerate(joint_map.servos):
        joints = (servo.joint,) if servo.coupling is None else servo.coupling.joints
        members = tuple(column[joint] for joint in joints)
        if any(joint_map.servos[member].mode.many_turns for member in members):
            groups.setdefault(members if servo.coupling else (index,))
    return [list(group) for group in groups]


def _turns(joint_map: JointMap, column: int, tick: int, slack: float) -> list[int]:
    """Shifts of one servo, ticks, that may put its joint (or one of its two) inside the limits."""
    servo = joint_map.servos[column]
    if not servo.mode.many_turns:
        return [0]
    turn = servo.model.ticks
    first, last = (int(ends[column]) for ends in joint_map.tick_limits(slack=slack))
    lowest = -((tick - first) // turn)
    highest = (last - tick) // turn
    return [turn * count for count in range(lowest, highest + 1)]


def _inside(joint_map: JointMap, group: list[int], ticks: TickArray, slack: float) -> bool:
    """Whether the joints of a group lie within their limits and the slack."""
    angles = _angles(joint_map, group, ticks)
    return bool(np.all((angles >= joint_map.lower[group] - slack) & (angles <= joint_map.upper[group] + slack)))


def _angles(joint_map: JointMap, group: list[int], ticks: TickArray) -> FloatArray:
    every = np.array([servo.zero_tick for servo in joint_map.servos], dtype=np.int64)
    every[group] = ticks
    return joint_map.to_radians(every)[group]


def _problem(joint_map: JointMap, group: list[int], ticks: TickArray, found: list[tuple[int, ...]]) -> str:
    servos = [joint_map.servos[column] for column in group]
    names = " and ".join(
        f"{servo.joint} (id {servo.id}) at tick {ticks[column]}" for servo, column in zip(servos, group, strict=True)
    )
    if not found:
        limits = " and ".join(f"{servo.lower:.3f} to {servo.upper:.3f}" for servo in servos)
        return f"{names}: on no turn within {limits} rad"
    places = [
        ", ".join(
            f"{round(angle, 3) + 0.0:.3f}"
            for angle in _angles(joint_map, group, ticks[group] + np.array(shift, dtype=np.int64))
        )
        for shift in found[:4]
    ]
    return f"{names}: may be at " + " or at ".join(places) + " rad"
