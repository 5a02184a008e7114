"""Roles of MVN segments: every canonical sensor has its place and orientation, the same on both sides."""

from mvn_packets import scale, standing
from retarget.frames import JOINTS, SENSORS, mirrored_name
from retarget.sources.mvn import MvnDecoder
from retarget.sources.mvn_roles import MVN_JOINTS, MVN_SENSORS
from retarget.sources.mvn_wire import SEGMENTS


def other_side(segment: str) -> str:
    return segment.replace("Left", "?").replace("Right", "Left").replace("?", "Right")


def test_every_sensor_has_segments() -> None:
    assert set(MVN_SENSORS) == set(SENSORS)
    assert {role.position for role in MVN_SENSORS.values()} <= set(SEGMENTS)
    assert {role.orientation for role in MVN_SENSORS.values()} <= set(SEGMENTS)


def test_joints_are_canonical_and_each_is_another_segment() -> None:
    assert set(JOINTS) - set(MVN_JOINTS) == {"l_hand", "r_hand"}
    assert len(set(MVN_JOINTS.values()) & set(SEGMENTS)) == len(MVN_JOINTS)


def test_sides_agree() -> None:
    for name, role in MVN_SENSORS.items():
        twin = MVN_SENSORS[mirrored_name(name)]
        assert (other_side(role.position), other_side(role.orientation)) == (twin.position, twin.orientation)
        assert (name[:2] == "l_") == role.position.startswith("Left") == role.orientation.startswith("Left")
    for name, segment in MVN_JOINTS.items():
        assert MVN_JOINTS[mirrored_name(name)] == other_side(segment)


def test_a_sensor_lies_at_the_joint_of_its_name() -> None:
    assert all(MVN_JOINTS[name] == role.position for name, role in MVN_SENSORS.items())


def test_limb_lengths_of_the_t_pose() -> None:
    places = {SEGMENTS[number - 1]: place for number, place, _ in standing()}
    places |= {"RightUpperArm": (0.0, -0.2, 1.4), "RightForeArm": (0.0, -0.5, 1.4)}
    decoder = MvnDecoder()
    decoder.decode(scale(list(places.items())))
    assert decoder.rest is not None
    skeleton = decoder.rest.skeleton()
    assert set(skeleton.names) == set(MVN_JOINTS)
    assert abs(skeleton.distance("r_shoulder", "r_elbow") - 0.3) < 1e-6
    assert not skeleton.of("pelvis").any()
