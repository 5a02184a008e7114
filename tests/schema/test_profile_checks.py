"""Every wrong profile is refused with file, line, key, what was found and what is allowed; all errors at once."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from hardware.bus import PowerSwitch
from hardware.joint_map import JointMap
from hardware.servo import ServoMode
from retarget.errors import ConfigError
from retarget.model.robot import load_profile
from retarget.schema.profile import RobotProfile
from retarget.schema.profile_checks import is_convex
from retarget.schema.profile_parts import Foot

Change = Callable[..., str]


@pytest.fixture(scope="module")
def op3(root: Path) -> Path:
    return root / "configs" / "robots" / "op3"


@pytest.fixture
def changed(op3: Path, tmp_path: Path) -> Change:
    """Loads a copy of OP3's profile after some replacements, each of which must apply; gives the error's text."""

    def load(*replacements: tuple[str, str]) -> str:
        text = (op3 / "robot.yaml").read_text(encoding="utf-8")
        for old, new in replacements:
            assert old in text, old
            text = text.replace(old, new, 1)
        (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
        shutil.copy(op3 / "body.xml", tmp_path)
        with pytest.raises(ConfigError) as caught:
            load_profile(tmp_path)
        assert all(problem.where.startswith(str(tmp_path / "robot.yaml:")) for problem in caught.value.problems)
        return str(caught.value)

    return load


# Each: what is replaced, and a part of the message.
WRONG = {
    "unknown key": (
        ("root: free", "root: free\nrooot: 1"),
        ":6: rooot: unknown key; found 'rooot'; allowed: name, body",
    ),
    "nearest key": (("safety:", "safty:"), "Did you mean safety?"),
    "unknown inner key": (("{id: 1, ", "{id: 1, gere: 2, "), "servos.r_sho_pitch.gere: unknown key; found 'gere'"),
    "missing key": (("root: free\n", ""), "root: missing key. Add 'root'."),
    "missing inner key": (("{id: 1, ", "{"), "servos.r_sho_pitch.id: missing key. Add 'id'."),
    "duplicate key": (
        ("root: free", "root: free\nroot: fixed"),
        ":6: root: duplicate key; found the same key in line 5",
    ),
    "wrong type": (
        ("zero_tick: 2048", "zero_tick: middle"),
        "zero_tick: wrong value; found 'middle'; allowed: a whole number",
    ),
    "text for a number": (("rate_hz: 125", "rate_hz: '125'"), "safety.rate_hz: wrong value; found '125'"),
    "true for a number": (("rate_hz: 125", "rate_hz: true"), "safety.rate_hz: wrong value; found true"),
    "list for a mapping": (("feet:\n", "feet: []\nfoot:\n"), "feet: wrong value; found []; allowed: a mapping of keys"),
    "wrong choice": (
        ("root: free", "root: fre"),
        "found 'fre'; allowed: 'free', 'fixed' or 'suspended'. Did you mean free?",
    ),
    "inverted limits": (
        ("limits: [-1.745329, 2.094395]", "limits: [2.094395, -1.745329]"),
        "servos.l_sho_roll.limits: inverted limits; found [2.094395, -1.745329]",
    ),
    "three limits": (("limits: [-1.745329, 2.094395]", "limits: [-1, 0, 1]"), "servos.l_sho_roll.limits"),
    "unknown joint": (("  l_el: ", "  l_ell:"), "servos.l_ell: unknown joint; found 'l_ell'; allowed: "),
    "joint without a servo": (("  l_el: ", "  l_ell:"), "servos: joints without a servo; found l_el"),
    "duplicate servo id": (
        ("{id: 2,", "{id: 1,"),
        "servos.l_sho_pitch.id: duplicate servo id; found 1, also of r_sho_pitch",
    ),
    "id not on the bus": (("{id: 2,", "{id: 77,"), "servos.l_sho_pitch.id: servo id not on its bus; found 77"),
    "unknown bus": (
        ("bus: main", "bus: man"),
        "servos.r_sho_pitch.bus: unknown bus; found 'man'; allowed: main. Did you mean main?",
    ),
    "unknown model": (("XM430-W350,", "XM430-W530,"), "unknown servo model; found 'XM430-W530'"),
    "beyond the travel": (
        ("zero_tick: 2048", "zero_tick: 200"),
        "servos.r_sho_pitch: limits -2.9671 to 2.9671 rad need ticks -1734 to 2134; allowed: 0 to 4095",
    ),
    "too fast": (
        ("max_velocity: 4.5", "max_velocity: 9"),
        "max_velocity 9.000 rad/s is above the no-load speed 4.817",
    ),
    "NaN": (("max_velocity: 4.5", "max_velocity: .nan"), "max_velocity: a number that is not finite; found .nan"),
    "zero acceleration": (
        ("max_acceleration: 40.0", "max_acceleration: 0"),
        "max_acceleration: wrong value; found 0; allowed: greater than 0",
    ),
    "alias": (("root: free", "root: &a free"), "root: an anchor is not allowed; found &a"),
    "limits beyond the body": (
        ("limits: [-2.583087, 0]", "limits: [-2.8, 0]"),
        "servos.r_knee.limits: limits outside the joint's range in the body; found -2.8 to 0.0 rad",
    ),
    "unknown link": (
        ("neck: {link: body_link", "neck: {link: boddy_link"),
        "frames.neck.link: unknown link; found 'boddy_link'",
    ),
    "unknown geom": (
        ("geom: body_shell", "geom: body_shel"),
        "observers.torso.shape.geom: unknown geom; found 'body_shel'",
    ),
    "geom of another link": (
        ("geom: body_shell", "geom: l_el_shell"),
        "the geom is on another link; found l_el_shell on l_el_link",
    ),
    "two shapes": (
        ("{geom: body_shell}", "{geom: body_shell, sphere: {at: [0, 0, 0], radius: 1}}"),
        "not one shape; found",
    ),
    "margin": (
        ("influence: 0.05, margin: 0.004", "influence: 0.03, margin: 0.03"),
        "observers.torso.margin: the margin must be smaller",
    ),
    "unknown link in a pair": (
        ("pair: [l_hip_yaw_link", "pair: [l_hip_jaw_link"),
        "ignore_pairs[0].pair[0]: unknown link",
    ),
    "pair with itself": (
        ("pair: [l_hip_yaw_link, l_hip_pitch_link]", "pair: [l_el_link, l_el_link]"),
        "a pair needs two different links",
    ),
    "quaternion": (
        ("neck: {link: body_link,", "neck: {quat: [1, 1, 0, 0], link: body_link,"),
        "frames.neck.quat: not a unit quaternion",
    ),
    "dented sole": (
        ("[0.0635, 0.0285], [0.057, 0.039]", "[0.01, 0.0285], [0.057, 0.039]"),
        "feet.left.polygon: the sole's outline is not convex",
    ),
    "sole frame": (("left: {frame: l_sole", "left: {frame: l_soul"), "feet.left.frame: unknown frame; found 'l_soul'"),
    "posture limits": (
        ("l_knee: 2.44", "l_knee: 2.6"),
        "postures.rest.l_knee: posture outside the joint's limits; found 2.6 rad",
    ),
    "posture joint": (("l_knee: 2.44", "l_kneee: 2.15"), "postures.rest.l_kneee: unknown joint; found 'l_kneee'"),
    "missing landmark": (("  head: {frame: head", "  hed: {frame: head"), "landmarks: landmarks are missing"),
    "landmark frame": (
        ("l_hand: {frame: l_hand", "l_hand: {frame: l_hnd"),
        "landmarks.l_hand.frame: unknown frame; found 'l_hnd'",
    ),
    "landmark anchor": (
        ("anchor: pelvis", "anchor: [pelvis, pelfis]"),
        "landmarks.head.anchor: unknown frame; found 'pelfis'",
    ),
    "human joint": (("follows: head", "follows: haed"), "landmarks.head.follows: unknown human joint; found 'haed'"),
    "human chain": (
        ("[l_shoulder, l_elbow, l_wrist]", "[l_shoulder, l_elbo, l_wrist]"),
        "human_length: unknown human joint; found 'l_elbo'",
    ),
    "short chain": (("[l_shoulder, l_elbow, l_wrist]", "[l_shoulder]"), "landmarks.l_hand.human_length"),
    "voltage": (("voltage: [10.0, 14.8]", "voltage: [14.8, 10.0]"), "safety.voltage: inverted limits"),
    "share": (
        ("follow: 1.0", "follow: 1.5"),
        "safety.speed_caps.follow: wrong value; found 1.5; allowed: less than or equal to 1",
    ),
    "no body": (("body: body.xml", "body: missing.xml"), "body: the body cannot be used"),
    "body is no body": (("body: body.xml", "body: robot.yaml"), "body: the body cannot be used"),
    "body path with a zero byte": (("body: body.xml", 'body: "a\\0b"'), "body: the body cannot be used"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_profile_is_refused_with_its_place(case: str, changed: Change) -> None:
    replacement, part = WRONG[case]
    assert part in changed(replacement)


def test_all_errors_of_a_file_at_once(changed: Change) -> None:
    text = changed(
        ("root: free", "root: free\nrooot: 1"),
        ("zero_tick: 2048", "zero_tick: x"),
        ("{id: 4,", "{id: 3,"),
        ("limits: [-1.396263, 1.396263]", "limits: [1.4, -1.4]"),
        ("geom: head_tilt_shell", "geom: none"),
        ("l_knee: 2.44", "l_knee: 2.6"),
        ("rate_hz: 125", "rate_hz: .inf"),
        ("retarget: servo", "retarget: servo\nname: again"),
    )
    for part in (
        *("8 problems", "rooot: unknown key", "zero_tick: wrong value", "duplicate servo id", "inverted limits"),
        *("unknown geom", "posture outside", "not finite", "name: duplicate key"),
    ):
        assert part in text, text


def test_one_fault_is_reported_once(changed: Change) -> None:
    assert "problems" not in changed(("max_velocity: 4.5", "max_velocity: .nan"))
    assert "problems" not in changed(("limits: [-1.745329, 2.094395]", "limits: [2.094395, -1.745329]"))
    assert "problems" not in changed(("name: op3", "name: &n op3"))


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


PAN = (
    "head_pan:    {id: 19, model: XM430-W350, bus: main, direction: 1, zero_tick: 2048, limits: [-2.356194, 2.356194],"
)
SPEED = "max_velocity: 4.5, max_acceleration: 40.0, gains: {p: 800, i: 0, d: 0}}"
TILT = (
    "head_tilt:   {id: 20, model: XM430-W350, bus: main, direction: 1, zero_tick: 2048, limits: [-2.356194, 1.570796],"
)
LINE = f"{PAN}\n                 {SPEED}\n  {TILT}\n                 {SPEED}\n"
POWER = "power: {id: 200, register: 24, value: 1}"
WATCHDOG = "watchdog_s: 0.08"


def servo(name: str, number: int, *, extra: str = "", model: str = "XM430-W350", gains: str = "{p: 800}") -> str:
    return (
        f"{name}: {{id: {number}, model: {model}, bus: main, direction: 1, zero_tick: 2048, limits: [-0.5, 0.5], "
        f"max_velocity: 2.0, max_acceleration: 40.0, gains: {gains}{extra}}}\n"
    )


def load(folder: Path, root: Path, *replacements: tuple[str, str]) -> RobotProfile:
    """OP3's profile after some replacements, each of which must apply."""
    op3 = root / "configs" / "robots" / "op3"
    text = (op3 / "robot.yaml").read_text(encoding="utf-8")
    for old, new in replacements:
        assert old in text, old
        text = text.replace(old, new, 1)
    (folder / "robot.yaml").write_text(text, encoding="utf-8")
    shutil.copy(op3 / "body.xml", folder)
    return load_profile(folder)


