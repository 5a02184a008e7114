"""How emulated servos behave where the e-Manual is silent: a host can try what no hardware has confirmed."""

from dataclasses import dataclass

from sim.emulator.body import BOOT_TIME
from sim.emulator.conversation import Gaps
from sim.emulator.watchdog import FedBy


@dataclass(frozen=True, slots=True)
class Conduct:
    """Of all servos on the lines of a robot.

    gaps: what a missing servo does to those behind it in a group read. fed_by: which packets feed a bus watchdog (2.0).
    answers_damage: whether a servo says that an instruction to its id came damaged (2.0: error 3, 1.0: 0x10).
    boot_time: s of a start. torque_by_goal: whether a goal position or moving speed switches torque on (1.0).
    """

    gaps: Gaps = Gaps.SILENCE
    fed_by: FedBy = FedBy.ANY
    answers_damage: bool = False
    boot_time: float = BOOT_TIME
    torque_by_goal: bool = True
