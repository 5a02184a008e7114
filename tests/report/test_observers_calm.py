"""Calm: modes do not come and go, observers add no jerk, and a hand that rests against something rests."""

from functools import cache

import numpy as np
import pytest

from followers import DT, op3
from observed_robot import ZONE, Done, act, human, raised, robot, scene_of, sphere, without_observers
from retarget.report.motion_metrics import jerk_p95, observer_activity
from retarget.schema.priorities import load_priorities


@cache
def performed() -> Done:
    """The whole of the synthetic performer."""
    return act(robot(None), None, human())


def test_modes_seldom_change() -> None:
    modes = np.array([posture.observer_modes for posture in performed().postures])
    names = robot(None).observers.names
    found = observer_activity(modes, names, dt=DT)
    assert found is not None and found.activations > 10
    assert found.switches.worst <= 2.0, found.switches.name


def test_observers_add_little_jerk() -> None:
    """Upright next to none; where it folds onto its thighs, a twentieth of what it would be if joints chattered."""
    upright = human()[:50]
    bare = act(robot(None, without_observers(load_priorities("servo"))), None, upright)
    watched, without = act(robot(None), None, upright), jerk_p95(bare.joints, DT)
    alone, whole = jerk_p95(watched.joints, DT), jerk_p95(performed().joints, DT)
    assert alone is not None and whole is not None and without is not None
    assert alone <= 1.3 * without
    assert whole <= 0.05 * float(op3().limits.max_acceleration.min()) / DT


def test_no_shaking_at_switch_on() -> None:
    """The first second: away from standing, slowly, to where the performer stands still."""
    done = act(robot(None), None, [human()[0]] * 375)
    assert done.swing() < 1e-4


@pytest.mark.parametrize("tick", [150, 250])
def test_a_hand_that_rests_against_a_sphere_rests(tick: int) -> None:
    motion = raised()[:tick]
    at = act(robot(None), None, motion).reached("r_hand")[-1]
    done = act(state_of := robot(state := scene_of(ball=sphere(at))), state, [*motion, *[motion[-1]] * 500])
    assert state_of.observers.names and done.distance[-1].min() == pytest.approx(ZONE["margin"], abs=1e-4)
    assert done.swing() < 1e-4


def test_a_hand_that_rests_against_a_box_rests() -> None:
    motion = raised()[:200]
    x, y, z = act(robot(None), None, motion).reached("r_hand")[-1]
    box = {"shape": {"box": {"size": (0.05, 0.05, 0.02)}}, "at": {"pos": (x + 0.03, y, z + 0.01)}, **ZONE}
    done = act(robot(state := scene_of(box=box)), state, [*motion, *[motion[-1]] * 500])
    assert done.swing() < 1e-4
