"""The contact state of the soles that a bus reads reaches the follower."""

from dataclasses import replace

import numpy as np
import pytest

from rig import Rig, play


def test_the_contact_state_is_set_before_each_step(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Rig(np.zeros((20, 20)))
    contact, read = np.array([True, False]), rig.bus.read
    monkeypatch.setattr(rig.bus, "read", lambda: replace(read(), soles=contact))
    play(rig)
    assert len(rig.follower.contact_states) >= 20 and all(soles is contact for soles in rig.follower.contact_states)


def test_a_bus_without_contact_sensors_sets_none() -> None:
    rig = Rig(np.zeros((20, 20)))
    play(rig)
    assert set(rig.follower.contact_states) == {None}
