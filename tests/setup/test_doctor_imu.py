"""The doctor of an IMU: a person who tilts an emulated robot, right and with every sign wrong."""

import math
from collections.abc import Sequence

import pytest

from hardware.clock import VirtualClock
from hardware.dynamixel.bus import CyclicImu
from hardware.dynamixel.cyclic import BusLine
from hardware.imu import STANDARD_GRAVITY, ImuSpec, from_roll_pitch_yaw, rotated
from retarget.model.robot import load_uncalibrated
from retarget.setup.doctor_imu import tilt_findings
from retarget.setup.doctor_machine import DoctorFinding
from sim.emulator.ports import EmulatedPort
from sim.emulator.robot_lines import robot_lines
from sim.imu import Ailment, ImuStandIn, ImuTruth

Quaternion = tuple[float, float, float, float]

DONE_S, ANGLE = 2.0, 0.5
"""[s], [rad] Of a tilt."""


class Hands:
    """A robot that is turned about the axes asked for, one after the other, and put upright in between."""

    def __init__(self, clock: VirtualClock, turns: Sequence[tuple[float, float]]) -> None:
        self._clock, self._turns, self._asked, self._since = clock, turns, -1, 0.0
        self.words: list[str] = []

    def ask(self, text: str) -> None:
        self.words.append(text)
        self._asked, self._since = self._asked + 1, self._clock.now()

    def motion(self) -> ImuTruth:
        roll, pitch = self._turns[self._asked - 1] if self._asked > 0 else (0.0, 0.0)
        share = min((self._clock.now() - self._since) / DONE_S, 1.0)
        w, x, y, z = q = from_roll_pitch_yaw(share * roll, share * pitch, 0.0)
        speed = 1.0 / DONE_S if share < 1.0 else 0.0
        return ImuTruth(q, (roll * speed, pitch * speed, 0.0), rotated((w, -x, -y, -z), (0.0, 0.0, STANDARD_GRAVITY)))


RIGHT = ((0.0, ANGLE), (-ANGLE, 0.0))


def examined(
    turns: Sequence[tuple[float, float]] = RIGHT,
    *,
    mounted: Quaternion | None = None,
    ailment: Ailment | None = None,
) -> list[DoctorFinding]:
    """Findings on an OP3 on the emulator. mounted: the orientation of its board, where it is not the profile's."""
    clock, robot = VirtualClock(), load_uncalibrated("op3")
    spec = robot.profile.imu_spec()
    assert spec is not None
    hands = Hands(clock, turns)
    actual = ImuSpec(spec.kind, spec.link, spec.position, mounted, bus=spec.bus, id=spec.id) if mounted else spec
    sensor = ImuStandIn(actual, motion=hands.motion)
    sensor.ailment = ailment
    (bus,), servos = robot.profile.bus_specs(), robot.joint_map.servos
    start = [servo.zero_tick for servo in servos]
    line = robot_lines(servos, [bus], start=start, now=0.0, powered=True, imu=sensor)["main"]  # type: ignore[arg-type]
    port = EmulatedPort(line, clock)
    port.open(bus.baud)
    imu = CyclicImu(spec, [BusLine(bus, port, list(enumerate(servos)))], lambda bus: port, lambda note: None)
    found = tilt_findings(lambda: imu.sample(clock.now()), clock.sleep_until, clock.now, hands.ask)
    assert len(hands.words) == len(found)
    return found


def test_a_robot_that_is_mounted_as_its_profile_says() -> None:
    found = examined()
    assert [one.level for one in found] == ["ok"] * 3
    for one in found[1:]:
        assert all(abs(float(word) - math.degrees(ANGLE)) < 3.0 for word in one.what.split() if word[0] == "+")


HALF = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("mounted", "ailment", "says"),
    [
        ((1.0, 0.0, 0.0, 0.0), None, "The signs are wrong"),
        ((HALF, 0.0, 0.0, HALF), None, "It did not tilt that way"),
        ((0.0, 1.0, 0.0, 0.0), None, "points up"),
        (None, Ailment.SWAPPED, "The signs are wrong"),
        (None, Ailment.FROZEN, "no valid measurement"),
    ],
    ids=["half turn", "quarter turn", "upside down", "signs swapped", "frozen"],
)
def test_one_that_is_not(mounted: Quaternion | None, ailment: Ailment | None, says: str) -> None:
    found = examined(mounted=mounted, ailment=ailment)
    assert says in " ".join(one.render() for one in found if one.level == "fix")


def test_a_person_who_tilts_it_the_other_way() -> None:
    assert [one.level for one in examined(((0.0, ANGLE), (ANGLE, 0.0)))] == ["ok", "ok", "fix"]
