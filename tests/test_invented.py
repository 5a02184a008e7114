"""Limbs that hang from the trunk to the millimetre."""

import numpy as np

from doctor_rig import json_poses, mends, played, text_of
from retarget import rotations
from retarget.doctor.invented import invented_findings
from retarget.doctor.listening import Listening
from retarget.live.datagram import Datagram
from support.messages import shows

RATE = 100.0


def turned(*, own: float, turn: float = 1.0) -> Listening:
    """A trunk that turns; the left hand hangs from it and swings by `own` m, the right one swings by 0.1 m."""
    rows = []
    for k in range(400):
        time = k / RATE
        quat = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.array(turn * np.sin(time)))
        swing = np.array([0.0, 0.0, np.sin(3.0 * time)])
        place = {name: rotations.rotate(quat, np.array([0.0, side, -0.4])) for name, side in (("l", 0.2), ("r", -0.2))}
        poses: dict[str, dict[str, list[float]]] = {
            "chest": {"p": [0.0, 0.0, 1.3], "q": quat.tolist()},
            "l_wrist": {"p": (place["l"] + own * swing + [0.0, 0.0, 1.3]).tolist()},
            "r_wrist": {"p": (place["r"] + 0.1 * turn * swing + [0.0, 0.0, 1.3]).tolist()},
        }
        rows.append(Datagram(time, ("127.0.0.1", 1), json_poses(time, poses, quaternion="wxyz")))
    return played(rows)


def test_a_hand_that_hangs_is_made_up_and_the_other_is_not() -> None:
    lines = mends(invented_findings("json", turned(own=0.0)))
    assert len(lines) == 1 and lines[0].startswith("mend l_wrist: hangs from the chest")


def test_a_hand_that_moves_by_itself_is_real() -> None:
    assert invented_findings("json", turned(own=0.01)) == []


def test_nothing_can_be_said_while_nobody_moves() -> None:
    found = invented_findings("json", turned(own=0.0, turn=0.0))
    assert not mends(found)
    shows(text_of(found))


def test_a_sender_that_tells_no_trunk() -> None:
    assert invented_findings("natnet", turned(own=0.0)) == []
