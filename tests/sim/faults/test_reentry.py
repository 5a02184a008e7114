"""A live robot follows a performer again slowly, waits on its approach while no sensor is valid, and never jumps."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from live_rig import LiveRig
from messages import shows
from retarget.live import performer
from retarget.live.begin import LiveOptions
from retarget.live.sensor_validity import LIMITS, ReacquisitionBlend
from retarget.run.loop import Watch
from retarget.run.record import Phase
from retarget.run.run_result import RunResult
from retarget.types import FloatArray, RunState
from sim.faults.sender import FakeSender, Poses

CAP = 0.2
OVERHEAD = (0.1, 0.0, 1.15)


def raising(first: float, last: float) -> Callable[[float, Poses], Poses]:
    """Stands still, raises both arms, and stands still again, s of the sender."""
    base: Poses = {}

    def fault(time: float, poses: Poses) -> Poses:
        for name, point in poses.items():
            base.setdefault(name, point)
        share = min(max((time - first) / (last - first), 0.0), 1.0)
        noise = np.random.default_rng(int(time * 1000))
        sent = {name: point + noise.normal(0.0, 2e-4, 3) for name, point in base.items()}
        for name in ("l_wrist", "r_wrist"):
            sent[name] = sent[name] + share * np.array(OVERHEAD)
        return sent

    return fault


def shares(result: RunResult) -> FloatArray:
    """Of its greatest speed, the fastest joint between rows (T - 1,)."""
    assert result.robot is not None and result.record.robot is not None
    q = result.record.robot.q[:, result.robot.servo_columns]
    speed = np.abs(np.diff(q, axis=0)) / result.clip.dt
    return np.asarray((speed / result.robot.joint_map.max_velocity).max(axis=1))


def paused(first: int, last: int, *, raised: tuple[float, float]) -> tuple[LiveRig, RunResult]:
    """Pause the robot by the clutch between two ticks, while the performer raises both arms."""
    sender = FakeSender()
    sender.faults.append(raising(*raised))
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=6.0))
    with rig.prepared() as prepared:
        samples, looks = prepared.samples, 0

        def look() -> bool:
            nonlocal looks
            looks += 1
            if looks in (first, last):
                samples.clutch(engaged=looks == last)  # type: ignore[attr-defined]
            return False

        return rig, prepared.run(Watch(stop_asked=look))


@pytest.mark.parametrize(
    ("first", "last", "raised"), [(520, 720, (6.6, 7.4)), (20, 420, (3.2, 4.4))], ids=["following", "on the way"]
)
def test_after_a_pause_no_joint_goes_fast_after_a_performer_who_moved_on(
    first: int, last: int, raised: tuple[float, float]
) -> None:
    rig, result = paused(first, last, raised=raised)
    assert rig.said.count("the performer is followed") == (2 if first > 100 else 1)
    assert result.stop is None
    share, phases = shares(result), result.record.phase[1:]
    assert share[phases == Phase.APPROACH].max() <= CAP * 1.001
    again = max(last, int(np.argmax(phases == Phase.FOLLOW)))
    slow = share[again : again + 150]  # 0.5 s of good data, and 0.7 s
    assert 0.09 < slow.max() <= CAP * 1.05
    assert share[again:][phases[again:] == Phase.FOLLOW].max() < 0.8


@pytest.mark.parametrize(("kind", "within"), [("silent", 0.15), ("late", 0.06)])
def test_on_the_approach_it_waits_while_no_sensor_is_valid(kind: str, within: float) -> None:
    sender, trouble = FakeSender(), [0.0, 0.0]
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=1.0))

    def troubled() -> bool:
        return trouble[0] <= rig.clock.now() < trouble[1]

    sender.faults.append(lambda time, poses: None if kind == "silent" and troubled() else poses)
    seen: list[tuple[float, RunState]] = []
    with rig.prepared() as prepared:
        assert prepared.machine is not None
        supervisor, looks = prepared.machine.supervisor, 0

        def look() -> bool:
            nonlocal looks
            looks += 1
            seen.append((rig.clock.now(), supervisor.state))
            if looks == 20:
                trouble[:] = rig.clock.now(), rig.clock.now() + 1.0
            if kind == "late" and troubled():
                rig.clock.advance(0.02)
            return False

        result = prepared.run(Watch(stop_asked=look))
    held = [time for time, state in seen if state is RunState.HOLD]
    assert held[0] - trouble[0] <= within + 0.02
    went = [time for time, state in seen if state is RunState.APPROACH and time > held[0]]
    assert went[0] - trouble[1] == pytest.approx(0.5, abs=0.05)
    assert result.stop is None and shares(result).max() < 0.5
    waits = [said for said in rig.said if said.startswith("the robot waits")]
    assert len(waits) == 1 and ("late" in waits[0]) == (kind == "late")
    shows(rig.said)
    rows = result.record.phase == Phase.FOLLOW
    assert np.count_nonzero(rows) == pytest.approx(result.clip.ticks, abs=2)


def lost_wrist(blend: float, monkeypatch: pytest.MonkeyPatch) -> tuple[LiveRig, RunResult]:
    """A wrist that is lost for 1.2 s while its arm is raised to the shoulder."""
    monkeypatch.setattr(
        performer, "ReacquisitionBlend", lambda count: ReacquisitionBlend(count, replace(LIMITS, blend=blend))
    )
    still = raising(1e9, 2e9)

    def fault(time: float, poses: Poses) -> Poses:
        sent = still(time, poses)
        sent["head"] = sent["head"] + 0.01 * np.sin(2.0 * time)
        if time >= 5.8:
            sent["l_wrist"] = sent["l_wrist"] + np.array([0.15, 0.0, 0.6])
        if 5.0 <= time < 6.2:
            del sent["l_wrist"]
        return sent

    sender = FakeSender()
    sender.faults.append(fault)
    rig = LiveRig(sender, options=LiveOptions(countdown=0.5, duration=4.5))
    with rig.prepared() as prepared:
        return rig, prepared.run(Watch())


def test_a_sensor_that_comes_back_is_blended_in_and_no_joint_goes_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, result = lost_wrist(LIMITS.blend, monkeypatch)
    shows(rig.said, "l_wrist")
    assert result.stop is None and result.record.robot is not None
    share = shares(result)
    assert 0.1 < share[result.record.following.start :].max() < 0.55
    _, longer = lost_wrist(3.0, monkeypatch)
    assert longer.record.robot is not None
    assert not np.array_equal(longer.record.robot.goal_ticks, result.record.robot.goal_ticks)
