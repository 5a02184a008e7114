"""Every wrong profile is refused with file, line, key, what was found and what is allowed; all errors at once."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from retarget.errors import ConfigError
from retarget.profile import load_profile
from retarget.profile_checks import is_convex
from retarget.profile_parts import Foot

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
        "limit beyond the servo's travel; found -2.96706 rad, which is tick -1734",
    ),
    "too fast": (
        ("max_velocity: 4.5", "max_velocity: 9"),
        "max_velocity: faster than the servo; found 9.0 rad/s; allowed: at most 4.82",
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
        "a shape needs exactly one of",
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
    "no body": (("body: body.xml", "body: nobody.xml"), "body: the body cannot be used"),
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


def test_one_fault_is_told_once(changed: Change) -> None:
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
