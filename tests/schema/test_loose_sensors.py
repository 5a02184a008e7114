"""Things worn or held beside a joint: where exactly is found out while the performer stands, and holds in any pose."""

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from hardware.clock import VirtualClock
from live_rig import WHERE, live_stream
from messages import refuses
from people import at_rest
from retarget import rotations
from retarget.errors import UsageError
from retarget.frames import on_grid
from retarget.human import rest_pose
from retarget.human.performer_calibration import read_person
from retarget.human.rest_pose import MAX_LOOSE_M, fit_rest_pose
from retarget.live.begin import LiveOptions, begin_live
from retarget.live.performer import LivePerformer
from retarget.live.roles import CONVENTIONS, Roles, roles_of
from retarget.model.human_dimensions import HumanDimensions, stature_of
from retarget.schema.performer import HELD, Performer, PerformerSensor
from retarget.types import FloatArray
from sim.faults.sender import FakeSender

FIVE = (*HELD, "l_ankle", "r_ankle")
TEN = (*FIVE, "pelvis", "chest", "l_elbow", "r_elbow", "l_knee", "r_knee")
ARMS = 0.1
LENGTHS = ("l_elbow", "l_wrist", "l_knee", "l_ankle", "head")


def random_person(chance: np.random.Generator) -> HumanDimensions:
    """Of any size, each proportion off the average as people's are."""
    parameters = np.zeros(rest_pose.COUNT)
    parameters[rest_pose.STATURE] = np.log(chance.uniform(1.55, 1.95))
    parameters[rest_pose.PROPORTIONS] = chance.normal(0.0, 0.04, 7)
    offset = rest_pose.offsets(parameters)
    return HumanDimensions(offset, stature_of(offset), 60.0, "made")


def beside(chance: np.random.Generator) -> dict[str, FloatArray]:
    """A grip below and beside each wrist, a headset before the head, m."""
    found = {"head": np.array([0.1, 0.0, 0.05])}
    for name, side in (("l_wrist", 1.0), ("r_wrist", -1.0)):
        found[name] = np.array([0.0, 0.03 * side, -0.06]) + chance.normal(0.0, 0.03, 3)
    return found


def errors(names: tuple[str, ...]) -> FloatArray:
    """Mean error, m, over 8 people: of points taken for joints, before and after; of lengths, before and after."""
    chance, rows = np.random.default_rng(1), []
    for _ in range(8):
        person = random_person(chance)
        off = beside(chance)
        points = at_rest(person, ARMS)
        position = np.array([points[name] + off.get(name, chance.normal(0.0, 0.008, 3)) for name in names])
        plain, loose = fit_rest_pose(names, position), fit_rest_pose(names, position, loose=HELD)
        found = dict(zip(names, loose.offset, strict=True))
        assert not plain.offset.any() and np.linalg.norm(loose.offset, axis=1).max() <= MAX_LOOSE_M + 1e-9
        lengths = [[one.dimensions.length(name) - person.length(name) for name in LENGTHS] for one in (plain, loose)]
        rows.append(
            [
                np.mean([np.linalg.norm(off[name]) for name in HELD]),
                np.mean([np.linalg.norm(off[name] - found[name]) for name in HELD]),
                *np.abs(lengths).mean(axis=1),
            ]
        )
    return np.asarray(np.mean(rows, axis=0))


@pytest.mark.long
@pytest.mark.parametrize(("names", "share"), [(FIVE, 0.75), (TEN, 0.45)])
def test_what_is_beside_its_joint_is_found(names: tuple[str, ...], share: float) -> None:
    before, after, plain, loose = errors(names)
    assert before > 0.08 and after < share * before
    assert loose < 0.6 * plain


