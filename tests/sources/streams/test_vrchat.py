"""VRChat trackers: names, poses, what is dropped, and damaged datagrams."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from osc_bytes import bundle, message
from retarget.sources.streams.osc import UNKNOWN_ADDRESS
from retarget.sources.streams.vrchat import NOT_A_TRACKER, WRONG_ARGUMENTS, VrchatDecoder


def at(tracker: str, *numbers: float) -> bytes:
    return message(f"/tracking/trackers/{tracker}/position", "fff", *(numbers or (1.0, 2.0, 3.0)))


def test_golden_bytes() -> None:
    golden = b"/tracking/trackers/1/position\0\0\0,fff\0\0\0\0\x3f\x80\0\0\x40\0\0\0\x40\x40\0\0"
    assert golden == at("1")
    (frame,) = VrchatDecoder().decode(golden)
    assert frame.names == ("tracker://1",) and frame.stamp is None and frame.tracked.tolist() == [True]
    assert_allclose(frame.position, [[3.0, -1.0, 2.0]])
    assert np.isnan(frame.orientation).all()


@pytest.mark.parametrize("tags", ["iff", "fid", "hhh", "ddd", "FTi"])
def test_numbers_of_every_type_are_numbers(tags: str) -> None:
    typed = [(int if tag in "ih" else float)(x) for tag, x in zip(tags, (0, 1, 2), strict=True) if tag not in "TF"]
    (frame,) = VrchatDecoder().decode(message("/tracking/trackers/1/position", tags, *typed))
    assert_allclose(frame.position, VrchatDecoder().decode(at("1", 0.0, 1.0, 2.0))[0].position)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (at("0"), NOT_A_TRACKER),
        (at("9"), NOT_A_TRACKER),
        (at("-1"), NOT_A_TRACKER),
        (at("01"), NOT_A_TRACKER),
        (message("/tracking/trackers/1/velocity", "fff", 0.0, 0.0, 0.0), UNKNOWN_ADDRESS),
        (message("/tracking/eye/CenterPitchYaw", "ff", 0.0, 0.0), UNKNOWN_ADDRESS),
        (message("/tracking/trackers/1/position", "ff", 0.0, 0.0), WRONG_ARGUMENTS),
        (message("/tracking/trackers/1/position", "sff", "0", 0.0, 0.0), WRONG_ARGUMENTS),
    ],
)
def test_what_is_dropped_by_reason(bad: bytes, reason: str) -> None:
    decoder = VrchatDecoder()
    assert decoder.decode(bad) == []
    (frame,) = decoder.decode(bundle(bad, at("2")))
    assert frame.names == ("tracker://2",) and decoder.dropped.reasons == {reason: 2}
