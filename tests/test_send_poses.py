"""The sender example: what it sends is used, and waves."""

import math
import re
import runpy
import socket
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from hardware.clock import VirtualClock
from retarget.frames import SENSORS
from retarget.sources.json_pose import DEFAULT_PORT, JsonPoseDecoder


def test_a_waving_performer_is_decoded(root: Path) -> None:
    sender = runpy.run_path(str(root / "examples/send_poses.py"), run_name="sender")
    decoder = JsonPoseDecoder()
    frames = [frame for number in range(720) for frame in decoder.decode(sender["message"](number))]
    assert len(frames) == 720 and decoder.dropped.count == 0
    assert set(frames[0].names) == set(SENSORS[:5])
    assert [frame.number for frame in frames] == list(range(720))
    assert math.isclose(frames[60].stamp or 0.0, 1.0)
    position = np.stack([frame.position for frame in frames])
    span = dict(zip(frames[0].names, np.ptp(position, axis=0), strict=True))
    assert span.pop("r_wrist")[2] > 0.7 and all(0.0 < still.max() < 0.01 for still in span.values())
    assert np.ptp(position[:360], axis=0).max() < 0.01  # who is measured stands still
    place = dict(zip(frames[0].names, position[0], strict=True))
    assert place["l_wrist"][1] > 0.0 > place["r_wrist"][1] and place["head"][2] > 1.5


def test_it_sends_what_it_makes_in_real_time(root: Path) -> None:
    sender = runpy.run_path(str(root / "examples/send_poses.py"), run_name="sender")
    clock = VirtualClock()
    sender["main"].__globals__["time"] = SimpleNamespace(monotonic=clock.now, sleep=clock.advance)
    begin = clock.now()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(5.0)
        sender["main"]("127.0.0.1", str(receiver.getsockname()[1]), "0.5")
        received = [receiver.recv(65536) for _ in range(30)]
    assert received == [sender["message"](number) for number in range(30)]
    assert math.isclose(clock.now() - begin, 0.5)


def test_it_is_short_and_needs_nothing_installed(root: Path) -> None:
    text = (root / "examples/send_poses.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 40 and f'"{DEFAULT_PORT}"' in text
    imported = re.findall(r"^(?:import|from) (\w+)", text, re.MULTILINE)
    assert imported and set(imported) <= sys.stdlib_module_names
