"""A synthetic performer who walks: feet that stay where they are put down, and legs of one length."""

import numpy as np

from sim.performer import SHANK, STROLL_LIFT, STROLL_S, THIGH, strolling_performer


def test_who_strolls_stands_walks_and_stands_again() -> None:
    frames = strolling_performer(rate_hz=60.0)
    assert frames.joints is not None
    joints = dict(zip(frames.joints.names, np.moveaxis(frames.joints.position, 1, 0), strict=True))
    begin, end, _ = STROLL_S
    walks = (frames.time > begin) & (frames.time < end)
    in_air = [joints[f"{side}_ankle"][:, 2] > joints[f"{side}_ankle"][0, 2] + 1e-6 for side in "lr"]
    assert not (in_air[0] & in_air[1]).any() and not (in_air[0] | in_air[1])[~walks].any()
    for side, lifted in zip("lr", in_air, strict=True):
        ankle = joints[f"{side}_ankle"]
        assert np.abs(np.diff(ankle, axis=0)[~lifted[1:] & ~lifted[:-1]]).max() < 1e-9
        assert np.ptp(ankle[:, 2]) < STROLL_LIFT + 1e-9 and ankle[-1, 0] - ankle[0, 0] > 3.0
        for one, other, length in (("hip", "knee", THIGH), ("knee", "ankle", SHANK)):
            bones = np.linalg.norm(joints[f"{side}_{one}"] - joints[f"{side}_{other}"], axis=1)
            np.testing.assert_allclose(bones, length, atol=1e-9)
    assert abs(joints["l_ankle"][-1, 0] - joints["r_ankle"][-1, 0]) < 0.05
