"""The session of a recording: strict, and enough to ask for the same run again."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from recordings import Recorded, record
from retarget.human.samples import Playback
from retarget.recording.session import FORMAT, Session
from retarget.run.options import RunOptions

ASKED = RunOptions(robot="op3", bus="mock", performer="five_head", iterations=3, parts="upper", allow_contact=True)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return record(tmp_path_factory.mktemp("session") / "run.mcap", options=ASKED, seconds=0.05)


@pytest.fixture
def session(run: Recorded) -> Session:
    return run.read().session


def test_the_same_run_can_be_asked_for_again(run: Recorded, session: Session) -> None:
    assert session.options == ASKED and session.format == FORMAT and session.source == "synthetic"
    ours, theirs = session.size, run.result.human.dimensions
    np.testing.assert_array_equal(ours.offset, theirs.offset)
    assert (ours.stature, ours.mass) == (theirs.stature, theirs.mass)
    assert run.result.robot is not None and session.joints == run.result.robot.joint_map.joints
    assert session.sensors == run.result.sensors and session.observers == run.result.observer_names


def test_the_speed_of_the_motion_is_part_of_it(tmp_path: Path) -> None:
    slow = RunOptions(robot="human", playback=Playback(speed=0.5))
    session = record(tmp_path / "run.mcap", options=slow, seconds=0.05).read().session
    assert session.motion_dt == 0.5 * session.dt


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("format", 1),
        ("dt", 0.0),
        ("dt", float("nan")),
        ("ticks", 0),
        ("sensors", ()),
        ("parts", "lower"),
        ("intake", (1.0, -1.0, 1.0)),
        ("strange", 1),
    ],
)
def test_what_is_none_is_refused(key: str, value: object, session: Session) -> None:
    data = session.model_dump() | {key: value}
    with pytest.raises(ValidationError, match=key):
        Session.model_validate(data)
    assert Session.model_validate(session.model_dump()) == session