def head(*, extra: str = "", **options: str) -> tuple[str, str]:
    """Other servos of pan and tilt."""
    return LINE, servo("head_pan", 19, extra=extra, **options) + "  " + servo("head_tilt", 20, **options)


def coupled(matrix: str, joints: str = "[head_pan, head_tilt]") -> tuple[str, str]:
    return "\nbuses:\n", f"\ncouplings:\n  - {{joints: {joints}, matrix: {matrix}}}\nbuses:\n"


def test_a_plain_profile_says_what_it_always_said(tmp_path: Path, root: Path) -> None:
    profile = load(tmp_path, root)
    (bus,) = profile.bus_specs()
    assert (bus.name, bus.baud, bus.protocol, bus.watchdog_value, bus.return_delay_value) == ("main", 2000000, 2, 4, 0)
    assert bus.power == PowerSwitch(id=200, register=24, value=1, wait=0.5)
    assert bus.ids[-1] == 200
    assert all(spec.mode is ServoMode.POSITION and spec.coupling is None for spec in profile.servo_specs())


def test_everything_a_servo_may_say_arrives(tmp_path: Path, root: Path) -> None:
    extra = ", mode: current_based_position, current: 0.9, homing_offset: -3000"
    gains = "{p: 1, i: 2, d: 3, feedforward_1: 4, feedforward_2: 5}"
    *_, pan, tilt = load(tmp_path, root, head(extra=extra, gains=gains)).servo_specs()
    assert (pan.mode, pan.current_limit, pan.homing_offset) == (ServoMode.CURRENT_BASED_POSITION, 0.9, -3000)
    assert (pan.gains.position_p, pan.gains.position_i, pan.gains.position_d) == (1, 2, 3)
    assert (pan.gains.feedforward_1, pan.gains.feedforward_2) == (4, 5)
    assert (tilt.mode, tilt.current_limit, tilt.homing_offset) == (ServoMode.POSITION, None, 0)


