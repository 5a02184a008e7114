"""The checker of the wire finds what it is there for: every kind of violation is planted once."""

from hardware.dynamixel.protocol2 import sync_read, sync_write
from hardware.servo import ServoSpec, find_model
from sim.faults.wire_checker import Sent, goal_writes, violations

DT = 0.01
SERVO = ServoSpec("knee", 7, find_model("XM430-W350"), "main", -1, 2048, -1.0, 1.0, 4.0, 40.0, gear=2.0)


def goals(angles: list[float], *, dt: float = DT, start: float = 5.0) -> list[Sent]:
    """Goals of the joint, rad, one every dt s."""
    sent = []
    for k, angle in enumerate(angles):
        tick = round(SERVO.zero_tick + SERVO.ticks_per_rad * angle)
        data = sync_read(126, 10, [7], fast=True) + sync_write(116, 4, [(7, tick.to_bytes(4, "little", signed=True))])
        sent.append(Sent(start + k * dt, data))
    return sent


def gentle(last: float = 0.9) -> list[float]:
    """From rest, within all limits."""
    angles, speed = [0.0], 0.0
    while angles[-1] < last:
        speed = min(speed + 35.0 * DT, 3.5)
        angles.append(angles[-1] + speed * DT)
    return angles


def test_goals_are_read_from_the_bytes() -> None:
    writes = goal_writes(goals([0.0, 0.5]))
    assert [time for time, _ in writes] == [5.0, 5.01]
    assert writes[1][1] == {7: round(2048 - 2 * 0.5 / find_model("XM430-W350").tick_rad)}


def test_what_is_within_limits_is_good() -> None:
    assert violations(goals(gentle()), [SERVO], DT, latched=None) == []


def test_goals_sent_twice_are_one() -> None:
    twice = [again for one in goals(gentle()) for again in (one, Sent(one.time + 1e-4, one.data))]
    assert violations(twice, [SERVO], DT, latched=None) == []
    assert violations([*twice, *goals([0.0], start=twice[-1].time + DT)], [SERVO], DT, latched=None) != []


def test_every_violation_is_found() -> None:
    def found(sent: list[Sent], latched: float | None = None) -> str:
        return " ".join(violations(sent, [SERVO], DT, latched=latched))

    assert "beyond its limits" in found(goals(gentle(1.2)))
    assert "too fast" in found(goals([0.0, 0.1, 0.2, 0.3]))
    assert "too hard" in found(goals([0.0, 0.0, 0.02, 0.0, 0.02, 0.0]))
    assert "after the latch" in found(goals([0.0, 0.0, 0.0]), latched=5.005)
    assert found(goals([0.0, 0.0]) + goals([0.5, 0.5], start=9.0)) == ""  # torque was off in between
