"""From the witness of a simulation to the numbers, the words and the picture of a run."""

from dataclasses import replace

import numpy as np
import pytest

from physics_rig import PhysicsRig, op3
from retarget.cli.physics_lines import physics_facts
from retarget.metrics.measure import measure
from retarget.metrics.physics import PhysicsReport, physics_report
from retarget.physics_run import PhysicsRun
from retarget.pipeline import Pipeline
from retarget.plots.pressure import plot_pressure
from retarget.run_result import RunResult
from rig import Rig, StubReconstructor, person, result, short_clip
from sim.physics.mount import Mount, Support
from sim.physics.outcome import physics_run
from sim.physics.perturbation import Perturbation, Push
from support.messages import shows


@pytest.fixture(scope="module")
def bare() -> RunResult:
    rig, human, clip = Rig(np.zeros((51, 20))), person(), short_clip()
    ending = Pipeline(clip=clip, reconstructor=StubReconstructor(human), robot=rig.side).run()
    return result(ending, clip, human, rig.robot)


@pytest.fixture(scope="module")
def pushed() -> PhysicsRun:
    push = Push((12.0, 0.0, 0.0), 1.2, 0.2)
    rig = PhysicsRig(perturbation=Perturbation(pushes=(push,)))
    rig.arm()
    rig.run(2.2)
    rig.bus.close()
    return physics_run(rig.bus.witness, begun=-0.5, seed=7, trouble=("push",))


def test_times_are_those_of_the_run(pushed: PhysicsRun) -> None:
    assert pushed.time[0] == -0.5 and len(pushed.time) == len(pushed.margin) == len(pushed.pressure)
    assert pushed.fall is not None and 0.7 < pushed.fall.time < 1.8  # the push came 0.7 s into the run
    shows(pushed.fall.how)


def test_the_report_has_what_the_simulation_saw(bare: RunResult, pushed: PhysicsRun) -> None:
    report = measure(replace(bare, physics=pushed))
    assert report.fallen is True and report.physics is not None
    physics = report.physics
    assert physics.fallen and physics.fallen_at_s == pushed.fall.time and physics.how == pushed.fall.how  # type: ignore[union-attr]
    assert (physics.mount, physics.seed, physics.trouble) == ("floor", 7, ("push",))
    assert set(physics.foot_slip_mm) == {*op3().profile.feet, "total"}
    feet = sum(slip for foot, slip in physics.foot_slip_mm.items() if foot != "total")
    assert physics.foot_slip_mm["total"] == pytest.approx(feet)
    assert set(physics.torque_nm) == set(physics.temperature_c) == set(op3().joint_map.joints)
    knee = physics.torque_nm["l_knee"]
    assert 0.0 < knee.p95 <= knee.max == np.abs(pushed.torque).max(axis=0)[op3().joint_map.joints.index("l_knee")]
    before = pushed.time <= pushed.fall.time  # type: ignore[union-attr]
    assert physics.min_zmp_margin_mm == pytest.approx(1e3 * np.nanmin(pushed.margin[before]))
    assert physics.sole_tilt_max_deg > 5.0 and (physics.realtime_factor or 0.0) > 0.0
    shows(physics.heat_model)


def test_without_physics_nothing_is_known(bare: RunResult) -> None:
    report = measure(bare)
    assert report.fallen is None and report.physics is None
    assert list(physics_facts(report.physics)) == [] and plot_pressure(bare) is None


def facts(bare: RunResult, physics: PhysicsRun) -> tuple[PhysicsReport, dict[str, str]]:
    report = physics_report(replace(bare, physics=physics))
    assert report is not None
    return report, {question: answer for question, answer in physics_facts(report) if answer}


def test_a_person_reads_when_and_how_it_fell(bare: RunResult, pushed: PhysicsRun) -> None:
    report, lines = facts(bare, pushed)
    assert lines["physics"].startswith(f"fallen at {report.fallen_at_s:.2f} s: {report.how}")
    shows(lines["physics"], 7)
    shows(lines["heat"])
    shows(lines["torque"])
    shows(lines["speed"])
    shows(lines)


def test_what_is_bolted_down_has_no_pressure(bare: RunResult) -> None:
    rig = PhysicsRig(mount=Mount(Support.STAND))
    rig.arm()
    rig.run(0.1)
    bolted = physics_run(rig.bus.witness)
    report, lines = facts(bare, bolted)
    assert not report.fallen and report.min_zmp_margin_mm is None and "pressure" not in lines
    assert lines["physics"] == "on a stand"
    assert plot_pressure(replace(bare, physics=bolted)) is None


def test_a_run_that_never_had_torque_is_told_too(bare: RunResult) -> None:
    rig = PhysicsRig()
    rig.bus.close()
    report, lines = facts(bare, physics_run(rig.bus.witness))
    assert report.torque_nm == {} and "heat" not in lines and lines["physics"] == "did not fall"


def test_the_picture_shows_the_fall(bare: RunResult, pushed: PhysicsRun) -> None:
    figure = plot_pressure(replace(bare, physics=pushed))
    assert figure is not None
    above, time = figure.axes
    assert any("fallen" in text.get_text() for text in time.texts)
    path = next(line for line in above.lines if line.get_label() == "centre of mass")
    assert np.abs(np.asarray(path.get_xdata())).max() < 100.0  # until the fall, not after it


def test_a_margin_of_nothing_has_no_sign(bare: RunResult, pushed: PhysicsRun) -> None:
    lines = dict(physics_facts(physics_report(replace(bare, physics=replace(pushed, margin=pushed.margin * -1e-9)))))
    shows(lines["pressure"], "0.0")
