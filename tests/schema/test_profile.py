"""Robot profiles: what is read, what the servo side and its guard get of it, what is refused, all errors at once."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from command_line import OP3, copy_of_op3
from hardware.joint_map import JointMap
from hardware.servo import Layout, ServoMode, find_model, full_drive_error, loop_stiffness
from messages import refuses
from retarget.errors import ConfigError, UsageError
from retarget.model.robot import load_profile
from retarget.schema.profile import RobotProfile
from retarget.schema.profile_checks import is_convex
from retarget.schema.profile_parts import Bus, Foot, Safety, safety_facts
from retarget.schema.strict_yaml import scan


def changed(folder: Path, *replacements: tuple[str, str]) -> RobotProfile:
    """OP3's profile after some replacements, each of which must apply."""
    return load_profile(copy_of_op3(folder, *replacements))


def refused(folder: Path, *replacements: tuple[str, str]) -> ConfigError:
    """How it is refused: every problem has its place in the file."""
    with refuses(ConfigError) as caught:
        changed(folder, *replacements)
    assert all(problem.where.startswith(f"{folder / 'robot.yaml'}:") for problem in caught.value.problems)
    return caught.value


def test_op3_by_name_folder_and_file_says_what_the_others_need() -> None:
    profile = load_profile("op3")
    assert profile == load_profile(OP3) == load_profile(OP3 / "robot.yaml")
    assert (profile.body_path, profile.path) == (OP3 / "body.xml", OP3 / "robot.yaml")
    assert sorted(servo.id for servo in profile.servos.values()) == list(range(1, 21))
    assert (profile.safety.rate_hz, profile.postures.stand["l_knee"]) == (125, 0.6)
    assert profile.feet["left"].frame == "l_sole"
    hand = profile.landmarks["l_hand"]
    assert (hand.frame, hand.follows, hand.measured_from) == ("l_hand", ("l_wrist",), ("l_shoulder",))
    assert hand.human_length == (("l_shoulder",), ("l_elbow",), ("l_wrist",))
    assert profile.landmarks["head"].human_length == (("l_hip", "r_hip"), ("head",))
    assert JointMap(profile.servo_specs()).joints == tuple(profile.servos)
    with pytest.raises(ValueError, match="frozen"):
        profile.name = "other"
    with refuses(UsageError, "op3", found="'op4'", next_step="op3"):
        load_profile("op4")


values = st.recursive(
    st.none() | st.booleans() | st.integers(-5, 5) | st.floats(-2, 2) | st.text("abl_ ", max_size=6),
    lambda node: (
        st.lists(node, max_size=3) | st.dictionaries(st.text("abl_", min_size=1, max_size=4), node, max_size=3)
    ),
    max_leaves=6,
)


