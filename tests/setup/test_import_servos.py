"""Servos guessed from what a body file says of torque and speed."""

import math

import pytest

from hardware.servo import SERVO_MODELS, ServoMode, ServoSpec
from messages import shows
from retarget.model.body_file import compile_body, compile_body_text
from retarget.model.robot import load_profile
from retarget.setup.limbs import find_anatomy
from retarget.setup.servo_guess import UNKNOWN, ServoDraft, guess_servos
from unknown_robots import ARM, SHIPPED, shipped_anatomy, shipped_body, shipped_tree, text_tree, urdf


def guessed(text: str, speeds: dict[str, float] | None = None) -> tuple[ServoDraft, ...]:
    tree = text_tree(text)
    return guess_servos(compile_body_text(text, source="test").model, tree, find_anatomy(tree), speeds or {})


def arm(effort: float, *, limits: str = "") -> str:
    return urdf(ARM, base="base", size=(0.1, 0.1, 0.06), effort=effort).replace('lower="-2.5" upper="2.5"', limits)


@pytest.mark.parametrize("robot", SHIPPED)
def test_every_draft_can_be_driven(robot: str) -> None:
    model = compile_body(shipped_body(robot)).model
    drafts = guess_servos(model, shipped_tree(robot), shipped_anatomy(robot), {})
    assert [draft.entry.id for draft in drafts] == list(range(1, len(drafts) + 1))
    for draft in drafts:
        model = SERVO_MODELS[draft.entry.model]
        spec = ServoSpec(
            joint=draft.joint,
            id=draft.entry.id,
            model=model,
            bus="main",
            direction=1,
            zero_tick=draft.entry.zero_tick,
            lower=draft.entry.limits[0],
            upper=draft.entry.limits[1],
            max_velocity=draft.entry.max_velocity,
            max_acceleration=draft.entry.max_acceleration,
            mode=ServoMode.POSITION,
        )
        assert spec.problems() == () and draft.entry.max_velocity < model.no_load_speed


def test_models_by_torque() -> None:
    """OP3's and Poppy's bodies state the stall torques of their servos, so the models are the real ones."""
    for robot, exceptions in (("op3", 0), ("poppy", 2)):  # Poppy's two AX-12A speak another protocol
        profile = load_profile(robot)
        model = compile_body(shipped_body(robot)).model
        drafts = guess_servos(model, shipped_tree(robot), shipped_anatomy(robot), {})
        wrong = [draft for draft in drafts if draft.entry.model != profile.servos[draft.joint].model]
        assert len(wrong) == exceptions


@pytest.mark.parametrize("name", [name for name, entry in SERVO_MODELS.items() if 2 in entry.protocols])
def test_torque_and_speed_identify_a_model(name: str) -> None:
    entry = SERVO_MODELS[name]
    drafts = guessed(arm(entry.stall_torque), {f"j_{part.name}": entry.no_load_speed for part in ARM})
    found = {SERVO_MODELS[draft.entry.model] for draft in drafts}
    assert all(one.stall_torque == entry.stall_torque and one.voltage == entry.voltage for one in found)


def test_no_torque_and_a_torque_that_no_servo_has() -> None:
    nothing = guessed(arm(0.0))
    assert {draft.entry.model for draft in nothing} == {UNKNOWN} and nothing[0].why == "the body states no torque"
    strong = guessed(arm(200.0))
    assert strong[0].entry.model == "XH540-W270" and strong[0].why.startswith("no known model has 200 N m")


def test_limits_are_drawn_into_the_servo() -> None:
    (wide, *_) = guessed(arm(2.5, limits='lower="-4" upper="4"'))
    assert -math.pi < wide.entry.limits[0] < -3.13 < 3.13 < wide.entry.limits[1] < math.pi
    shows(wide.note)
    (endless, *_) = guessed(arm(2.5).replace('type="revolute"', 'type="continuous"'))
    assert endless.entry.limits == wide.entry.limits
    shows(endless.note)
    (narrow, *_) = guessed(arm(2.5, limits='lower="-0.1234567" upper="0.1234567"'))
    assert narrow.entry.limits == (-0.123456, 0.123456) and not narrow.note


def test_a_stated_speed_is_kept() -> None:
    assert guessed(arm(2.5), {"j_turn": 1.25})[0].entry.max_velocity == 1.25


def test_gains_are_the_makers_defaults() -> None:
    """e-Manual, register 84: 800, of the MX series 850, of the XL430-W250 640."""
    gains = {draft.entry.model: draft.entry.gains.p for torque in (4.1, 2.5, 1.5) for draft in guessed(arm(torque))}
    assert gains == {"XM430-W350": 800, "MX-28": 850, "XL430-W250": 640}