def test_only_what_the_performer_s_file_says_is_loose_and_turns_by_itself() -> None:
    def slime(name: str, convention: str) -> Roles:
        sensors = {name: PerformerSensor(joint=name, beside=True)}
        return roles_of(Performer(name="one", description="One.", sensors=sensors), convention, where="one")

    assert not any(place.loose for places in CONVENTIONS.values() for place in places.values())
    assert slime("head", "slimevr").loose == ("head",)
    with refuses(UsageError, "head"):
        slime("head", "slimevr_vrchat")
    # Canonical axes are those of a hanging arm; SlimeVR's hand is the identity there, Unity's in the T-pose.
    for convention, offset in (("slimevr", [0.13, 0.0, -0.05]), ("unity_bones", [0.0, 0.05, 0.0])):
        shifted = slime("l_wrist", convention).shifted(np.array([[0.0, 0.0, -0.05]]))
        np.testing.assert_allclose(shifted.places[0].offset, offset, atol=1e-12)
        assert shifted.convention == convention and shifted.loose == ("l_wrist",)


@dataclass
class Controllers(FakeSender):
    """A performer with ten sensors as JSON: a cap on the head and controllers in the hands, under names of their own.
    The left arm is straight out to the side from `raised_s` on."""

    person: HumanDimensions = field(default_factory=lambda: random_person(np.random.default_rng(4)))
    off: dict[str, FloatArray] = field(default_factory=lambda: beside(np.random.default_rng(4)))
    raised_s: float = 99.0

    def joints(self, time: float) -> dict[str, FloatArray]:
        hanging, out = at_rest(self.person, ARMS), at_rest(self.person, ARMS + 1.2)
        share = float(np.clip(time - self.raised_s, 0.0, 1.0))
        left = {name: hanging[name] + share * (out[name] - hanging[name]) for name in ("l_elbow", "l_wrist")}
        return hanging | left

    def encoded(self, time: float) -> bytes | None:
        share = float(np.clip(time - self.raised_s, 0.0, 1.0))
        points, poses = self.joints(time), {}
        for name in TEN:
            turn = rotations.from_axis_angle([1.0, 0.0, 0.0], 1.2 * share if name == "l_wrist" else 0.0)
            at = points[name] + rotations.rotate(turn, self.off.get(name, np.zeros(3)))
            at = at + self._chance.normal(0.0, 0.0005, 3)
            poses[f"my {name}"] = {"p": at.tolist(), "q": turn.tolist()}
        return json.dumps({"axes": "rep103", "quaternion": "wxyz", "time": self.stamp(time), "poses": poses}).encode()


def followed(sender: Controllers, *, until: float) -> tuple[dict[str, FloatArray], list[str]]:
    """Where sensors are taken to be at a time of the sender, from the pelvis, in our world; and what was logged."""
    logged: list[str] = []
    sensors = {name: PerformerSensor(joint=name, role=f"my {name}", beside=name in HELD) for name in TEN}
    worn = Performer(name="mine", description="Controllers.", sensors=sensors)
    clock, stream = VirtualClock(), live_stream(sender, worn)
    options = LiveOptions(countdown=0.2, person="anna")
    performance = begin_live(stream, options, clock=clock, rate_hz=100.0, where=WHERE, notify=logged.append)
    live = performance.samples
    assert isinstance(live, LivePerformer)
    sample = live.sample(0)
    assert sample is not None
    np.testing.assert_array_equal(sample.position, on_grid(sample).position)
    while clock.now() < until:
        clock.advance(0.01)
        stream.poll(clock.now(), moving=False)
        frames = stream.read(clock.now())
    if until:
        at = live.alignment.positions(frames.position)
    else:
        assert sample is not None
        at = sample.position
    return dict(zip(TEN, at - at[TEN.index("pelvis")], strict=True)), logged


def worst(sender: Controllers, at: dict[str, FloatArray], time: float) -> float:
    true = sender.joints(time)
    return max(float(np.linalg.norm(at[name] - (true[name] - true["pelvis"]))) for name in HELD)


def test_live_a_controller_is_taken_off_in_any_pose_and_kept_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    sender = Controllers(raised_s=3.0)
    off = max(float(np.linalg.norm(by)) for by in sender.off.values())
    at, logged = followed(sender, until=5.0)
    assert worst(sender, at, 5.0) < 0.55 * off
    assert any(text.startswith("beside their joints: ") for text in logged)
    kept = read_person("anna")
    assert kept is not None and set(kept.sensor_offsets["json"]) == set(HELD)
    again = Controllers()
    at, logged = followed(again, until=0.0)
    assert worst(again, at, 0.0) < 0.55 * off
    assert not any(text.startswith("beside their joints: ") for text in logged)