def test_a_bus_says_its_watchdog_delay_and_switch(tmp_path: Path, root: Path) -> None:
    more = "power: {id: 200, register: 500, value: 7, wait_s: 1.5}\n    return_delay_us: 20"
    (bus,) = load(tmp_path, root, (POWER, more), (WATCHDOG, "watchdog_s: 0.06")).bus_specs()
    assert (bus.watchdog_value, bus.return_delay_value) == (3, 10)
    assert bus.power == PowerSwitch(200, 500, 7, 1.5)


def test_coupled_joints_share_one_coupling(tmp_path: Path, root: Path) -> None:
    profile = load(tmp_path, root, head(), coupled("[[-0.5, 0.5], [0.5, 0.5]]"))
    joint_map = JointMap(profile.servo_specs())
    *_, pan, tilt = profile.servo_specs()
    assert pan.coupling == tilt.coupling and pan.coupling is not None
    asked = joint_map.to_radians(joint_map.to_ticks(joint_map.lower / 2))
    assert asked == pytest.approx(joint_map.lower / 2, abs=1e-2)


# Each: replacements, and a part of the message.
PROFILE_SERVOS_WRONG = {
    "mode": ((head(extra=", mode: wheel"),), "head_pan.mode: wrong value; found 'wheel'"),
    "no current": (
        (head(extra=", mode: current_based_position"),),
        "head_pan.current: missing key: this mode needs it",
    ),
    "mode of a model": (
        (head(extra=", mode: current_based_position, current: 1.0", model="XL430-W250"),),
        "head_pan.mode: the XL430-W250 has no such mode; found current_based_position",
    ),
    "current of a model": (
        (head(extra=", current: 1.0", model="XL430-W250"),),
        "head_pan.current: the XL430-W250 limits no current",
    ),
    "homing offset": ((head(extra=", homing_offset: 1025"),), "homing_offset: more than this mode honours; found 1025"),
    "travel": (
        (("zero_tick: 2048", "zero_tick: 5000"),),
        "servos.r_sho_pitch: limits -2.9671 to 2.9671 rad need ticks 3066 to 6934; allowed: 0 to 4095",
    ),
    "protocol": ((("protocol: 2", "protocol: 1"),), "found XM430-W350 on bus 'main' of protocol 1; allowed: 2"),
    "baud": ((("baud: 2000000", "baud: 1500000"),), "main.baud: no speed of protocol 2 servos; found 1500000"),
    "baud of a model": (
        (("baud: 2000000", "baud: 4500000"), head(model="XL330-M288")),
        "main.baud: too fast for the XL330-M288 on this bus; found 4500000; allowed: at most 4000000",
    ),
    "watchdog": (((WATCHDOG, "watchdog_s: 0.05"),), "main.watchdog_s: wrong value; found 0.05 s; allowed: a multiple"),
    "long watchdog": (((WATCHDOG, "watchdog_s: 2.56"),), "main.watchdog_s: wrong value; found 2.56"),
    "delay": (((POWER, "return_delay_us: 3"),), "main.return_delay_us: wrong value; found 3; allowed: a multiple of 2"),
    "power elsewhere": ((("id: 200, reg", "id: 201, reg"),), "power.id: the power switch is not on its bus; found 201"),
    "power of a servo": ((("id: 200, reg", "id: 20, reg"),), "power.id: a servo cannot switch the servos' power"),
    "coupling of unknown servos": (
        (coupled("[[1, 0], [0, 1]]", "[head_pan, head_tild]"),),
        "couplings[0].joints[1]: unknown joint; found 'head_tild'",
    ),
    "coupled twice": (
        (coupled("[[1, 0], [0, 1]]", "[head_pan, head_pan]"),),
        "needs two different joints",
    ),
    "singular": ((coupled("[[1, 1], [1, 1]]"),), "couplings[0]: coupling of head_pan and head_tilt: the matrix"),
    "too far together": ((coupled("[[-0.5, 0.5], [0.5, 0.5]]"),), "need ticks -1024 to 4608 of servo 19"),
    "geared": ((head(extra=", gear: 2.0"), coupled("[[1, 0], [0, 1]]")), "servos.head_pan: a coupled servo has gear 1"),
    "three in a row": ((coupled("[[1, 0, 0], [0, 1, 0]]"),), "couplings[0].matrix"),
}


