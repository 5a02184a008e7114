"""Homing on the mock bus: zeros that differ from the profile's are measured; moving or silent servos are reported."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bus_rig import four_servos, waist_servos
from faulty_bus import FaultKind, FaultyBus, MockFault
from hardware.arrays import FloatArray, TickArray
from hardware.bus import ServoStates
from hardware.clock import VirtualClock
from hardware.errors import BusError, HardwareError
from hardware.joint_map import JointMap
from hardware.servo import ServoSpec
from messages import refuses, shows
from retarget.setup.homing import FAR, READS, TRIES, Homing, calibration_of, home, home_each, homed_columns

ALL_SERVOS = np.ones(4, dtype=np.bool_)


class Person:
    """An operator who gives these answers, then yes, and keeps the questions and messages."""

    def __init__(self, *answers: bool) -> None:
        self._answers = list(answers)
        self.asked: list[str] = []
        self.enter: list[bool] = []
        self.messages: list[str] = []

    def ask(self, question: str, enter: bool) -> bool:
        self.asked.append(question)
        self.enter.append(enter)
        return self._answers.pop(0) if self._answers else True

    def notify(self, text: str) -> None:
        self.messages.append(text)


class ShakingBus(FaultyBus):
    """A bus whose robot is held by a shaking hand: `shake(reads, ticks)` changes the ticks of each read."""

    shake: Callable[[int, TickArray], TickArray]
    reads = 0

    def read(self) -> ServoStates:
        self.reads += 1
        states = super().read()
        return replace(states, position=self.shake(self.reads, states.position))


def run(
    servos: tuple[ServoSpec, ...],
    ticks: TickArray,
    posture: FloatArray,
    person: Person,
    *faults: MockFault,
    shake: Callable[[int, TickArray], TickArray] | None = None,
    chosen: np.ndarray[tuple[int], np.dtype[np.bool_]] = ALL_SERVOS,
) -> tuple[Homing | None, FaultyBus]:
    clock = VirtualClock()
    bus = ShakingBus(servos, clock, start=ticks, faults=faults)
    bus.shake = shake or (lambda _, position: position)
    bus.open()
    if not faults:
        bus.torque(True)
    return home(bus, JointMap(servos), posture, person.ask, person.notify, clock=clock, chosen=chosen), bus


@pytest.mark.parametrize("servos", [four_servos(), waist_servos()], ids=["plain", "coupled"])
def test_zeros_that_are_elsewhere_are_found(servos: tuple[ServoSpec, ...]) -> None:
    shift = np.array([37, -20, 55, 0])
    truth = JointMap(
        [replace(spec, zero_tick=spec.zero_tick + int(by)) for spec, by in zip(servos, shift, strict=True)]
    )
    posture = truth.to_radians(truth.to_ticks(0.4 * truth.upper))
    homing, bus = run(servos, truth.to_ticks(posture), posture, Person())
    assert homing is not None and not bus.torque_on
    assert homing.zero.tolist() == [spec.zero_tick for spec in truth.servos]
    np.testing.assert_allclose(homing.off, JointMap(servos).turned(shift), atol=1e-12)
    assert not homing.far.any()


def test_the_seam_of_the_encoder_is_no_motion() -> None:
    servos = (replace(four_servos()[0], zero_tick=2048), *four_servos()[1:])
    ticks = np.array([4095, 2100, 2048, 512])

    def seam(reads: int, position: TickArray) -> TickArray:
        return np.asarray(position - np.array([4095 if reads % 2 else 0, 0, 0, 0]))

    homing, _ = run(servos, ticks, np.zeros(4), Person(), shake=seam)
    # Half a turn from the profile's zero, either way: the middle of what was read, not of 0 and 4095.
    assert homing is not None and abs(abs(int(homing.ticks[0]) - 2048) - 2048) <= 1
    assert homing.far.tolist() == [True, False, False, False]


def test_far_from_the_profile_is_marked_and_only_where_chosen() -> None:
    ticks = JointMap(four_servos()).to_ticks(np.zeros(4))
    ticks[0] += round((FAR + 0.01) * 2048 / np.pi)
    ticks[1] -= round((FAR - 0.01) * 2048 / np.pi)
    homing, _ = run(four_servos(), ticks, np.zeros(4), Person())
    assert homing is not None and homing.far.tolist() == [True, False, False, False]
    others = homed_columns(JointMap(four_servos()), ["elbow", "waist"])
    homing, _ = run(four_servos(), ticks, np.zeros(4), Person(), chosen=others)
    assert homing is not None and not homing.far.any()
    calibration = calibration_of("r", JointMap(four_servos()), homing, np.zeros(4), name="rest", date="2026-02-03")
    assert list(calibration.servos) == ["elbow", "waist"]
    assert (calibration.servos["elbow"].tick, calibration.servos["elbow"].id) == (int(ticks[1]), 2)


def test_a_hand_that_shakes_is_asked_again() -> None:
    def shake(reads: int, position: TickArray) -> TickArray:
        return np.asarray(position + np.array([0, 20 * (reads < READS and reads % 2), 0, 0]))

    person = Person()
    homing, _ = run(four_servos(), JointMap(four_servos()).to_ticks(np.zeros(4)), np.zeros(4), person, shake=shake)
    assert homing is not None and len(person.asked) == 3
    assert person.enter == [False, True, True]
    shows(person.asked[0])
    shows(person.messages[1], "elbow", 2, "0.031", "0.01")
    assert homing.zero.tolist() == [servo.zero_tick for servo in four_servos()]


def test_a_hand_that_never_rests_is_given_up() -> None:
    person = Person()
    with refuses(HardwareError, "elbow", 2):
        run(four_servos(), np.array([2048, 2100, 2048, 512]), np.zeros(4), person,
            shake=lambda reads, position: position + np.array([0, 20 * (reads % 2), 0, 0]))  # fmt: skip
    assert len(person.asked) == 1 + TRIES


@pytest.mark.parametrize(("answers", "torque"), [((False,), True), ((True, False), False)])
def test_without_the_operators_consent_nothing_more_changes(answers: tuple[bool, ...], torque: bool) -> None:
    homing, bus = run(four_servos(), np.array([2048, 2100, 2048, 512]), np.zeros(4), Person(*answers))
    assert homing is None and bus.torque_on is torque


def test_a_servo_that_loses_some_answers_is_read_all_the_same() -> None:
    def missing(cycles: int) -> Homing | None:
        clock, person, joint_map = VirtualClock(), Person(), JointMap(four_servos())
        gap = MockFault(FaultKind.MISSING, first=0, cycles=cycles, servo=1)
        bus = FaultyBus(four_servos(), clock, start=np.array([2048, 2110, 2048, 512]), faults=[gap])
        bus.open()
        bus.torque = lambda on: None  # type: ignore[method-assign]  # the fault is of reads here, not of torque
        return home(bus, joint_map, np.zeros(4), person.ask, person.notify, clock=clock, chosen=ALL_SERVOS)

    homing = missing(READS // 2)
    assert homing is not None and homing.zero[1] == 2110
    with refuses(BusError, "elbow", 2):
        missing(READS)


def test_torque_that_stays_on_ends_it() -> None:
    person = Person()
    with refuses(BusError, "elbow"):
        run(four_servos(), np.array([2048, 2100, 2048, 512]), np.zeros(4), person,
            MockFault(FaultKind.MISSING, first=-1, cycles=100, servo=1))  # fmt: skip
    assert len(person.asked) == 1


def test_joints_are_chosen_by_name() -> None:
    joint_map = JointMap(waist_servos())
    assert homed_columns(joint_map, []).all()
    assert homed_columns(joint_map, ["neck", "yaw", "roll"]).tolist() == [False, True, True, True]
    with refuses(HardwareError, "knee", "roll", "yaw", "neck"):
        homed_columns(joint_map, ["knee", "tail"])
    with refuses(HardwareError, "roll", "yaw"):
        homed_columns(joint_map, ["roll"])


def test_joint_after_joint_gives_the_zeros_of_the_whole_with_coupled_joints_together() -> None:
    servos, person, clock = waist_servos(), Person(), VirtualClock()
    joint_map, asked = JointMap(servos), list[str]()
    start = np.array([spec.zero_tick for spec in servos]) + np.array([37, -20, 55, 9])
    bus = FaultyBus(servos, clock, start=start, faults=())
    bus.open()

    def choose(question: str) -> str:
        asked.append(question)
        return "s" if "neck" in question else ""

    arguments = (bus, joint_map, np.zeros(4), person.ask, choose, person.notify)
    each = home_each(*arguments, clock=clock, chosen=ALL_SERVOS, force=True)
    whole, _ = run(servos, start, np.zeros(4), Person())
    assert each is not None and whole is not None
    assert [("roll" in text, "yaw" in text) for text in asked] == [(False, False), (True, True), (False, False)]
    assert each.chosen.tolist() == [True, True, True, False]
    for own, all_at_once in ((each.ticks, whole.ticks), (each.zero, whole.zero), (each.off, whole.off)):
        assert own[:3].tolist() == all_at_once[:3].tolist()


@pytest.mark.parametrize("kind", ["moves", "silent", "far"])
def test_a_joint_that_cannot_be_taken_is_asked_for_again(kind: str) -> None:
    servos, person, clock = four_servos(), Person(), VirtualClock()
    faults = (MockFault(FaultKind.MISSING, first=READS, cycles=READS, servo=1),) if kind == "silent" else ()
    bus = ShakingBus(servos, clock, start=np.array([spec.zero_tick for spec in servos]), faults=faults)

    def shaken(reads: int, ticks: TickArray) -> TickArray:
        other: TickArray = ticks + np.array([0, 400, 0, 0])
        return other if READS < reads <= 2 * READS and (kind == "far" or (kind == "moves" and reads % 2)) else ticks

    bus.shake = shaken
    bus.open()
    asked: list[str] = []

    def choose(question: str) -> str:
        asked.append(question)
        return "e" if len(asked) == 4 else ""

    arguments = (bus, JointMap(servos), np.zeros(4), person.ask, choose, person.notify)
    found = home_each(*arguments, clock=clock, chosen=ALL_SERVOS)
    assert found is not None and found.chosen.tolist() == [True, True, False, False]
    assert ["again" in text for text in asked] == [False, False, True, False]
    assert not found.far.any()
    shows(person.messages)
