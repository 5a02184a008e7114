"""`retarget servo stiffness` as a user meets it, on simulated servos: the stiffness that they have is what is found,
and nothing but the guard moves them, by goals that the gate has passed."""

import io
import re
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from command_line import code_of, copy_of_op3
from hardware.bus import ServoGoals
from hardware.guard import CheckedGoal, Guard
from hardware.guard_state import Stop, StopCause
from messages import shows
from retarget.cli.exit import DONE, REFUSED, STOPPED
from retarget.safety.gate import Gate
from retarget.schema.catalogue import shipped_folder, user_folder
from sim.physics.bus import PhysicsBus

run = partial(code_of, "servo", "stiffness", "--robot")
FOUND = re.compile(r"stiffness: ([\d.]+) N m/rad \(([\d.]+) to ([\d.]+)\)")


class Audit:
    """Notes goals that gates make, and where goals and torque that reach the bus come from."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[CheckedGoal] = []
        self.written, self.armed, self.unchecked = 0, 0, 0
        make, send, arm, write, torque = Gate._made, Guard._send, Guard.arm, PhysicsBus.write, PhysicsBus.torque
        self._now: CheckedGoal | None = None
        self._arming = False

        def made(gate: Gate, *args: Any, **more: Any) -> CheckedGoal:
            self.made.append(make(gate, *args, **more))
            return self.made[-1]

        def sent(guard: Guard, goal: CheckedGoal) -> None:
            self._now = goal
            send(guard, goal)
            self._now = None

        def arms(guard: Guard, goal: CheckedGoal) -> None:
            self._arming = True
            arm(guard, goal)
            self._arming = False

        def wrote(bus: PhysicsBus, goals: ServoGoals) -> None:
            goal, joints = self._now, bus.simulation.world.robot.joint_map
            self.written += 1
            self.unchecked += (
                goal is None
                or not any(goal is one for one in self.made[-2:])
                or not np.array_equal(joints.to_ticks(goal.joints), goals.ticks)
            )
            write(bus, goals)

        def switched(bus: PhysicsBus, on: bool) -> None:
            self.armed += on
            self.unchecked += on and not self._arming
            torque(bus, on)

        for owner, name, spy in (
            (Gate, "_made", made),
            (Guard, "_send", sent),
            (Guard, "arm", arms),
            (PhysicsBus, "write", wrote),
            (PhysicsBus, "torque", switched),
        ):
            monkeypatch.setattr(owner, name, spy)


@pytest.mark.long
def test_half_as_stiff_is_found_and_no_goal_is_unchecked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    profile = copy_of_op3(tmp_path / "op3")
    text = profile.read_text(encoding="utf-8")
    own = "stiffness:\n  XM430-W350: {nominal: 9.4, range: [5.3, 21.1]}\nservos:\n"
    profile.write_text(text.replace("servos:\n", own, 1), encoding="utf-8")
    audit = Audit(monkeypatch)
    assert run(profile, "--joint", "l_hip_pitch", "--bus", "physics") == DONE
    out = capsys.readouterr().out
    found = FOUND.search(out)
    assert found is not None
    value, lowest, highest = map(float, found.groups())
    assert lowest <= 9.4 <= highest and value == pytest.approx(9.4, rel=0.04)
    assert audit.written > 3000 and audit.armed == 1 and audit.unchecked == 0
    shows(out.replace(str(profile), "PROFILE"), varies=re.compile(r"\d+\.\d+|(?<=nominal: )\d+"))


WEIGHT = ("--weight", "0.5", "--at", "l_sole")


@pytest.mark.long
def test_a_weight_on_an_emulated_servo(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("op3", "--joint", "l_knee", "--bus", "emulator", *WEIGHT) == DONE
    out = capsys.readouterr().out
    found = FOUND.search(out)
    assert found is not None and float(found.group(1)) == pytest.approx(18.9, rel=0.03)
    (into,) = [line for line in out.splitlines() if line.startswith("into ")]
    shows(into, "copy of", str(shipped_folder() / "robots" / "op3"), str(user_folder() / "robots"))


def test_what_is_refused_before_anything_moves(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))  # ENTER alone is no: a port that is not there is not opened
    assert run("op3", "--joint", "l_knee", "--bus", "/dev/no-such-port", *WEIGHT) == DONE
    shows(capsys.readouterr().out)
    assert run("op3", "--joint", "l_knee", "--bus", "physics", *WEIGHT, "--dry-run") == DONE
    shows(capsys.readouterr().out)
    for words in (
        ("--bus", "mock"),
        ("--weight", "0.5"),
        ("--weight", "50", "--at", "l_sole"),
        ("--weight", "0.5", "--at", "l_soul"),
    ):
        assert run("op3", "--joint", "l_knee", *words) == REFUSED
        shows(capsys.readouterr().err)


@pytest.mark.parametrize("cause", [StopCause.FOLLOWING_ERROR, StopCause.TEMPERATURE])
def test_a_servo_that_gives_way_is_to_carry_less(
    cause: StopCause, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stop = Stop(cause, "the guard stopped it")
    ended = SimpleNamespace(record=SimpleNamespace(robot=None), reason=stop.reason, stop=stop)
    monkeypatch.setattr("retarget.cli.servo.stiffness._play", lambda *_: ended)
    assert run("op3", "--joint", "l_knee", "--bus", "physics", *WEIGHT) == STOPPED
    shows(capsys.readouterr().err)
