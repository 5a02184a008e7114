"""Whole runs in this process, as `retarget run` makes them, and what of them the measuring needs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from benchmarks.bodies import Floats
from hardware.clock import VirtualClock
from retarget.frames import SensorFrames
from retarget.model.robot import load_robot
from retarget.report.clearance import PlacedBody, place_body
from retarget.report.motion_metrics import jerk_p95
from retarget.run.options import HUMAN_PRIORITIES, RunOptions
from retarget.run.prepare import prepare
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.schema.catalogue import Kind, find
from retarget.schema.priorities import self_contained
from sim.mock_bus import mock_bus

OBSERVING = ("reactive", "preventive")
HANDS = (("l_hand", "l_wrist"), ("r_hand", "r_wrist"))
"""What a left and a right hand may be called among the tracks."""
ARMS = (("l_wrist", "l_elbow"), ("r_wrist", "r_elbow"))
"""Links of a human's forearms; a robot's are those that carry its hands' frames."""


@dataclass(frozen=True, eq=False)
class Motion:
    """The last stage of a run: its body in all T postures, and what it followed.

    time (T,) s, on the scene's clock; first, end: rows of following. asked, reached (F, 2, 3) m: both hands, while
    following. arms: links of each forearm. neutral (nq,). gated, modes: per row.
    """

    run: RunResult
    body: PlacedBody
    time: Floats
    first: int
    end: int
    asked: Floats
    reached: Floats
    arms: tuple[tuple[str, ...], tuple[str, ...]]
    neutral: Floats
    ignored: tuple[tuple[str, str], ...]
    jerk: float | None

    @property
    def beginning(self) -> int:
        """How many rows pass until the clip begins, its first posture with them."""
        return self.first + 1


def play(frames: SensorFrames, options: RunOptions) -> Motion:
    """Run it on a virtual clock and a mock bus. Raises RetargetError."""
    with prepare(lambda: frames, options, clock=VirtualClock(), make_bus=mock_bus) as prepared:
        run = prepared.run()
    return motion_of(run)


def motion_of(run: RunResult) -> Motion:
    """What is measured of a finished run."""
    following, robot, sent = run.record.following, run.robot, run.record.robot
    names, asked, reached = run.followed
    arms: tuple[tuple[str, ...], tuple[str, ...]] = ARMS
    hands = [names.index(next(name for name in side if name in names)) for side in HANDS]
    if robot is None or sent is None:
        q, human = run.record.human.q, run.human
        single, address = human.body.scalar_joints()
        body, neutral, ignored = place_body(human.mjcf, q), human.posture("attractor"), []
        joints = q[:, address[single]]
    else:
        q, profile = sent.q, robot.profile
        body = place_body(profile.body_path, q, root=profile.root)
        links = [profile.frames[profile.landmarks[names[hand]].frame].link for hand in hands]
        arms, neutral = ((links[0],), (links[1],)), robot.posture(profile.postures.neutral)
        ignored, joints = [ignored.pair for ignored in profile.ignore_pairs], q[:, robot.servo_columns]
    assert len(body.rows) == len(run.record), "every posture that was sent is known"
    return Motion(
        run=run,
        body=body,
        time=run.record.time,
        first=following.start,
        end=following.stop,
        asked=asked[following][:, hands],
        reached=reached[following][:, hands],
        arms=arms,
        neutral=neutral,
        ignored=tuple(ignored),
        jerk=jerk_p95(joints[following], run.clip.dt),
    )


def unobserving(robot: str, folder: Path) -> Path:
    """The priority file of the last stage without its observers, written to a folder."""
    name = HUMAN_PRIORITIES if robot == "human" else load_robot(robot).profile.retarget
    file: dict[str, Any] = yaml.safe_load(self_contained(find(Kind.PRIORITIES, name)))
    for level in file["levels"]:
        level["tasks"] = [task for task in level["tasks"] if task["type"] not in OBSERVING]
    path = folder / "unobserving.yaml"
    path.write_text(yaml.safe_dump(file, sort_keys=False), encoding="utf-8")
    return path


def gated_share(motion: Motion) -> float | None:
    """Share of the ticks of following that the gate changed; None of a human, who has none."""
    sent = motion.run.record.robot
    if sent is None or motion.first == motion.end:
        return None
    return float(np.mean(sent.gated[motion.run.record.phase == Phase.FOLLOW]))
