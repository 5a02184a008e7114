"""The benchmark of the viewer: what it counts, and that a client really reads the page."""

import json

import numpy as np
import pytest

from benchmarks.looker import CAMERA
from benchmarks.viewer import TickMeter, row


def test_a_loop_is_metered_between_its_sleeps() -> None:
    meter = TickMeter()
    meter.sleep_until(0.0)
    meter.counting = True
    sum(range(20_000))
    deadline = meter.now()
    meter.sleep_until(deadline)
    assert len(meter.cpu) == len(meter.late) == 1 and meter.cpu[0] > 0.0 and meter.late[0] >= 0.0


def test_a_row_is_in_ms_beside_the_loop_without_a_page() -> None:
    found = row("looked at", np.full(100, 2e-3), np.array([*np.full(99, 1e-4), 0.02]), without=1.6e-3, period=0.008)
    assert (found.cpu_p50, found.share, found.missed) == pytest.approx((2.0, 1.25, 1))
    assert found.longest == pytest.approx(20.0)


def test_who_looks_is_taken_for_a_browser() -> None:
    viser = pytest.importorskip("viser", reason="the viewer's extra is not installed")
    msgspec = pytest.importorskip("msgspec")
    message = viser._messages.Message.deserialize(msgspec.msgpack.encode(CAMERA))
    assert type(message).__name__ == "ViewerCameraMessage" and json.dumps(CAMERA)
