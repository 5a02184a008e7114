"""Targets of hands out of reach: tasks that rank above them are kept, and nothing shakes."""

from dataclasses import replace

import numpy as np
import pytest

import followers
from benchmarks.bodies import bench_op3
from benchmarks.motion import crouch_and_reach
from benchmarks.ours import Ours
from people import Run, reconstruct
from retarget.frames import SensorSample
from retarget.types import FloatArray
from sim.performer import synthetic_performer

WRISTS = ("l_wrist", "r_wrist")
FAR = [(2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 2.0), (0.0, 0.2, 2.0)]
FAR += [(0.0, 0.0, 2.5), (-2.0, 0.0, 0.0), (1.2, 1.2, 1.2), (0.0, 0.0, -2.0)]
NEAR = [(0.45, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 0.6), (0.3, 0.3, 0.3)]
"""m. Just out of reach is the harder case: limbs are stretched, and it hardly differs from in reach."""
BEGIN, RISE, COUNT, RATE = 30, 60, 240, 120.0


def reaching(priorities: str, away: tuple[float, float, float], *, jump: bool) -> Run:
    """A standing performer whose wrists go away over half a second, or in one frame."""
    first = synthetic_performer().sample(0.0)
    wrists = np.isin(first.names, WRISTS)[:, None]

    def change(k: int, _: SensorSample) -> SensorSample:
        share = float(k >= BEGIN) if jump else min(max((k - BEGIN) / RISE, 0.0), 1.0)
        return replace(first, position=first.position + share * wrists * np.array(away))

    return reconstruct(synthetic_performer().resample(np.arange(COUNT) / RATE), priorities, change=change)


SLOWLY_FAR = [pytest.param(away, False, id=f"{away}-ramp", marks=pytest.mark.long) for away in FAR]
CLOSE = [pytest.param(away, jump, id=f"{away}-{'jump' if jump else 'ramp'}") for away in NEAR for jump in (False, True)]


@pytest.mark.parametrize(("away", "jump"), [*CLOSE, *((away, True) for away in FAR), *SLOWLY_FAR])
@pytest.mark.parametrize("priorities", ["human", "paper"])
def test_ankles_and_balance_stay_and_the_body_comes_to_rest(
    priorities: str, away: tuple[float, float, float], jump: bool
) -> None:
    result = reaching(priorities, away, jump=jump)
    names = result.postures[0].joint_names
    wrists, ankles = ([names.index(f"{side}_{part}") for side in "lr"] for part in ("wrist", "ankle"))
    assert result.errors_mm[:, 3:].max() < 1.0
    assert result.joints[:, ankles] == pytest.approx(np.broadcast_to(result.joints[0, ankles], (COUNT, 2, 3)), abs=1e-3)
    if priorities == "paper":
        assert result.balance_mm.max() < 1.0
    gone = (result.joints[-1, wrists] - result.joints[0, wrists]) @ np.array(away) / np.linalg.norm(away)
    assert gone.min() > 0.1
    end = result.joints[-40:]
    path, direct = np.linalg.norm(np.diff(end, axis=0), axis=-1).sum(axis=0), np.linalg.norm(end[-1] - end[0], axis=-1)
    assert (path - direct).max() < 0.025  # m in a third of a second: no point shakes by half a millimetre a frame


@pytest.mark.parametrize(
    "away", [*FAR[:3], *(pytest.param(away, marks=pytest.mark.long) for away in FAR[3:]), (0.0, 0.5, 0.0)], ids=str
)
def test_a_robot_stays_on_its_soles(away: tuple[float, float, float]) -> None:
    human = followers.postures(followers.performer())[0]

    def desired(share: float) -> FloatArray:
        joints = human.joints.copy()
        joints[[human.joint_names.index(name) for name in WRISTS]] += share * np.array(away)
        return joints

    robot = followers.follower()
    done = followers.follow(
        robot, [replace(human, joints=desired(min(max((k - 60) / 120, 0.0), 1.0))) for k in range(300)]
    )
    off, tilt = followers.sole_errors(robot, done.q)
    assert off < 1e-3 and tilt < np.radians(0.1)
    assert followers.balance_margin(robot, done.q) > 0.0
    followers.assert_within_limits(done.joints)


def test_an_absurd_speed_at_the_start_still_gives_a_finite_answer() -> None:
    body = bench_op3()
    motion = crouch_and_reach(body, 2)
    side = Ours(body, motion)
    side.aim(motion.com[0], motion.points[0])
    side.solver.reset(motion.start, np.full(body.model.nv, 1e308))
    assert np.isfinite(side.solver.frame(side.targets, 1e3)).all()
