"""A robot follows a camera: landmarks of a rendered performer, recorded, through a whole run."""

import json
from pathlib import Path

import numpy as np
import pytest

from camera_clips import EVERY
from command_line import code_of
from landmarks import read_frames
from messages import shows
from rendered import RATE
from retarget.cli.exit import DONE, REFUSED
from retarget.sources.raw_record import RawWriter

CLIPS = Path(__file__).parent.parent / "sources" / "camera"


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_robot_follows_a_camera_but_not_a_mirror(
    mirrored: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They stand, raise the left arm to be known, and raise it again to be followed."""
    still, front = (read_frames(CLIPS / f"{name}.jsonl.gz") for name in ("still", "front"))
    recording, report = tmp_path / "camera.raw", tmp_path / "report.json"
    writer = RawWriter(recording, url="web://")
    for number, line in enumerate([*still[:60], *front, *still[:30], *front]):
        frame, time = json.loads(line), 1.0 + number * EVERY / RATE
        if mirrored:  # the tracker takes the left arm in a mirror for a right one
            pairs = [0, *(row + 1 if row % 2 else row - 1 for row in range(1, 33))]
            rows = np.array(frame["landmarks"])[[*range(7), 8, 7, 9, 10, *pairs[11:]]]
            rows[:, 0], rows[:, 2] = 1.0 - rows[:, 0], -rows[:, 2]
            frame["landmarks"] = rows.tolist()
        datagram = json.dumps(frame | {"time": time, "frame": number}).encode()
        writer.append(datagram, time_ns=round(1e9 * time), address="127.0.0.1", port=5)
        writer.flush()
    writer.close()
    asked = ["--robot", "op3", "--source", f"replay://{recording}", "--performer", "web", "--countdown", "0"]
    code = code_of("run", *asked, "--check-sides", "--report", report)
    if mirrored:
        assert code == REFUSED and not report.exists()
        shows(capsys.readouterr().err, "right wrist rose")
        return
    assert code == DONE
    data = json.loads(report.read_text())
    assert data["stop"]["reason"] is None and data["hand_path_ratio"] > 0.7
