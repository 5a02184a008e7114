"""To be described."""

import numpy as np
import pytest

from hardware.bus import ServoGoals
from retarget.types import FloatArray
from rig import Rig


def swing() -> FloatArray:
    """All joints set off smoothly, and go on."""
    return np.asarray(0.05 * (1.0 - np.cos(2.0 * np.pi * np.arange(100)[:, None] / 80)) * np.ones(20))


def times_of_writing(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """When anything goes onto the bus, s, filled while the rig plays."""
    times: list[float] = []
    write = rig.bus.write

    def noted(goals: ServoGoals) -> None:
        times.append(rig.clock.now())
        write(goals)

    monkeypatch.setattr(rig.bus, "write", noted)
    return times
