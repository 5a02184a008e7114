"""What the report says of the simulated mechanics of a run."""

from dataclasses import dataclass

import numpy as np

from retarget.run_result import RunResult

__all__ = ["HEAT_MODEL", "PhysicsReport", "TorqueSpread", "physics_report"]

HEAT_MODEL = "stated, calibrated on no hardware"
MM = 1e3


@dataclass(frozen=True)
class TorqueSpread:
    """Size of a servo's torque over a run, N m."""

    p95: float
    max: float


@dataclass(frozen=True)
class PhysicsReport:
    """A run of a robot with mass.

    fallen_at_s: on the run's time; how: in words. toppled: what a parked robot did without torque, if it did not stay
    sitting. min_zmp_margin_mm: least distance of the centre of pressure from the edge of the soles that carried.
    foot_slip_mm: way of each sole while it carried, and `total`. sole_tilt_max_deg: of a sole that carried.
    torque_nm, temperature_c (hottest): per servo. self_contacts, fixture_contacts: ticks with any.
    realtime_factor: time of the clip by the wall time that it took; null: nothing was followed.
    """

    mount: str
    seed: int
    trouble: tuple[str, ...]
    fallen: bool
    fallen_at_s: float | None
    how: str | None
    toppled: str | None
    min_zmp_margin_mm: float | None
    foot_slip_mm: dict[str, float]
    sole_tilt_max_deg: float
    torque_nm: dict[str, TorqueSpread]
    temperature_c: dict[str, float]
    heat_model: str
    self_contacts: int
    fixture_contacts: int
    realtime_factor: float | None


def physics_report(run: RunResult) -> PhysicsReport | None:
    """Of a run; None where nothing has mass."""
    physics, robot = run.physics, run.robot
    if physics is None or robot is None:
        return None
    fall, margin = physics.fall, physics.least_margin
    slip = dict(zip(robot.profile.feet, (MM * physics.slip).tolist(), strict=True))
    size = np.abs(physics.torque)
    if len(size):
        spreads = zip(np.percentile(size, 95, axis=0).tolist(), size.max(axis=0).tolist(), strict=True)
        torque = {joint: TorqueSpread(*spread) for joint, spread in zip(robot.joint_map.joints, spreads, strict=True)}
    else:
        torque = {}
    return PhysicsReport(
        mount=physics.mount,
        seed=physics.seed,
        trouble=physics.trouble,
        fallen=fall is not None,
        fallen_at_s=None if fall is None else fall.time,
        how=None if fall is None else fall.how,
        toppled=None if physics.toppled is None else physics.toppled.how,
        min_zmp_margin_mm=None if margin is None else MM * margin,
        foot_slip_mm=slip | {"total": MM * float(physics.slip.sum())},
        sole_tilt_max_deg=float(np.degrees(physics.tilt)),
        torque_nm=torque,
        temperature_c=dict(zip(robot.joint_map.joints, physics.hottest.tolist(), strict=True)),
        heat_model=HEAT_MODEL,
        self_contacts=physics.self_contacts,
        fixture_contacts=physics.fixture_contacts,
        realtime_factor=run.ticks_followed * run.clip.dt / max(run.wall_s, 1e-9) or None,
    )
