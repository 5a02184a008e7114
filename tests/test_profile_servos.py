"""Servos, couplings and buses of a profile: what they may say, and every wrong one with its place."""

import shutil
from pathlib import Path

import pytest

from hardware.bus_spec import PowerSwitch
from hardware.joint_map import JointMap
from hardware.servo import ServoMode
from retarget.errors import ConfigError
from retarget.profile import RobotProfile, load_profile

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
WRONG = {
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
        "limit beyond the servo's travel; found 2.96706 rad, which is tick 6934; allowed: ticks 0 to 4095",
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
    "coupling of nobody": (
        (coupled("[[1, 0], [0, 1]]", "[head_pan, head_tild]"),),
        "couplings[0].joints[1]: unknown joint; found 'head_tild'",
    ),
    "coupled twice": (
        (coupled("[[1, 0], [0, 1]]", "[head_pan, head_pan]"),),
        "needs two different joints",
    ),
    "singular": ((coupled("[[1, 1], [1, 1]]"),), "couplings[0]: coupling of head_pan and head_tilt: the matrix"),
    "too far together": ((coupled("[[-0.5, 0.5], [0.5, 0.5]]"),), "need ticks -1024 to 4608 of servo 19"),
    "geared": ((head(extra=", gear: 2.0"), coupled("[[1, 0], [0, 1]]")), "head_pan.gear: a coupled servo has no gear"),
    "three in a row": ((coupled("[[1, 0, 0], [0, 1, 0]]"),), "couplings[0].matrix"),
}


@pytest.mark.parametrize("case", list(WRONG))
def test_every_wrong_entry_is_told_with_its_place(case: str, tmp_path: Path, root: Path) -> None:
    replacements, text = WRONG[case]
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
