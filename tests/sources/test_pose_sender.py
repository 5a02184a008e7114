"""The benchmark's performer: frames that our own decoder takes, still at first, then moving."""

import numpy as np

from benchmarks.pose_sender import RATE_HZ, STANDING, STILL_S, message
from retarget.sources.json_pose import JsonPoseDecoder
from retarget.types import FloatArray


def test_every_frame_is_decoded_and_only_wrists_move_after_a_while() -> None:
    decoder, sent = JsonPoseDecoder(), list[FloatArray]()
    for number in range(0, round(3 * STILL_S * RATE_HZ), 7):
        (frame,) = decoder.decode(message(number))
        assert frame.names == tuple(STANDING)
        sent.append(np.array(frame.position))
    track = np.array(sent)
    still, wrists = round(STILL_S * RATE_HZ / 7) - 1, [name.endswith("wrist") for name in STANDING]
    assert decoder.dropped.count == 0
    assert np.ptp(track[:still], axis=0).max() < 0.001 < np.ptp(track[:, wrists, 2], axis=0).min()
    assert np.ptp(track[:, ~np.array(wrists)], axis=0).max() < 0.001
    assert (np.abs(np.diff(track[:, 0, 0])) > 0.0).all()
