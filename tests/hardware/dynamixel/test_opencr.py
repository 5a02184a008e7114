"""The OpenCR board: its IMU as bytes, and read within the cycle of a bus."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bus_rig import CYCLE, Tapped, bus_of, specs
from hardware.bus import ServoGoals
from hardware.clock import VirtualClock
from hardware.dynamixel.bus import DynamixelBus
from hardware.dynamixel.codec import protocol2
from hardware.dynamixel.opencr import ID, IMU_FIRST, TABLE, imu_reading
from hardware.imu import STANDARD_GRAVITY, ImuFault, ImuKind, ImuSample, ImuSpec, from_roll_pitch_yaw
from hardware.joint_map import JointMap
from sim.bno08x import EmulatedBno08x
from sim.emulator.faults import Fault, FaultKind
from sim.emulator.line import Line
from sim.emulator.ports import EmulatedPort
from sim.emulator.robot_lines import robot_lines
from sim.imu import ImuStandIn

COUNTS = st.integers(-0x8000, 0x7FFF)
TICK = 0.002
"""[s] From reading the servos to writing their goals."""
BOARD = ImuSpec(ImuKind.OPENCR, "body", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), bus="main", id=ID)
BNO = ImuSpec(ImuKind.BNO08X, "body", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), port="/dev/imu")


class Rig:
    """Twenty servos and the board at 2 Mbps, in the rhythm of a robot. took: of each cycle, s, its tick left out."""

    def __init__(self, imu: ImuSpec | None = BOARD) -> None:
        servos = specs(20)
        main = replace(bus_of(servos), ids=(*range(1, 21), ID))
        self.clock, self.notes, self.took = VirtualClock(), list[str](), list[float]()
        self.sensor = ImuStandIn(imu)
        start = np.full(20, 2048)
        self.line: Line = robot_lines(servos, [main], start=start, now=0.0, powered=True, imu=self.sensor)["main"]

        self.port = Tapped(self.line, self.clock, name="main")

        def port(spec: object) -> EmulatedPort | EmulatedBno08x:
            return self.port if spec is main else EmulatedBno08x(self.sensor, self.clock)

        self.bus = DynamixelBus(JointMap(servos), [main], port, imu=imu, notify=self.notes.append)
        self.bus.open()
        self.bus.write(ServoGoals(self.bus.read().position))
        self.bus.torque(True)
        self._due = self.clock.now()
        self.run(1)  # behind its goals the IMU is asked for the first time

    @property
    def asked(self) -> int:
        """How often the board was asked."""
        return self.port.sent.count(protocol2.read(ID, IMU_FIRST, 18))

    def run(self, cycles: int, *, tick: float = TICK) -> list[ImuSample]:
        """Run cycles, in each of which all servos must answer."""
        found = []
        for _ in range(cycles):
            begun = self.clock.now()
            states = self.bus.read()
            self.clock.advance(tick)
            self.bus.write(ServoGoals(states.position))
            self.took.append(self.clock.now() - begun - tick)
            assert states.complete and states.retries == 0
            if states.imu is not None:
                found.append(states.imu)
            self._due = max(self._due + CYCLE, self.clock.now())
            self.clock.sleep_until(self._due)
        return found


# Registers by name: what public firmware and a public host of other authors have.


def test_its_registers() -> None:
    places = {"dynamixel_power": 24, "led_rgb": 26, "button": 30, "present_voltage": 31, "imu_control": 50}
    places |= {"gyro_x": 32, "gyro_y": 34, "gyro_z": 36, "acc_x": 38, "acc_y": 40, "acc_z": 42}
    places |= {"roll": 44, "pitch": 46, "yaw": 48, "id": 3, "firmware_version": 2}
    assert {name: TABLE[name].address for name in places} == places
    assert TABLE.number == 0x7400 and all(TABLE[name].signed for name in ("gyro_x", "acc_z", "yaw"))


def test_the_units_of_a_reading() -> None:
    reading = imu_reading(struct.pack("<9h", 164, -1640, 0, 0, -16384, 16384, 300, -100, 1800))
    assert reading is not None
    assert reading.angular_velocity == pytest.approx((math.radians(10.0), math.radians(-100.0), 0.0))
    assert reading.acceleration == pytest.approx((0.0, -STANDARD_GRAVITY, STANDARD_GRAVITY))
    assert reading.orientation == pytest.approx(from_roll_pitch_yaw(math.radians(30.0), math.radians(-10.0), math.pi))


@given(st.tuples(*[COUNTS] * 9))
def test_no_bytes_raise_and_full_scale_is_no_value(counts: tuple[int, ...]) -> None:
    reading = imu_reading(struct.pack("<9h", *counts))
    beyond = max(map(abs, counts[:3])) >= 32767 or max(map(abs, counts[6:])) > 3600
    assert (reading is None) is beyond


def test_it_is_read_with_the_servos_and_costs_their_cycle_nothing() -> None:
    """It answers while the host computes: a tick of 3 ms leaves less time (measured: 1.06)."""
    for tick, ratio in ((TICK, 1.01), (0.003, 1.1)):
        without, rig = Rig(None), Rig()
        assert not without.run(100, tick=tick)
        samples = rig.run(100, tick=tick)
        assert all(sample.valid and sample.age < 2 * CYCLE for sample in samples)
        assert float(np.mean(rig.took[10:])) <= ratio * float(np.mean(without.took[10:]))
    assert all(sample.valid for sample in Rig().run(50, tick=0.0)), "goals that come at once wait for its answer"
    assert samples[-1].time > samples[-3].time and not rig.notes[1:]
    roll, pitch = samples[-1].tilt
    assert (
        abs(roll) < 0.03
        and abs(pitch) < 0.03
        and samples[-1].acceleration[2] == pytest.approx(STANDARD_GRAVITY, abs=0.5)
    )


def test_goals_that_come_twice_do_not_meet_its_answer() -> None:
    """A servo does not hear what is sent while the board answers."""
    rig = Rig()
    states = rig.bus.read()
    for step in range(1, 20):
        rig.bus.write(ServoGoals(states.position))
        rig.clock.advance(0.0007)  # goals and request are on the wire by then
        rig.bus.write(ServoGoals(states.position + step))
        rig.clock.advance(0.002)
        rig.bus.read()
        heard = rig.line.devices[0].read(116, 4, rig.clock.now()).data
        assert int.from_bytes(heard, "little") == states.position[0] + step


def test_a_robot_that_is_only_read_has_it_too() -> None:
    rig = Rig()
    for _ in range(5):
        states = rig.bus.read()
        assert states.imu is not None and states.imu.valid and states.complete
        rig.clock.advance(CYCLE)
    rig.bus.torque(False)
    rig.clock.advance(1.0)
    rig.bus.read()
    for _ in range(5):
        states = rig.bus.read()
        assert states.imu is not None and states.imu.valid and states.imu.age < CYCLE and not states.driven.any()
        rig.clock.advance(1.0)


def test_a_silent_board_disturbs_no_servo_and_is_found_again() -> None:
    rig = Rig()
    rig.run(20)
    usual, before = max(rig.took), rig.asked
    rig.line.faults.add(Fault(FaultKind.MISSING, ids=(ID,), end=0.5), rig.clock.now())
    silent = rig.run(60)
    assert not silent[-1].valid and silent[-1].age > 0.3
    assert max(rig.took) < usual + 0.0025
    assert 3 < rig.asked - before < 10  # three times, then every tenth of a second
    assert ImuFault.SILENT.value in "".join(rig.notes)
    assert rig.run(40)[-1].valid


@pytest.mark.parametrize(
    ("kind", "fault"), [(FaultKind.IMU_FROZEN, ImuFault.FROZEN), (FaultKind.IMU_SPIKES, ImuFault.IMPOSSIBLE)]
)
def test_a_board_that_is_broken_is_not_believed(kind: FaultKind, fault: ImuFault) -> None:
    rig = Rig()
    assert all(sample.valid for sample in rig.run(30))
    rig.line.faults.add(Fault(kind), rig.clock.now())
    assert not all(sample.valid for sample in rig.run(50))
    assert [fault.value in note for note in rig.notes].count(True) == 1


def test_damaged_answers_are_never_a_wrong_sample() -> None:
    rig = Rig()
    rig.run(5)
    rig.line.faults.add(Fault(FaultKind.FLIP, ids=(ID,), rate=0.5), rig.clock.now())
    for sample in rig.run(200):
        assert abs(sample.tilt[0]) < 0.03 and np.abs(sample.angular_velocity).max() < 0.05
        assert sample.acceleration[2] == pytest.approx(STANDARD_GRAVITY, abs=0.5)


def test_a_serial_sensor_beside_the_bus_costs_nothing_unplugged_or_not() -> None:
    without, rig = Rig(None), Rig(BNO)
    without.run(50)
    samples = rig.run(50)
    assert all(sample.valid for sample in samples[-40:])
    assert max(rig.took) <= max(without.took)
    assert rig.bus.imu is not None and rig.bus.imu.port is not None
    rig.bus.imu.port.close()
    assert not rig.run(20)[-1].valid
