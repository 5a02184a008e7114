"""Whole runs in this process, as `retarget run` makes them, and what of them the measuring needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.bodies import Floats
from hardware.clock import VirtualClock
from retarget.frames import SensorFrames
from retarget.report.clearance import PlacedBody, place_body
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from sim.mock_bus import mock_bus

HANDS = ("l_hand", "r_hand")


@dataclass(frozen=True, eq=False)
class Motion:
    """A robot in all T postures of a run.

    time (T,) s, on the scene's clock; first, end: rows of following. reached (F, 2, 3) m: both hands, while following.
    arms: the links of each forearm. neutral (nq,). gated: share of the ticks of following that the gate changed.
    """

    run: RunResult
    body: PlacedBody
    time: Floats
    first: int
    end: int
    reached: Floats
    arms: tuple[str, ...]
    neutral: Floats
    ignored: tuple[tuple[str, str], ...]
    gated: float

    @property
    def beginning(self) -> int:
        """How many rows pass until the clip begins, its first posture with them."""
        return self.first + 1


def play(frames: SensorFrames, options: RunOptions) -> Motion:
    """Let a robot run on a virtual clock and a mock bus. Raises RetargetError."""
    with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run()
    following, robot, sent = run.record.following, run.robot, run.record.robot
    assert robot is not None and sent is not None
    names, _, reached = run.followed
    profile = robot.profile
    body = place_body(profile.body_path, sent.q, root=profile.root)
    assert len(body.rows) == len(run.record), "every posture that was sent is known"
    followed = sent.gated[run.record.phase == Phase.FOLLOW]
    return Motion(
        run=run,
        body=body,
        time=run.record.time,
        first=following.start,
        end=following.stop,
        reached=reached[following][:, [names.index(hand) for hand in HANDS]],
        arms=tuple(profile.frames[profile.landmarks[hand].frame].link for hand in HANDS),
        neutral=robot.posture(profile.postures.neutral),
        ignored=tuple(ignored.pair for ignored in profile.ignore_pairs),
        gated=float(np.mean(followed)) if followed.size else 0.0,
    )
