"""From the witness of a simulation to the numbers, the words and the picture of a run."""

from dataclasses import replace

import numpy as np
import pytest

from messages import shows
from physics_rig import PhysicsRig, op3, standing
from retarget.ik.support_polygon import plant, support_distance
from retarget.report.findings import physics_findings
from retarget.report.measure import measure
from retarget.report.motion_metrics import PhysicsReport, physics_report
from retarget.report.plots import plot_pressure
from retarget.run.run_result import PhysicsRun, RunResult
from rig import Rig, person, result, short_clip
from sim.buses import simulation_of
from sim.physics.mount import Mount, Support
from sim.physics.perturbation import Perturbation, Push
from sim.physics.witness import Witness, physics_run, zmp_margins


@pytest.fixture(scope="module")
def bare() -> RunResult:
    rig, human, clip = Rig(np.zeros((51, 20))), person(), short_clip()
    ending = rig.loop(clip).run()
    return result(ending, clip, human, rig.robot)


@pytest.fixture(scope="module")
def pushed() -> PhysicsRun:
    push = Push((12.0, 0.0, 0.0), 1.2, 0.2)
    rig = PhysicsRig(perturbation=Perturbation(pushes=(push,)))
    rig.arm()
    rig.run(2.2)
    rig.bus.close()
    return physics_run(rig.bus.witness, begun=-0.5, seed=7, perturbations=("push",))


def test_the_report_has_what_the_simulation_saw(bare: RunResult, pushed: PhysicsRun) -> None:
    report = measure(replace(bare, physics=pushed))
    assert report.fallen is True and report.physics is not None
    physics = report.physics
    assert physics.fallen and physics.fallen_at_s == pushed.fall.time and physics.how == pushed.fall.how  # type: ignore[union-attr]
    assert (physics.mount, physics.seed, physics.perturbations) == ("floor", 7, ("push",))
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


def facts(bare: RunResult, physics: PhysicsRun) -> tuple[PhysicsReport, dict[str, str]]:
    report = physics_report(replace(bare, physics=physics))
    assert report is not None
    return report, {one.name: one.measured for one in physics_findings(report) if one.measured}


def test_a_person_reads_when_and_how_it_fell(bare: RunResult, pushed: PhysicsRun) -> None:
    report, lines = facts(bare, pushed)
    assert lines["physics"].startswith(f"fallen at {report.fallen_at_s:.2f} s: {report.how}")
    shows(lines["physics"], 7)
    shows(lines["heat"])
    shows(lines["torque"])
    shows(lines["speed"])
    shows(lines)


def test_what_is_bolted_down_has_no_pressure_and_never_falls(bare: RunResult) -> None:
    rig = PhysicsRig(mount=Mount(Support.STAND))
    rig.arm()
    rig.run(0.1)
    bolted = physics_run(rig.bus.witness)
    report, lines = facts(bare, bolted)
    assert not report.fallen and report.min_zmp_margin_mm is None and "pressure" not in lines
    assert lines["physics"] == "on a stand" and bolted.least_margin is None and bolted.slip.sum() == 0.0
    assert plot_pressure(replace(bare, physics=bolted)) is None
    rig.bus.close()
    assert rig.bus.witness.fall is None


def test_the_picture_shows_the_fall(bare: RunResult, pushed: PhysicsRun) -> None:
    figure = plot_pressure(replace(bare, physics=pushed))
    assert figure is not None
    above, time = figure.axes
    assert any("fallen" in text.get_text() for text in time.texts)
    path = next(line for line in above.lines if line.get_label() == "centre of mass")
    assert np.abs(np.asarray(path.get_xdata())).max() < 100.0  # until the fall, not after it


def test_a_standing_robot_has_the_margin_of_its_centre_of_mass() -> None:
    rig = PhysicsRig()
    rig.arm()
    rig.run(1.5)
    witness = rig.bus.witness
    summary = physics_run(witness)
    margins = zmp_margins(op3(), witness.log, least_load=1.0)
    assert np.isnan(margins[0]) and len(margins) == witness.log.rows  # the hand
    edges = plant(op3(), op3().profile.postures.stand).edges(0.0)
    assert margins[-1] == pytest.approx(float(support_distance(witness.state.com, edges)), abs=4e-3)
    assert summary.least_margin is not None and 0.02 < summary.least_margin <= margins[-1] + 1e-3
    assert summary.fall is None and summary.slip.sum() < 5e-4 and summary.tilt < 0.01
    assert np.abs(summary.torque).max(axis=0)[op3().joint_map.joints.index("l_knee")] > 0.3
    assert summary.hottest.min() >= 25.0 and summary.self_contacts == 0


def test_nothing_is_logged_before_torque() -> None:
    simulation = simulation_of(op3(), start=standing())
    witness = Witness(simulation)
    simulation.advance(1.0)
    witness.look()
    assert witness.log.rows == 0 and witness.state.time == 1.0
    simulation.switch(np.ones(20, dtype=np.bool_))
    simulation.advance(1.1)
    witness.look()
    assert witness.log.rows == 1


def test_a_robot_at_rest_that_cannot_stay_topples_and_that_is_no_fall() -> None:
    postures = op3().profile.postures.model_copy(update={"rest": op3().profile.postures.stand})
    robot = replace(op3(), profile=op3().profile.model_copy(update={"postures": postures}))
    simulation = simulation_of(robot, start=standing())
    witness = Witness(simulation)
    for on in (True, False):
        simulation.switch(np.full(20, on))
        witness.switched(on)
        simulation.advance(simulation.time + 1.0 * on)
    witness.see_it_out()
    assert witness.at_rest and witness.fall is None
    assert witness.toppled is not None and not witness.toppled.powered
