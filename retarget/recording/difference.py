"""How a run that was replayed differs from what was recorded: in how many goals, from which tick, by how much."""

from dataclasses import dataclass

import numpy as np

from retarget.recording.cycles import Done
from retarget.recording.played import Played
from retarget.recording.stand_ins import ReplayedBus
from retarget.robot_body import RobotBody
from retarget.rotations import FloatArray

__all__ = ["Difference", "goal_difference", "posture_difference"]


@dataclass(frozen=True)
class Difference:
    """compared: goals (of a human alone: postures) that were recorded. differ: of those, other ones now. first: cycle
    of the first, and time_s since the recording began; None: none. most: by how much at most, in `unit`, and where.
    absent: recorded and not sent now; extra: sent now and not recorded. whole: the recording holds all of its run."""

    compared: int
    differ: int
    first: int | None
    time_s: float | None
    most: float
    ticks: int
    where: str
    unit: str
    absent: int = 0
    extra: int = 0
    whole: bool = True

    @property
    def none(self) -> bool:
        """Whether nothing differs."""
        return not (self.differ or self.absent or self.extra)

    def told(self) -> list[str]:
        """For a person, line by line."""
        what = "goals" if self.unit == "degrees" else "postures"
        if self.none:
            all_of_them = f"all {self.compared} {what}{'' if self.whole else ' that it holds'}"
            return [f"{all_of_them} are as recorded, to the {'tick' if what == 'goals' else 'bit'}"]
        lines = []
        if self.differ:
            at = f"from cycle {self.first}, {self.time_s:.3f} s after the recording began"
            ticks = f" ({self.ticks} ticks)" if what == "goals" else ""
            lines.append(f"{self.differ} of {self.compared} {what} differ, {at}")
            lines.append(f"by {self.most:.3g} {self.unit}{ticks} at most, {self.where}")
        if self.absent:
            lines.append(f"{self.absent} {what} were recorded and are not sent now")
        if self.extra:
            lines.append(f"{self.extra} {what} are sent now and were not recorded")
        return lines


def goal_difference(played: Played, bus: ReplayedBus, robot: RobotBody) -> Difference:
    """Of goals, in ticks. Of a recording without an end, what comes after it is not more than was recorded."""
    cycles = played.cycles
    wrote = np.flatnonzero(cycles.written != Done.NOT)
    now = np.full((len(cycles), cycles.goal.shape[1]), np.iinfo(np.int64).min)
    extra = 0
    for row, goal in bus.sent:
        if row < 0 or cycles.written[row] == Done.NOT or now[row, 0] != np.iinfo(np.int64).min:
            extra += 1
        else:
            now[row] = goal
    sent = wrote[now[wrote, 0] != np.iinfo(np.int64).min]
    off = now[sent] - cycles.goal[sent]
    wrong = np.flatnonzero(off.any(axis=1))
    absent, extra = len(wrote) - len(sent), extra if played.whole else 0
    if not wrong.size:
        return Difference(len(wrote), 0, None, None, 0.0, 0, "", "degrees", absent, extra, played.whole)
    degrees = np.degrees(np.abs(robot.joint_map.to_radians(now[sent]) - robot.joint_map.to_radians(cycles.goal[sent])))
    first = int(sent[wrong[0]])
    at, joint = np.unravel_index(int(degrees.argmax()), degrees.shape)
    return Difference(
        compared=len(wrote),
        differ=len(wrong),
        first=int(cycles.index[first]),
        time_s=_time(played, first),
        most=float(degrees.max()),
        ticks=int(np.abs(off).max()),
        where=f"of {robot.joint_map.joints[joint]} in cycle {int(cycles.index[sent[at]])}",
        unit="degrees",
        absent=absent,
        extra=extra,
        whole=played.whole,
    )


def posture_difference(played: Played, q: FloatArray) -> Difference:
    """Of a human alone: postures now (T, nq), against those that were recorded, in single precision."""
    recorded = played.postures
    both = min(len(recorded), len(q))
    off = np.abs(q[:both].astype(np.float32).astype(np.float64) - recorded[:both])
    wrong = np.flatnonzero((off > 0.0).any(axis=1))
    first = int(wrong[0]) if wrong.size else None
    row, column = np.unravel_index(int(off.argmax()), off.shape) if off.size else (0, 0)
    return Difference(
        compared=len(recorded),
        differ=len(wrong),
        first=None if first is None else int(played.posture_cycles[first]),
        time_s=None if first is None else first * played.recording.session.dt,
        most=float(off.max(initial=0.0)),
        ticks=0,
        where=f"of q[{int(column)}] in cycle {int(row)}",
        unit="m or rad",
        absent=len(recorded) - both,
        extra=0,
        whole=played.whole,
    )


def _time(played: Played, row: int) -> float:
    """When a recorded tick began, s after the first one."""
    clock = played.cycles.clock
    return float(clock[row, 0] - clock[0, 0])
