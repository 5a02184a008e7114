"""A skeleton's definition, made from a person, gives that person's joints back, whatever its names and axes."""

import numpy as np
import pytest

from natnet_packets import Body, Catalogue, definitions, server_info
from people import at_rest
from retarget.calibration import dimensions_from_skeleton
from retarget.human_dimensions import proportional_dimensions
from retarget.live.told_skeleton import told_skeleton
from retarget.rotations import FloatArray
from retarget.sources.natnet_decoder import NatnetDecoder
from retarget.sources.natnet_wire import Version

PERSON = proportional_dimensions(1.83)
SIDED = {"collar": "Shoulder", "shoulder": "UArm", "elbow": "FArm", "wrist": "Hand"}
SIDED |= {"hip": "Thigh", "knee": "Shin", "ankle": "Foot", "toe": "Toe"}
BONES = {"pelvis": "Hip", "spine": "Ab", "chest": "Chest", "neck": "Neck", "head": "Head"}
BONES |= {f"{side}_{part}": side.upper() + name for part, name in SIDED.items() for side in "lr"}
HUMAN_IK = {"shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hip": "UpLeg", "knee": "Leg", "ankle": "Foot"}
V41 = Version(4, 1)
LIMBS = ("knee", "ankle", "elbow", "wrist")


def bones(names: dict[str, str], *, up: str = "y", parents: dict[str, str] | None = None) -> list[Body]:
    """The definition of a person who stands in a T-pose and faces Motive's z, or, where z is up, minus y."""
    points = at_rest(PERSON, np.pi / 2, splay=0.0)
    above = {"pelvis": ""} | (parents or {})
    numbers = {joint: number for number, joint in enumerate(names, start=1)}
    found = []
    for joint, name in names.items():
        parent = above.get(joint, "pelvis")
        offset = points[joint] - points[parent] if parent else np.zeros(3)
        forward, left, height = offset.tolist()
        at = (left, height, forward) if up == "y" else (left, -forward, height)
        found.append(Body(name, numbers[joint], numbers.get(parent, -1), at))
    return found


CHAIN = {"elbow": "shoulder", "wrist": "elbow", "knee": "hip", "ankle": "knee", "toe": "ankle"}
PARENTS = {f"{side}_{part}": f"{side}_{parent}" for part, parent in CHAIN.items() for side in "lr"}


def told(owner: str, body: list[Body], *, version: Version = V41, up: str = "y") -> NatnetDecoder:
    decoder = NatnetDecoder(up="z" if up == "z" else "y")
    decoder.decode(server_info(version))
    decoder.decode(definitions(Catalogue(skeletons=[(owner, 3, body)]), version))
    return decoder


@pytest.mark.parametrize("up", ["y", "z"])
@pytest.mark.parametrize("version", [Version(3, 0), V41, Version(4, 4)])
@pytest.mark.parametrize("prefix", ["", "Al_"])
def test_limbs_are_as_they_are_told(up: str, version: Version, prefix: str) -> None:
    names = {joint: prefix + bone for joint, bone in BONES.items()}
    decoder = told("Al", bones(names, up=up, parents=PARENTS), version=version, up=up)
    skeleton = told_skeleton(decoder, ["rigid://hat", "bone://Al/Head", "bone://Al/LHand"])
    assert skeleton is not None
    size = dimensions_from_skeleton(skeleton)
    for limb in LIMBS:
        for side in "lr":
            assert size.length(f"{side}_{limb}") == pytest.approx(PERSON.length(f"{side}_{limb}"), abs=1e-5)


def test_other_names_of_bones() -> None:
    sided = {
        f"{s}_{part}": word + bone for part, bone in HUMAN_IK.items() for s, word in (("l", "Left"), ("r", "Right"))
    }
    names = {"pelvis": "Hips", "neck": "Neck", "head": "Head"} | sided
    skeleton = told_skeleton(told("Al", bones(names, parents=PARENTS)), ["bone://Al/Head"])
    assert skeleton is not None and skeleton.distance("l_knee", "l_ankle") == pytest.approx(PERSON.length("l_ankle"))


@pytest.mark.parametrize(
    "names", [[], ["rigid://head"], ["bone://Bo/Head"], ["bone://Al/Head", "bone://Bo/Head"], ["bone://"]]
)
def test_whose_bones_nobody_listens_for_has_no_skeleton(names: list[str]) -> None:
    assert told_skeleton(told("Al", bones(BONES)), names) is None


def _circle(body: list[Body]) -> list[Body]:
    number = {bone.name: bone.number for bone in body}
    after = {"LUArm": "LFArm", "LFArm": "LHand", "LHand": "LUArm"}
    return [Body(b.name, b.number, number[after[b.name]] if b.name in after else b.parent, b.offset) for b in body]


def test_what_is_no_human_is_no_skeleton_and_no_error() -> None:
    assert told_skeleton(told("Al", bones(BONES)[:4]), ["bone://Al/Head"]) is None
    odd = told_skeleton(told("Al", _circle(bones(BONES, parents=PARENTS))), ["bone://Al/Head"])
    assert odd is not None and "l_wrist" not in odd.names and "r_wrist" in odd.names
    assert told_skeleton(told("Al", [Body(bone.name, 1, 1) for bone in bones(BONES)]), ["bone://Al/Head"]) is None


def test_it_faces_x() -> None:
    decoder = told("Al", bones(BONES, parents=PARENTS, up="z"), up="z")
    skeleton = decoder.rest("Al")
    assert skeleton is not None
    across: FloatArray = skeleton.of("l_shoulder") - skeleton.of("r_shoulder")
    assert across[1] > 0.2 and abs(across[0]) < 1e-6 and skeleton.of("l_toe")[0] > skeleton.of("l_ankle")[0] + 0.05
    assert decoder.rest("Bo") is None