def _paths(node: object, here: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    items = list(node.items()) if isinstance(node, dict) else list(enumerate(node)) if isinstance(node, list) else []
    return [here, *(path for key, value in items for path in _paths(value, (*here, key)))]


@pytest.mark.long
@settings(max_examples=25)
@given(data=st.data())
def test_any_value_in_any_place_is_read_or_refused(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    tree = scan((OP3 / "robot.yaml").read_text(encoding="utf-8"), OP3).data
    path = data.draw(st.sampled_from(_paths(tree)[1:]))
    node: object = tree
    for key in path[:-1]:
        node = node[key]  # type: ignore[index]
    node[path[-1]] = data.draw(values)  # type: ignore[index]
    folder = tmp_path_factory.getbasetemp()
    (folder / "body.xml").write_bytes((OP3 / "body.xml").read_bytes())
    (folder / "robot.yaml").write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    try:
        load_profile(folder / "robot.yaml")
    except ConfigError as error:
        assert str(folder) in str(error)


WRONG = {
    "unknown key": ("root: free", "root: free\nrooot: 1"),
    "nearest key": ("safety:", "safty:"),
    "unknown inner key": ("{id: 1, ", "{id: 1, gere: 2, "),
    "missing key": ("root: free\n", ""),
    "missing inner key": ("{id: 1, ", "{"),
    "duplicate key": ("root: free", "root: free\nroot: fixed"),
    "wrong type": ("zero_tick: 2048", "zero_tick: middle"),
    "text for a number": ("rate_hz: 125", "rate_hz: '125'"),
    "true for a number": ("rate_hz: 125", "rate_hz: true"),
    "list for a mapping": ("feet:\n", "feet: []\nfoot:\n"),
    "wrong choice": ("root: free", "root: fre"),
    "inverted limits": ("limits: [-1.745329, 2.094395]", "limits: [2.094395, -1.745329]"),
    "three limits": ("limits: [-1.745329, 2.094395]", "limits: [-1, 0, 1]"),
    "unknown joint": ("  l_el: ", "  l_ell:"),
    "duplicate servo id": ("{id: 2,", "{id: 1,"),
    "id not on the bus": ("{id: 2,", "{id: 77,"),
    "unknown bus": ("bus: main", "bus: man"),
    "unknown model": ("XM430-W350,", "XM430-W530,"),
    "beyond the travel": ("zero_tick: 2048", "zero_tick: 200"),
    "too fast": ("max_velocity: 4.5", "max_velocity: 9"),
    "NaN": ("max_velocity: 4.5", "max_velocity: .nan"),
    "zero acceleration": ("max_acceleration: 40.0", "max_acceleration: 0"),
    "alias": ("root: free", "root: &a free"),
    "limits beyond the body": ("limits: [-2.583087, 0]", "limits: [-2.8, 0]"),
    "unknown link": ("neck: {link: body_link", "neck: {link: boddy_link"),
    "unknown geom": ("geom: body_shell", "geom: body_shel"),
    "geom of another link": ("geom: body_shell", "geom: l_el_shell"),
    "two shapes": ("{geom: body_shell}", "{geom: body_shell, sphere: {at: [0, 0, 0], radius: 1}}"),
    "margin": ("influence: 0.05, margin: 0.004", "influence: 0.03, margin: 0.03"),
    "unknown link in a pair": ("pair: [l_hip_yaw_link", "pair: [l_hip_jaw_link"),
    "pair with itself": ("pair: [l_hip_yaw_link, l_hip_pitch_link]", "pair: [l_el_link, l_el_link]"),
    "quaternion": ("neck: {link: body_link,", "neck: {quat: [1, 1, 0, 0], link: body_link,"),
    "dented sole": ("[0.0635, 0.0285], [0.057, 0.039]", "[0.01, 0.0285], [0.057, 0.039]"),
    "sole frame": ("left: {frame: l_sole", "left: {frame: l_soul"),
    "posture limits": ("l_knee: 2.44", "l_knee: 2.6"),
    "posture joint": ("l_knee: 2.44", "l_kneee: 2.15"),
    "missing landmark": ("  head: {frame: head", "  hed: {frame: head"),
    "landmark frame": ("l_hand: {frame: l_hand", "l_hand: {frame: l_hnd"),
    "landmark anchor": ("anchor: pelvis", "anchor: [pelvis, pelfis]"),
    "human joint": ("follows: head", "follows: haed"),
    "human chain": ("[l_shoulder, l_elbow, l_wrist]", "[l_shoulder, l_elbo, l_wrist]"),
    "short chain": ("[l_shoulder, l_elbow, l_wrist]", "[l_shoulder]"),
    "voltage": ("voltage: [10.0, 14.8]", "voltage: [14.8, 10.0]"),
    "share": ("follow: 1.0", "follow: 1.5"),
    "no body": ("body: body.xml", "body: missing.xml"),
    "body is no body": ("body: body.xml", "body: robot.yaml"),
    "body path with a zero byte": ("body: body.xml", 'body: "a\\0b"'),
}
"""Texts of OP3's profile, and what replaces them."""


def test_all_errors_of_a_file_at_once(tmp_path: Path) -> None:
    error = refused(
        tmp_path,
        ("root: free", "root: free\nrooot: 1"),
        ("zero_tick: 2048", "zero_tick: x"),
        ("{id: 4,", "{id: 3,"),
        ("limits: [-1.396263, 1.396263]", "limits: [1.4, -1.4]"),
        ("geom: head_tilt_shell", "geom: none"),
        ("l_knee: 2.44", "l_knee: 2.6"),
        ("rate_hz: 125", "rate_hz: .inf"),
        ("retarget: servo", "retarget: servo\nname: again"),
    )
    assert len(error.problems) == 8


@pytest.mark.parametrize(
    ("polygon", "good"),
    [
        ([[0, 0], [1, 0], [1, 1], [0, 1]], True),
        ([[0, 0], [0, 1], [1, 1], [1, 0]], False),  # clockwise
        ([[0, 0], [1, 0], [0.4, 0.4], [0, 1]], False),  # dent
        ([[0, 0], [1, 0], [2, 0], [0, 1]], False),  # corner in line
        ([[0, 1], [-0.6, -0.8], [1, 0.3], [-1, 0.3], [0.6, -0.8]], False),  # star, every turn to the left
        ([[0, 0], [1, 0], [1, 0], [0, 1]], False),  # same corner twice
    ],
)
def test_sole_outlines(polygon: list[list[float]], good: bool) -> None:
    assert is_convex(Foot.model_validate({"frame": "f", "polygon": polygon}).polygon) is good


SERVO = "model: XM430-W350, bus: main, direction: 1, zero_tick: 2048, limits: [-2.356194,"
SPEED = "                 max_velocity: 4.5, max_acceleration: 40.0, gains: {p: 800, i: 0, d: 0}}"
LINE = f"head_pan:    {{id: 19, {SERVO} 2.356194],\n{SPEED}\n  head_tilt:   {{id: 20, {SERVO} 1.570796],\n{SPEED}\n"
POWER = "power: {id: 200, register: 24, value: 1}"
WATCHDOG = "watchdog_s: 0.08"


def servo(name: str, number: int, *, extra: str = "", model: str = "XM430-W350", gains: str = "{p: 800}") -> str:
    return (
        f"{name}: {{id: {number}, model: {model}, bus: main, direction: 1, zero_tick: 2048, limits: [-0.5, 0.5], "
        f"max_velocity: 2.0, max_acceleration: 40.0, gains: {gains}{extra}}}\n"
    )


def head(*, extra: str = "", **options: str) -> tuple[str, str]:
    """Other servos of pan and tilt."""
    return LINE, servo("head_pan", 19, extra=extra, **options) + "  " + servo("head_tilt", 20, **options)


def coupled(matrix: str, joints: str = "[head_pan, head_tilt]") -> tuple[str, str]:
    return "\nbuses:\n", f"\ncouplings:\n  - {{joints: {joints}, matrix: {matrix}}}\nbuses:\n"


def stiff(line: str) -> tuple[str, str]:
    return "\nservos:\n", f"\nstiffness:\n  {line}\nservos:\n"


def test_the_stiffness_of_a_profile_holds_for_its_model_in_proportion_to_the_gain(tmp_path: Path) -> None:
    given = stiff("XM430-W350: {nominal: 9, range: [5, 20], p: 800}")
    *_, arm, pan, tilt = changed(tmp_path, given, head(gains="{p: 400}")).servo_specs()
    assert [loop_stiffness(one) for one in (arm, pan, tilt)] == [9.0, 4.5, 4.5]
    assert (pan.model.stiffness.lowest, pan.model.stiffness.highest) == (5.0, 20.0)
    *_, other = changed(tmp_path / "other", given, head(model="XL430-W250")).servo_specs()
    assert loop_stiffness(other) == pytest.approx(1.5 / full_drive_error(800))


def test_everything_a_servo_may_say_arrives(tmp_path: Path) -> None:
    extra = ", mode: current_based_position, current: 0.9, homing_offset: -3000"
    gains = "{p: 1, i: 2, d: 3, feedforward_1: 4, feedforward_2: 5}"
    *_, pan, tilt = changed(tmp_path, head(extra=extra, gains=gains)).servo_specs()
    assert (pan.mode, pan.current_limit, pan.homing_offset) == (ServoMode.CURRENT_BASED_POSITION, 0.9, -3000)
    assert (pan.gains.position_p, pan.gains.position_i, pan.gains.position_d) == (1, 2, 3)
    assert (pan.gains.feedforward_1, pan.gains.feedforward_2) == (4, 5)
    assert (tilt.mode, tilt.current_limit, tilt.homing_offset) == (ServoMode.POSITION, None, 0)


SERVOS_WRONG: dict[str, list[tuple[str, str]]] = {
    "mode": [head(extra=", mode: wheel")],
    "no current": [head(extra=", mode: current_based_position")],
    "mode of a model": [head(extra=", mode: current_based_position, current: 1.0", model="XL430-W250")],
    "current of a model": [head(extra=", current: 1.0", model="XL430-W250")],
    "homing offset": [head(extra=", homing_offset: 1025")],
    "travel": [("zero_tick: 2048", "zero_tick: 5000")],
    "id twice": [("ids: [1, 2,", "ids: [1, 1, 2,")],
    "protocol": [("protocol: 2", "protocol: 1")],
    "baud": [("baud: 2000000", "baud: 1500000")],
    "baud of a model": [("baud: 2000000", "baud: 4500000"), head(model="XL330-M288")],
    "watchdog": [(WATCHDOG, "watchdog_s: 0.05")],
    "long watchdog": [(WATCHDOG, "watchdog_s: 2.56")],
    "delay": [(POWER, "return_delay_us: 3")],
    "power elsewhere": [("id: 200, reg", "id: 201, reg")],
    "power of a servo": [("id: 200, reg", "id: 20, reg")],
    "IMU on no bus": [("bus: main, id: 200, link", "bus: mian, id: 200, link")],
    "IMU elsewhere": [("bus: main, id: 200, link", "bus: main, id: 201, link")],
    "IMU of a servo": [("bus: main, id: 200, link", "bus: main, id: 20, link")],
    "IMU without an id": [("bus: main, id: 200, link", "bus: main, link")],
    "IMU with a port": [("bus: main, id: 200, link", "bus: main, id: 200, port: /dev/imu, link")],
    "serial IMU without a port": [("opencr, bus: main, id: 200, link", "bno08x, link")],
    "serial IMU on a bus": [("opencr, bus", "bno08x, port: /dev/imu, bus")],
    "IMU of no kind": [("kind: opencr", "kind: mpu9250")],
    "IMU on no link": [("200, link: body_link", "200, link: trunk")],
    "coupling of unknown servos": [coupled("[[1, 0], [0, 1]]", "[head_pan, head_tild]")],
    "coupled twice": [coupled("[[1, 0], [0, 1]]", "[head_pan, head_pan]")],
    "singular": [coupled("[[1, 1], [1, 1]]")],
    "too far together": [coupled("[[-0.5, 0.5], [0.5, 0.5]]")],
    "geared": [head(extra=", gear: 2.0"), coupled("[[1, 0], [0, 1]]")],
    "three in a row": [coupled("[[1, 0, 0], [0, 1, 0]]")],
    "stiffness of no servo": [stiff("MX-28: {nominal: 9, range: [5, 20]}")],
    "stiffness out of its range": [stiff("XM430-W350: {nominal: 30, range: [5, 20]}")],
    "stiffness below 0": [stiff("XM430-W350: {nominal: 3, range: [-5, 20]}")],
    "stiffness with which gain": [stiff("XM430-W350: {nominal: 9, range: [5, 20]}"), head(gains="{p: 400}")],
}
"""The same of servos, couplings and buses: replacements."""


@pytest.mark.parametrize("case", [*WRONG, *SERVOS_WRONG])
def test_a_wrong_profile_is_refused_with_its_place(case: str, tmp_path: Path) -> None:
    assert refused(tmp_path, *(SERVOS_WRONG.get(case) or [WRONG[case]]))


def test_what_protocol_1_has_not_is_refused_at_once(tmp_path: Path) -> None:
    pan = servo("head_pan", 19, model="AX-12A", extra=", mode: extended_position", gains="{p: 1}")
    tilt = servo("head_tilt", 20, model="MX-28", extra=", homing_offset: 9", gains="{p: 255, feedforward_1: 1}")
    error = refused(tmp_path, ("protocol: 2", "protocol: 1\n    watchdog_s: 0.2"), (LINE, f"{pan}  {tilt}"))
    keys = {problem.where.rpartition(": ")[2] for problem in error.problems}
    assert keys >= {
        *("buses.main.watchdog_s", "buses.main.baud", "servos.head_pan.mode", "servos.head_pan.gains.p"),
        *("servos.head_tilt.homing_offset", "servos.head_tilt.gains.p", "servos.head_tilt.gains.feedforward_1"),
    }


def test_layouts_of_a_bus_are_told_apart_and_never_mixed(tmp_path: Path) -> None:
    """XL-320 beside the X series: one problem of the bus; and what an XL-320 has not, each in its place."""
    pan = servo("head_pan", 19, model="XL-320", extra=", mode: extended_position", gains="{p: 255, feedforward_1: 1}")
    tilt = servo("head_tilt", 20, model="XL-320", extra=", homing_offset: 9", gains="{p: 254, i: 1}")
    error = refused(tmp_path, (LINE, f"{pan}  {tilt}"))
    said = {problem.where.rpartition(": ")[2]: str(problem) for problem in error.problems}
    assert "XM430-W350" in said["buses.main"] and "XL-320" in said["buses.main"] and "layout" in said["buses.main"]
    assert set(said) >= {
        *("buses.main.baud", "servos.head_pan.mode", "servos.head_pan.gains.p"),
        *("servos.head_pan.gains.feedforward_1", "servos.head_tilt.homing_offset"),
    }
    assert not {"servos.head_tilt.gains.p", "servos.head_tilt.gains.i"} & set(said)


def test_a_bus_of_the_older_layout_has_no_watchdog() -> None:
    x, older = (find_model(name) for name in ("XM430-W350", "XL-320"))
    given = {"port": "/dev/a", "baud": 1000000, "ids": (1, 2)}
    first, line = (Bus.model_validate(given | {"protocol": protocol}) for protocol in (1, 2))
    assert line.spec("a", line.layout([x])).watchdog > 0.0 == line.spec("a", line.layout([older])).watchdog
    assert first.layout([]) is line.layout([older]) is Layout.OLDER and line.layout([]) is Layout.X


LEAST = {"rate_hz": 100.0, "freshness": 0.1, "temperature_c": 65.0, "voltage": [10.0, 14.8], "following_error": 0.35}
ALL = {
    "freshness_warn": 0.05,
    "temperature_warn_c": 58.0,
    "voltage_warn": [11.0, 14.0],
    "following_error_sustained": 0.2,
    "following_error_s": 0.3,
    "following_error_warn": 0.15,
    "current_a": 2.0,
    "current_warn_a": 1.5,
    "current_s": 0.7,
    "speed_caps": {"warm": 0.4},
}


def safety(**keys: object) -> Safety:
    return Safety.model_validate(LEAST | keys)


def test_every_key_arrives_at_the_guard_and_in_words() -> None:
    limits, facts = safety(**ALL).guard_limits(), safety_facts(safety(**ALL))
    assert (limits.warn_age, limits.warn_temperature, limits.warn_voltage) == (0.05, 58.0, (11.0, 14.0))
    assert (limits.sustained_error, limits.sustained_time, limits.warn_following_error) == (0.2, 0.3, 0.15)
    assert (limits.max_current, limits.warn_current, limits.current_time) == (2.0, 1.5, 0.7)
    assert limits.slow_share == 0.4
    plain, given = vars(safety().guard_limits()), vars(limits)
    same = {key for key in given if plain[key] == given[key]} - {"lag", "limbs", "max_pause", "max_silence"}
    assert same == {"max_age", "max_temperature", "voltage", "following_error"}
    assert facts["slows"] == "to 40% at 58 degrees Celsius, 1.5 A for 0.7 s"
    assert facts["warns"] == "outside 11 to 14 V, 0.15 rad from the goal for 0.3 s, silent for 0.05 s"
    assert facts["stops"] == (
        "65 degrees Celsius, outside 10 to 14.8 V, 2 A for 0.7 s, 0.35 rad from the goal, 0.2 rad for 0.3 s, "
        "silent for 0.1 s"
    )


@pytest.mark.parametrize(
    "line",
    [
        "temperature_warn_c: 65",
        "freshness_warn: 0.1",
        "following_error_sustained: 0.4",
        "following_error_warn: 0.25",
        "planned_lag: 0.25",
        "current_a: 1.0",
        "voltage_warn: [9.0, 14.0]",
        "voltage_warn: [14.0, 11.0]",
        "current_warn_a: -1",
        "current_s: no",
        "speed_caps: {warm: 0.1}",
        "temperature_warn: 60",
    ],
)
def test_a_warning_after_the_stop_is_refused(line: str, tmp_path: Path) -> None:
    key = line.split(":")[0]
    kept = [row for row in (OP3 / "robot.yaml").read_text().splitlines() if not row.startswith(f"  {key}:")]
    place = kept.index("safety:") + 1
    copy = copy_of_op3(tmp_path)
    copy.write_text("\n".join([*kept[:place], f"  {line}", *kept[place:]]) + "\n")
    with refuses(ConfigError, "safety"):
        load_profile(copy)
