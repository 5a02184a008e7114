"""An exception planted in each stage of a tick, beside each source of a stop: the robot brakes, or torque is off.

Stages are stand-ins; guard, gate, supervisor and loop are real, and so is the operator of the command line.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from hardware.errors import BusError
from hardware.guard import Torque
from retarget.cli.controls import ControlRequest
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunOperator
from retarget.human.samples import Clip
from retarget.run.controllers import RobotMotion
from retarget.run.loop import Ending, RunObserver, Tick
from retarget.run.record import TickRecorder
from retarget.types import RunState
from rig import Rig, StubReconstructor, play

AT = 20
"""Ticks of following before the exception comes."""
WHY = "a operator stops it"
FAILS = "planted"
SWING = 0.05 * (1.0 - np.cos(2.0 * np.pi * np.arange(100)[:, None] / 80)) * np.ones(20)
"""All joints set off smoothly, and go on: (ticks, n) rad from the posture in which the robot stands."""


@dataclass(frozen=True)
class Stage:
    """Where exceptions are planted: objects or classes, and the names of their methods. stops: whether they are to stop
    the robot; torque_off: without braking."""

    of: Callable[["Run"], list[tuple[Any, str]]]
    error: type[Exception] = ArithmeticError
    stops: bool = True
    torque_off: bool = False


class Run(RunObserver):
    """A run in which everything moves, with the operator of the command line. It looks on at each tick."""

    def __init__(self) -> None:
        self.rig, self.request, self.page, self.screen = Rig(SWING), StopRequest(), Once(), Mock()
        self.broken, self.control, self.failing = Once(), Once(), RunObserver()
        self.rig.machine = replace(self.rig.machine, notify=lambda text: self.screen.show(text))
        prepared: Any = SimpleNamespace(samples=None, machine=self.rig.machine, clock=self.rig.clock)
        page: Any = self.page
        self.operator = RunOperator(prepared, self.request, page=page, controls=(self.broken, self.control))
        self.ticks: list[Tick] = []
        self.ends: list[tuple[bool, bool]] = []
        """Of each tick: whether a stop is latched, and whether torque is on."""

    def see(self, tick: Tick) -> None:
        guard = self.rig.guard
        self.ticks.append(tick)
        self.ends.append((guard.stop is not None, guard.torque is Torque.ON))

    def plant(self, stage: Stage, monkeypatch: pytest.MonkeyPatch, ask: Callable[["Run"], object]) -> list[int]:
        """Let each method raise once, and a person ask in that moment. Returns the ticks, filled as they do."""
        raised: list[int] = []

        def once(call: Callable[..., Any]) -> Callable[..., Any]:
            left = iter([True])

            def planted(*args: Any, **words: Any) -> Any:
                followed = sum(tick.output is not None and tick.output.followed is not None for tick in self.ticks)
                if followed >= AT and next(left, False):
                    raised.append(len(self.ticks))
                    ask(self)
                    raise stage.error(FAILS)
                return call(*args, **words)

            return planted

        for owner, name in stage.of(self):
            monkeypatch.setattr(owner, name, once(getattr(owner, name)))
        return raised

    def play(self) -> Ending:
        return play(self.rig, self.operator, self.failing, self)

    def stopped_by(self, tick: int) -> bool:
        """Whether torque is off after a tick, or in the next one a stop is latched and the goal brakes the robot."""
        if not self.ends[tick][1]:
            return True
        (latched, _), goal = self.ends[tick + 1], self.ticks[tick + 1].tried
        return latched and goal is not None and not goal.passed


class Once:
    """A control of the command line, or the button of a web page: asks once for a stop."""

    asks = False

    def stop_requested(self) -> bool:
        asked, self.asks = self.asks, False
        return asked

    def poll(self, now: float) -> Iterator[tuple[ControlRequest, str]]:
        return iter([(ControlRequest.STOP, WHY)] if self.stop_requested() else [])


STAGES = {
    "operator": Stage(lambda run: [(run.broken, "poll")]),
    "poll": Stage(lambda run: [(Clip, "poll")]),
    "read, no bus": Stage(lambda run: [(run.rig.guard, "read")], BusError, torque_off=True),
    "read": Stage(lambda run: [(run.rig.guard, "read")]),
    "sample": Stage(lambda run: [(Clip, "sample")]),
    "health": Stage(lambda run: [(run.rig.guard.health, "check")]),
    "supervisor": Stage(lambda run: [(run.rig.supervisor, "step")]),
    "reconstructor": Stage(lambda run: [(StubReconstructor, "step")]),
    "follower": Stage(lambda run: [(run.rig.follower, "step")]),
    "gate": Stage(lambda run: [(run.rig.gate, "check")]),
    "brake": Stage(lambda run: [(run.rig.follower, "step"), (run.rig.gate, "brake")], torque_off=True),
    "write, no bus": Stage(lambda run: [(run.rig.bus, "write")], BusError, torque_off=True),
    "write": Stage(lambda run: [(run.rig.guard, "write")]),
    "reseed_follower": Stage(lambda run: [(RobotMotion, "reseed_follower")]),
    "recorder": Stage(lambda run: [(TickRecorder, "keep_robot")]),
    "observer": Stage(lambda run: [(run.failing, "see")], stops=False),
    "notify": Stage(lambda run: [(run.screen, "show")], stops=False),
}
SOURCES: dict[str, Callable[[Run], object]] = {
    "signal": lambda run: run.request.request(WHY),
    "page": lambda run: setattr(run.page, "asks", True),
    "control": lambda run: setattr(run.control, "asks", True),
}
"""What a person does. A control is a key, a pedal, a file or a socket: the operator does not tell them apart."""


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    made = Run()
    monkeypatch.setattr(made.rig.guard.health.warnings, "take_news", lambda: ["a servo is warm"])
    return made


@pytest.mark.parametrize("name", STAGES)
def test_an_exception_stops_the_robot_within_a_tick(name: str, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = STAGES[name]
    raised = run.plant(stage, monkeypatch, lambda run: None)
    ending = run.play()
    assert len(raised) == len(stage.of(run))
    if not stage.stops:
        assert (ending.state, ending.reason) == (RunState.OFF, None)
        return
    assert ending.reason is not None and FAILS in ending.reason
    assert run.stopped_by(raised[0])
    assert (ending.state is RunState.FAULT) == stage.torque_off
    assert not run.rig.bus.torque_on


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("name", STAGES)
def test_a_stop_beside_an_exception_is_heard_within_a_tick(
    name: str, source: str, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = STAGES[name]
    raised = run.plant(stage, monkeypatch, SOURCES[source])
    ending = run.play()
    tick = raised[0]
    given = [one.given.operator.stop for one in run.ticks[tick : tick + 2] if one.given is not None]
    assert given[-1] or not run.ends[tick][1], "it is heard in the next tick, or torque is off"
    assert run.stopped_by(tick) or run.stopped_by(tick + 1)
    assert stage.stops or ending.reason == run.request.why
    assert not run.rig.bus.torque_on and ending.state in (RunState.OFF, RunState.FAULT)
