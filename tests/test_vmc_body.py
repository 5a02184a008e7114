"""Bones of an avatar as poses in the world, from SlimeVR's own bytes and from made ones."""

from pathlib import Path

import numpy as np
import pytest

from osc_bytes import bundle, message, pose
from retarget.sources.raw_record import RawReader
from retarget.sources.vmc_body import VmcBodyDecoder

ME = (1.0, 0.0, 0.0, 0.0)


def bone(name: str, *, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> bytes:
    return pose("/VMC/Ext/Bone/Pos", name, *at, 0.0, 0.0, 0.0, 1.0)


def test_in_the_t_pose_everybody_stands_on_the_ground_with_arms_out() -> None:
    names = ("Hips", "Spine", "Head", *(s + p for s in ("Left", "Right") for p in PARTS))
    (frame,) = VmcBodyDecoder().decode(bundle(*(bone(name) for name in names)))
    at = dict(zip(frame.names, frame.position, strict=True))
    assert (
        at["bone://LeftFoot"][2] == pytest.approx(at["bone://RightFoot"][2]) and 0.04 < at["bone://LeftFoot"][2] < 0.1
    )
    assert at["bone://LeftHand"][1] > 0.6 and at["bone://RightHand"][1] < -0.6
    assert 1.4 < at["bone://Head"][2] < 1.7
    np.testing.assert_allclose(frame.orientation[0], ME)


PARTS = ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")


def test_an_avatar_in_several_datagrams_is_put_together() -> None:
    decoder = VmcBodyDecoder()
    (half,) = decoder.decode(bundle(bone("Hips"), bone("Spine"), bone("Head")))
    known = dict(zip(half.names, half.tracked, strict=True))
    assert known["bone://Head"] and not known["bone://LeftHand"]
    (whole,) = decoder.decode(bundle(*(bone(s + p) for s in ("Left", "Right") for p in PARTS)))
    assert dict(zip(whole.names, whole.tracked, strict=True))["bone://LeftHand"]
    assert decoder.decode(bundle(message("/VMC/Ext/T", "f", 1.0))) == []


def test_slimevr_s_bones_agree_with_its_roles(shared: Path) -> None:
    decoder, heights = VmcBodyDecoder(), []
    for record in RawReader(shared / "streams/slimevr/full12_vmc_50hz.udprec.gz"):
        for frame in decoder.decode(record.payload):
            at = dict(zip(frame.names, frame.position, strict=True))
            heights.append((at["bone://LeftHand"][2], at["bone://RightFoot"][2], at["bone://Head"][2]))
    hand, foot, head = np.array(heights).T
    assert len(heights) > 600
    assert hand.max() - hand.min() > 0.4  # the left arm goes up to the side
    assert foot.min() > 0.0 and foot.max() < 0.2 and head.min() > 1.3