@pytest.mark.parametrize("case", list(PROFILE_SERVOS_WRONG))
def test_every_wrong_entry_is_reported_with_its_place(case: str, tmp_path: Path, root: Path) -> None:
    replacements, text = PROFILE_SERVOS_WRONG[case]
    with pytest.raises(ConfigError) as refusal:
        load(tmp_path, root, *replacements)
    assert text in str(refusal.value)


def test_what_protocol_1_has_not_is_refused_at_once(tmp_path: Path, root: Path) -> None:
    pan = servo("head_pan", 19, model="AX-12A", extra=", mode: extended_position", gains="{p: 1}")
    tilt = servo("head_tilt", 20, model="MX-28", extra=", homing_offset: 9", gains="{p: 255, feedforward_1: 1}")
    with pytest.raises(ConfigError) as refusal:
        load(tmp_path, root, ("protocol: 2", "protocol: 1\n    watchdog_s: 0.2"), (LINE, f"{pan}  {tilt}"))
    text = "\n".join(problem.render() for problem in refusal.value.problems)
    for part in (
        "watchdog_s: servos of protocol 1 have no watchdog; found 0.2 s",
        "head_pan.mode: servos of protocol 1 hold positions within one turn only",
        "head_pan.gains.p: the AX-12A has no such gain",
        "head_tilt.homing_offset: no homing offset",
        "head_tilt.gains.p: wrong value for protocol 1; found 255; allowed: 0 to 254",
        "head_tilt.gains.feedforward_1: the MX-28 has no such gain",
        "main.baud: too fast for the AX-12A on this bus",
    ):
        assert part in text
