"""The robot's half of a tick: goals that keep their distance in time, and an end that leaves no torque on."""

import numpy as np
import pytest

from hardware.bus import ServoGoals
from retarget.pipeline import Ending, Pipeline, Watch
from retarget.rotations import FloatArray
from rig import Rig, StubReconstructor, person, short_clip


def swing() -> FloatArray:
    """All joints set off smoothly, and go on."""
    return np.asarray(0.05 * (1.0 - np.cos(2.0 * np.pi * np.arange(100)[:, None] / 80)) * np.ones(20))


def play(rig: Rig, watch: Watch | None = None) -> Ending:
    clip = short_clip(seconds=0.4)
    return Pipeline(clip=clip, reconstructor=StubReconstructor(person()), robot=rig.side).run(watch)


def times_of_writing(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """When anything goes onto the bus, s, filled while the rig plays."""
    times: list[float] = []
    write = rig.bus.write

    def noted(goals: ServoGoals) -> None:
        times.append(rig.clock.now())
        write(goals)

    monkeypatch.setattr(rig.bus, "write", noted)
    return times


@pytest.mark.parametrize(("stall", "reason"), [(0.05, None), (2.0, "no tick for 2 s, allowed 0.1 s")])
def test_what_was_missed_in_a_stall_is_not_caught_up_with(
    stall: float, reason: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(swing())
    times = times_of_writing(rig, monkeypatch)
    ending = play(rig, Watch(lambda done: rig.clock.advance(stall) if done == 20 else None, every=1))
    assert np.diff(times)[1:].min() > 0.999 * rig.dt
    assert (ending.state, ending.reason) == ("idle" if reason is None else "stopped", reason)
