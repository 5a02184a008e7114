"""What pages of tests show: OP3 beside the synthetic performer, and a ball as an obstacle."""

from functools import cache

import numpy as np

from followers import dimensions, op3, performer
from retarget.model.human import Human, build_human
from retarget.model.meshes import shape_mesh
from retarget.viewer.recorded import ShownRun
from retarget.viewer.snapshot import Cast, Snapshot, snapshot_at

SENSORS = ("l_wrist", "head")


@cache
def person() -> Human:
    return build_human(dimensions(performer()))


@cache
def cast_of_op3() -> Cast:
    robot = op3()
    ball = [shape_mesh(0, (0.05, 0.0, 0.0))]
    return Cast(
        human=person().solid,
        robot=robot.solid,
        profile=robot,
        joints=robot.joint_map.joints,
        landmarks=("l_hand",),
        sensors=SENSORS,
        obstacles=ball,
    )


@cache
def cast_of_a_human() -> Cast:
    return Cast(human=person().solid, sensors=SENSORS)


def shown(run: ShownRun, row: int) -> Snapshot:
    """What a page shows of a row of a recorded run."""
    return snapshot_at(run, run.cast, row)


def snapshot(**changed: object) -> Snapshot:
    """OP3 as its file has it, at its goals."""
    q, points = op3().body.qpos0.copy(), np.full((1, 3), 0.1)
    fields: dict[str, object] = {
        "time": 0.0,
        "doing": "following",
        "robot": q,
        "q": q,
        "human_q": person().body.qpos0,
        "present": np.zeros(20),
        "sent": np.zeros(20),
        "landmarks_asked": points,
        "landmarks_reached": points,
        "com": np.array([0.0, 0.0, 0.2]),
    }
    return Snapshot(**fields | changed)  # type: ignore[arg-type]
