"""Both devices in their threads, in real time."""

import re
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from unittest.mock import Mock

import pytest

from faulty_bus import FaultKind, MockFault
from hardware.bus import ServoBus, ServoStates
from hardware.clock import Clock, MonotonicClock
from hardware.errors import BusError, GuardError
from messages import refuses
from recordings import mock_bus
from retarget.errors import InputError, UsageError
from retarget.human.samples import Playback
from retarget.lerobot import background
from retarget.lerobot.performer import PerformerDevice, PerformerWiring
from retarget.lerobot.robot import HumanoidDevice, Wiring
from retarget.model.robot import RobotBody
from retarget.run.loop import Operator
from retarget.run.options import RunOptions
from retarget.run.prepare import performance_of
from retarget.run.supervisor import OperatorInput
from retarget.sources.open import open_source
from retarget.types import RunState

CLOCK = MonotonicClock()


@dataclass
class Bench:
    """Makes mock buses, and counts how often torque was switched on."""

    make: Callable[[RobotBody, Clock], ServoBus] = mock_bus
    torque_on: int = 0
    closed: int = 0
    hangs: bool = False
    said: list[str] = field(default_factory=list)
    free: threading.Event = field(default_factory=threading.Event)  # cleared: the bus hangs

    def __post_init__(self) -> None:
        self.free.set()

    def bus(self, robot: RobotBody, clock: Clock) -> ServoBus:
        bus = self.make(robot, clock)
        torque, read = bus.torque, bus.read

        def counted(on: bool) -> None:
            self.torque_on += on
            torque(on)

        def hanging() -> ServoStates:
            self.hangs = not self.free.is_set()
            self.free.wait()
            return read()

        vars(bus).update(torque=counted, read=hanging)
        return bus

    def close(self) -> None:
        self.closed += 1

    def device(self) -> HumanoidDevice:
        wiring = Wiring(
            make_bus=self.bus, operator=lambda prepared: Operator(), close=self.close, notify=self.said.append
        )
        return HumanoidDevice(RunOptions(robot="op3"), wiring)


def wait_for(done: Callable[[], bool], *, seconds: float = 20.0, each: Callable[[], object] = lambda: None) -> None:
    end = CLOCK.now() + seconds
    while not done():
        assert CLOCK.now() < end, "it takes too long"
        each()
        CLOCK.sleep_until(CLOCK.now() + 1.0 / 30.0)


def running_thread() -> threading.Thread:
    [thread] = [thread for thread in threading.enumerate() if thread.name == "retarget"]
    return thread


def followed(device: HumanoidDevice, **moved: float) -> dict[str, float]:
    """Connect, and send a target until it is followed: where the robot stands, but for some joints."""
    device.connect()
    observed = device.observation()
    target = {key: observed[key] + moved.get(key.removesuffix(".pos"), 0.0) for key in device.action_features}
    wait_for(lambda: device.connection.state is RunState.FOLLOW, each=lambda: device.send(target))
    return target


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def device(bench: Bench) -> Iterator[HumanoidDevice]:
    device = bench.device()
    yield device
    device.disconnect()
    assert not [thread for thread in threading.enumerate() if thread.name == "retarget"]


def test_there_is_a_reading_without_torque_and_an_end_without_an_action(device: HumanoidDevice, bench: Bench) -> None:
    device.connect()
    observed = device.observation()
    assert observed.keys() == device.observation_features.keys()
    assert [*observed][:20] == [*device.action_features] and {type(value) for value in observed.values()} == {float}
    with refuses(GuardError, "connect"):
        device.connect()
    assert device.connection.state is RunState.ARMING
    device.disconnect()
    device.disconnect()
    assert not device.connection.is_connected and bench.torque_on == 0
    with refuses(GuardError, "get_observation"):
        device.observation()


def test_a_bus_that_cannot_be_opened_is_the_error_of_connect() -> None:
    device = Bench(make=Mock(side_effect=BusError("no such port", where="/dev/ttyUSB9"))).device()
    with refuses(BusError, "/dev/ttyUSB9"):
        device.connect()
    assert not device.connection.is_connected
    device.disconnect()


def test_what_the_program_opened_is_closed_where_connect_fails() -> None:
    dead = MockFault(FaultKind.MISSING, 0, 10**6, servo=2)
    bench = Bench(make=partial(mock_bus, faults=(dead,)))
    device = bench.device()
    for tries in (1, 2):
        with refuses(GuardError, "does not answer"):
            device.connect()
        assert not device.connection.is_connected and bench.closed == tries


