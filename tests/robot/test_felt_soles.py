"""What a bus feels of the soles, on its way to who steps."""

from dataclasses import replace

import numpy as np
import pytest

from rig import Rig, play


def test_what_the_soles_feel_is_told_before_each_thought(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(np.zeros((20, 20)))
    felt, read = np.array([True, False]), rig.bus.read
    monkeypatch.setattr(rig.bus, "read", lambda: replace(read(), soles=felt))
    play(rig)
    assert len(rig.follower.contact_states) >= 20 and all(soles is felt for soles in rig.follower.contact_states)


def test_a_bus_that_feels_nothing_says_so() -> None:
    rig = Rig(np.zeros((20, 20)))
    play(rig)
    assert set(rig.follower.contact_states) == {None}
