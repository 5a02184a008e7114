"""A robot follows what a page sent, recorded, through a whole run: landmarks of a rendered performer, or a headset."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from camera_clips import EVERY
from command_line import code_of
from landmarks import read_frames
from messages import mentions
from rendered import RATE
from retarget.cli.exit import DONE, REFUSED
from retarget.sources.streams.raw_record import RawWriter
from retarget.types import FloatArray

CLIPS = Path(__file__).parent.parent / "sources" / "streams" / "camera"


def mirrored(rows: FloatArray) -> FloatArray:
    """Landmarks (33, 6) of a mirror's picture: the tracker takes the left arm there for a right one."""
    pairs = [0, *(row + 1 if row % 2 else row - 1 for row in range(1, 33))]
    rows = rows[[*range(7), 8, 7, 9, 10, *pairs[11:]]]
    rows[:, 0], rows[:, 2] = 1.0 - rows[:, 0], -rows[:, 2]
    return rows


@pytest.mark.long
@pytest.mark.parametrize(
    ("changed", "every", "ends", "why"),
    [
        (None, 1, DONE, ""),
        (mirrored, 1, REFUSED, "right wrist rose"),
        (lambda rows: 1e9 * rows, 1, REFUSED, "a landmark that is no part of a body"),
        (lambda rows: rows[:0], 1, REFUSED, "picture without a person"),
        (lambda rows: rows - [0.5, 0.0, 0.0, 0.0, 0.0, 0.0], 1, REFUSED, "head"),
        (None, 4, REFUSED, "not fresh"),
    ],
    ids=["good", "mirrored", "at infinity", "two people", "half a person", "4 a second"],
)
def test_a_robot_follows_a_camera_but_not_what_is_wrong(
    changed: Callable[[FloatArray], FloatArray] | None,
    every: int,
    ends: int,
    why: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """They stand, raise the left arm to be known, and raise it again to be followed."""
    still, front = (read_frames(CLIPS / f"{name}.jsonl.gz") for name in ("still", "front"))
    recording, report = tmp_path / "camera.raw", tmp_path / "report.json"
    writer = RawWriter(recording, url="web://")
    lines = [*still[:60], *front, *still[:30], *front]
    for number in range(0, len(lines), every):
        frame, time = json.loads(lines[number]), 1.0 + number * EVERY / RATE
        if changed is not None:
            frame["landmarks"] = changed(np.array(frame["landmarks"])).tolist()
        datagram = json.dumps(frame | {"time": time, "frame": number}).encode()
        writer.append(datagram, time_ns=round(1e9 * time), address="127.0.0.1", port=5)
        writer.flush()
    writer.close()
    asked = ["--robot", "op3", "--source", f"replay://{recording}", "--performer", "web", "--countdown", "0"]
    code = code_of("run", *asked, "--check-sides", "--report", report)
    assert code == ends
    if why:
        mentions(capsys.readouterr().err, why)
        assert not report.exists() or json.loads(report.read_text())["frames"] == 0
        return
    data = json.loads(report.read_text())
    assert data["stop"]["reason"] is None and data["hand_path_ratio"] > 0.7


@pytest.mark.long
def test_a_headset_asks_for_the_hands_that_the_same_poses_as_json_ask_for(tmp_path: Path) -> None:
    hands = []
    for kind, axes in (("web://", "webxr"), ("json://:14150", "openxr")):
        recording, saved = tmp_path / f"{axes}.raw", tmp_path / f"{axes}.npz"
        writer = RawWriter(recording, url=kind)
        for number in range(60 * 9):
            time = 1.0 + number / 60.0
            up = 0.5 - 0.5 * np.cos(2.0 * np.pi * max(time - 3.0, 0.0) / 4.0)  # of the left hand, to the front
            sway = 0.001 * np.sin(1.5 * time)
            places = {"head": (sway, 1.6, 0.0), "l_wrist": (-0.25 + sway, 0.8 + 0.6 * up, -0.5 * up)}
            places |= {"r_wrist": (0.25 + sway, 0.8, 0.0)}
            poses = {name: {"p": place, "q": [0.0, 0.0, 0.0, 1.0]} for name, place in places.items()}
            message = {"axes": axes, "quaternion": "xyzw", "time": time, "frame": number, "poses": poses}
            writer.append(json.dumps(message).encode(), time_ns=round(1e9 * time), address="127.0.0.1", port=5)
            writer.flush()
        writer.close()
        asked = ["--source", f"replay://{recording}", "--performer", "web", "--countdown", "0", "--save", saved]
        assert code_of("run", "--robot", "op3", *asked) == DONE
        with np.load(saved) as run:
            names = run["landmark_names"].tolist()
            hands.append(run["landmarks_asked"][:, [names.index("l_hand"), names.index("r_hand")]])
    assert np.nanmax(hands[0][:, 0, 2]) - np.nanmin(hands[0][:, 0, 2]) > 0.1
    np.testing.assert_allclose(hands[0], hands[1], atol=1e-3)  # [m]