def test_ctrl_c_at_any_instant_of_disconnect_does_not_escape(
    device: HumanoidDevice, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    device.connect()
    thread = running_thread()
    alive, pressed = thread.is_alive, iter([True, True])

    def interrupted() -> bool:
        if next(pressed, False):
            raise KeyboardInterrupt
        return alive()

    monkeypatch.setattr(thread, "is_alive", interrupted)
    device.disconnect()
    assert not alive() and not device.connection.is_connected and bench.closed == 1


def test_a_run_that_does_not_end_stays_the_only_one(
    device: HumanoidDevice, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    device.connect()
    bench.free.clear()
    wait_for(lambda: bench.hangs)
    with monkeypatch.context() as impatient:
        impatient.setattr(background, "JOIN_S", 0.3)
        device.disconnect()
    assert bench.said == [background.CUT_POWER] and bench.closed == 0
    with refuses(GuardError, "connect"):
        device.connect()
    bench.free.set()
    device.disconnect()
    assert not device.connection.is_connected and bench.closed == 1
    device.connect()


@pytest.mark.long
def test_it_follows_refuses_and_goes_to_rest(device: HumanoidDevice, bench: Bench) -> None:
    target = followed(device, head_pan=0.2)
    assert bench.torque_on == 1
    with refuses(InputError, "head_pan.pos"):
        device.send(target | {"head_pan.pos": float("nan")})
    wait_for(lambda: device.connection.state is RunState.HOLD)
    wait_for(lambda: device.connection.state is RunState.FOLLOW, each=lambda: device.send(target))
    wait_for(lambda: abs(device.send(target)["head_pan.pos"] - target["head_pan.pos"]) < 1e-3)
    device.clutch(engaged=False)
    wait_for(lambda: device.connection.state is RunState.HOLD, each=lambda: device.send(target))
    begun = CLOCK.now()
    device.disconnect()
    assert CLOCK.now() - begun < 15.0
    device.connect()  # a new run, without torque
    assert device.connection.state is RunState.ARMING and bench.torque_on == 1


@pytest.mark.long
def test_without_actions_it_stops_and_says_why(device: HumanoidDevice, bench: Bench) -> None:
    target = followed(device)
    wait_for(lambda: device.connection.state is RunState.OFF, seconds=30.0)
    with refuses(GuardError, "send_action", 200, varies=re.compile(r"for [\d.]+ s")):
        device.send(target)
    assert device.observation()  # the last reading


@pytest.mark.long
def test_ctrl_c_while_it_goes_to_rest_switches_torque_off(
    device: HumanoidDevice, monkeypatch: pytest.MonkeyPatch
) -> None:
    followed(device)
    thread = running_thread()
    join, pressed = thread.join, iter([True])

    def interrupted(timeout: float | None = None) -> None:
        join(timeout)
        if next(pressed, False):
            raise KeyboardInterrupt

    monkeypatch.setattr(thread, "join", interrupted)
    begun = CLOCK.now()
    device.disconnect()
    assert CLOCK.now() - begun < 2.5


def performer(*, end: float, delay_s: float = 0.0, operator: Operator | None = None) -> PerformerDevice:
    options = RunOptions(robot="op3", bus="profile", playback=Playback(end=end))
    wiring = PerformerWiring(
        perform=lambda look: performance_of(lambda: open_source("sample"), options.playback),
        operator=lambda prepared: operator or Operator(),
        close=lambda: None,
        notify=lambda text: None,
    )
    return PerformerDevice(options, wiring, delay_s=delay_s)


def test_a_performer_gives_every_key_of_the_robot(bench: Bench) -> None:
    device = performer(end=0.2, delay_s=10.0)
    with refuses(GuardError, "get_action"):
        device.action()
    device.connect()
    first = device.action()
    assert first.keys() == device.action_features.keys() == bench.device().action_features.keys()
    assert device.connection.state is RunState.ARMING and first == device.action()
    device.disconnect()
    device.disconnect()
    assert not device.connection.is_connected


def test_a_performer_whose_thread_hangs_gives_no_goals() -> None:
    free = threading.Event()
    free.set()

    def poll(state: RunState | None) -> OperatorInput:
        free.wait()
        return OperatorInput()

    device = performer(end=0.2, delay_s=100.0, operator=Mock(poll=poll))
    device.connect()
    device.action()
    free.clear()
    with refuses(GuardError, "get_action", varies=re.compile(r"[\d.]+ s")):
        wait_for(lambda: False, seconds=5.0, each=device.action)
    free.set()

    def recovered() -> bool:
        with suppress(GuardError):
            return bool(device.action())
        return False

    wait_for(recovered)
    device.disconnect()


@pytest.mark.long
def test_a_file_that_is_over_leaves_its_last_goal() -> None:
    device = performer(end=1.0)
    device.connect()
    first = device.action()
    wait_for(lambda: device.connection.state is RunState.OFF)
    last = device.action()
    assert last == device.action() and last != first
    device.disconnect()


@pytest.mark.parametrize("delay_s", [-1.0, float("nan"), 1e4])
def test_an_impossible_delay_is_refused(delay_s: float) -> None:
    with refuses(UsageError, "delay_s"):
        performer(end=1.0, delay_s=delay_s)
