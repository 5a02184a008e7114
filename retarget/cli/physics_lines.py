"""What the summary of a run says of its simulated mechanics: one row for each question."""

from collections.abc import Iterable

from retarget.metrics.physics import PhysicsReport

__all__ = ["physics_facts"]


def physics_facts(physics: PhysicsReport | None) -> Iterable[tuple[str, str]]:
    """Question and answer; an empty answer is left out, and everything where nothing has mass."""
    if physics is None:
        return
    yield "physics", _standing(physics)
    yield "when parked", "" if physics.toppled is None else f"it did not stay: {physics.toppled}"
    yield "pressure", _pressure(physics)
    yield "torque", _torque(physics)
    yield "heat", _heat(physics)
    yield "contacts", _contacts(physics)
    yield "speed", "" if physics.realtime_factor is None else f"{physics.realtime_factor:.1f} x real time"


def _standing(physics: PhysicsReport) -> str:
    differs = f" (trouble: {', '.join(physics.trouble)}; seed {physics.seed})" if physics.trouble else ""
    if physics.fallen:
        return f"fallen at {physics.fallen_at_s or 0.0:.2f} s: {physics.how}{differs}"
    return {"floor": "did not fall", "stand": "on a stand", "gantry": "hangs on a gantry"}[physics.mount] + differs


def _pressure(physics: PhysicsReport) -> str:
    margin = physics.min_zmp_margin_mm
    if margin is None:
        return ""
    return (
        f"never nearer to the edge of the soles than {margin:z.1f} mm; {physics.foot_slip_mm['total']:.1f} mm slipped, "
        f"tipped by {physics.sole_tilt_max_deg:.1f} degrees"
    )


def _torque(physics: PhysicsReport) -> str:
    torque = physics.torque_nm
    if not torque:
        return ""
    most = max(torque, key=lambda joint: torque[joint].max)
    return f"{torque[most].max:.2f} N m at most, 95 % below {torque[most].p95:.2f} ({most})"


def _heat(physics: PhysicsReport) -> str:
    known = {joint: heat for joint, heat in physics.temperature_c.items() if heat == heat}
    if not known:
        return ""
    hottest = max(known, key=lambda joint: known[joint])
    return f"{known[hottest]:.1f} degrees Celsius at most ({hottest}), by a model {physics.heat_model}"


def _contacts(physics: PhysicsReport) -> str:
    counts = {"itself": physics.self_contacts, "fixtures or the floor": physics.fixture_contacts}
    return ", ".join(f"touches {what} in {ticks} ticks" for what, ticks in counts.items() if ticks)
