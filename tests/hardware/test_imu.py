"""IMUs without a bus: what a sample says, which readings are refused, and the frames of a BNO08x."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardware.bno08x import FRAME_BYTES, PERIOD, RvcDecoder, RvcFrame, SerialImu, encoded, frame_of
from hardware.clock import VirtualClock
from hardware.imu import FROZEN, ImuFault, ImuKind, ImuReading, ImuSpec, ImuTracker, from_roll_pitch_yaw
from hardware.imu import STANDARD_GRAVITY as G
from retarget import rotations
from sim.bno08x import EmulatedBno08x
from sim.imu import Ailment, ImuErrors, ImuStandIn, ImuTruth, roll_pitch_yaw

HALF_TURN = ImuSpec(ImuKind.OPENCR, "body", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), bus="main", id=200)
BNO = ImuSpec(ImuKind.BNO08X, "body", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), port="/dev/imu")
PERFECT = ImuErrors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
UPRIGHT = ImuReading((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, G))
ANGLES = st.floats(-3.1, 3.1)
COUNTS = st.integers(-0x8000, 0x7FFF)


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_roll_pitch_and_yaw_are_turns_about_x_y_and_z(roll: float, pitch: float, yaw: float) -> None:
    q = from_roll_pitch_yaw(roll, pitch, yaw)
    assert rotations.angle_between(q, rotations.from_euler([yaw, pitch, roll], "zyx")) < 1e-6
    assert roll_pitch_yaw(q) == pytest.approx((roll, pitch, yaw), abs=1e-6)


def test_a_sample_is_along_the_axes_of_the_link() -> None:
    """A board that is turned by half a turn about z, on a robot that leans forward by 0.2 rad and falls on."""
    tracker = ImuTracker(HALF_TURN)
    sine, cosine = math.sin(0.2), math.cos(0.2)
    board = ImuReading(from_roll_pitch_yaw(0.0, -0.2, 0.0), (0.0, -1.5, 0.3), (G * sine, 0.0, G * cosine))
    tracker.take(board, 1.0)
    sample = tracker.sample(1.01)
    assert sample.orientation is not None and sample.valid and sample.age == pytest.approx(0.01)
    np.testing.assert_allclose(sample.angular_velocity, [0.0, 1.5, 0.3], atol=1e-12)
    np.testing.assert_allclose(sample.acceleration, [-G * sine, 0.0, G * cosine], atol=1e-12)
    assert sample.tilt == pytest.approx((0.0, 0.2), abs=1e-9)
    up = rotations.rotate(rotations.conjugate(sample.orientation), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(G * up, sample.acceleration, atol=1e-9)  # both say the same of what is up


def test_a_sample_gets_old() -> None:
    tracker = ImuTracker(BNO)
    unknown = tracker.sample(5.0)  # before the first reading
    assert (unknown.valid, unknown.age, unknown.time, unknown.orientation) == (False, math.inf, -math.inf, None)
    assert np.isnan(unknown.acceleration).all() and np.isnan(unknown.tilt).all()
    tracker.take(UPRIGHT, 0.0)
    assert tracker.sample(0.04).valid
    old = tracker.sample(0.06)
    assert (old.valid, old.age, tracker.fault) == (False, 0.06, ImuFault.SILENT)


def test_a_sensor_that_hangs_is_not_believed_and_one_that_goes_on_is() -> None:
    tracker, tick = ImuTracker(BNO), 0.008
    for k in range(round(FROZEN / tick)):
        tracker.take(UPRIGHT, k * tick)
        assert tracker.sample(k * tick).valid
    tracker.take(UPRIGHT, FROZEN)
    assert not tracker.sample(FROZEN).valid and tracker.fault is ImuFault.FROZEN
    tracker.take(ImuReading(UPRIGHT.orientation, (0.0, 0.0, 1e-9), UPRIGHT.acceleration), FROZEN + tick)
    assert tracker.sample(FROZEN + tick).valid


LYING = ImuReading(from_roll_pitch_yaw(1.5, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, G, 0.0))


@pytest.mark.parametrize(
    "reading",
    [
        None,
        replace(UPRIGHT, angular_velocity=(0.0, 36.0, 0.0)),
        replace(UPRIGHT, acceleration=(0.0, 0.0, -17.0 * G)),
        replace(UPRIGHT, angular_velocity=(0.0, 0.0, math.nan)),
        replace(UPRIGHT, orientation=(0.0, 0.0, 0.0, 0.0)),
        LYING,
    ],
    ids=["out of range", "too fast", "too strong", "no number", "no turn", "a jump"],
)
def test_an_impossible_reading_is_not_kept(reading: ImuReading | None) -> None:
    tracker = ImuTracker(BNO)
    tracker.take(UPRIGHT, 0.0)
    tracker.take(reading, 0.008)
    sample = tracker.sample(0.008)
    assert not sample.valid and tracker.fault is ImuFault.IMPOSSIBLE
    assert sample.tilt == pytest.approx((0.0, 0.0))
    tracker.take(UPRIGHT, 0.016)
    assert tracker.sample(0.016).valid
    tracker.take(LYING, 0.116)
    assert tracker.sample(0.116).valid, "a jump that lasts is believed"


# The frames of a BNO08x, by the example of its datasheet: yaw 0.01, pitch -1.10, roll 20.85 degrees.

EXAMPLE = bytes.fromhex("aaaade010092ff25088dfeecffd103000000e7")


def test_the_datasheets_frame() -> None:
    frame = frame_of(EXAMPLE)
    assert frame == RvcFrame(0xDE, (1, -110, 2085), (-371, -20, 977))
    assert encoded(frame) == EXAMPLE and len(EXAMPLE) == FRAME_BYTES == 19


@given(st.binary(max_size=100), st.lists(st.integers(1, 20), max_size=20), st.integers(0, 18), st.integers(1, 255))
def test_a_damaged_stream_never_raises_and_never_shows_a_wrong_frame(
    noise: bytes, cuts: list[int], place: int, flip: int
) -> None:
    damaged = bytearray(EXAMPLE)
    damaged[place] ^= flip
    stream = EXAMPLE + bytes(damaged) + noise + EXAMPLE * 3
    decoder, found, at = RvcDecoder(), list[RvcFrame](), 0
    for cut in [*cuts, len(stream)]:
        found += decoder.feed(stream[at : at + cut])
        at += cut
    good = frame_of(EXAMPLE)
    assert found.count(good) >= 3 and found[0] == good  # type: ignore[arg-type]
    assert frame_of(bytes(damaged)) is None
    assert decoder.damaged >= 0


@given(COUNTS, COUNTS, COUNTS, st.integers(0, 255))
def test_angles_that_there_are_not_are_damage(yaw: int, pitch: int, roll: int, number: int) -> None:
    body = struct.pack("<B6h3x", number, yaw, pitch, roll, 0, 0, 1000)
    frame = frame_of(b"\xaa\xaa" + body + bytes((sum(body) % 256,)))
    possible = abs(yaw) <= 18000 and abs(roll) <= 18000 and abs(pitch) <= 9000
    assert (frame is not None) is possible


def test_noise_for_ever_is_counted_and_not_kept() -> None:
    decoder = RvcDecoder()
    for _ in range(50):
        assert not list(decoder.feed(b"\xaa" * 500))
    assert decoder.damaged > 20_000 and len(decoder._rest) < FRAME_BYTES


def serial(sensor: ImuStandIn, clock: VirtualClock | None = None) -> tuple[SerialImu, EmulatedBno08x, VirtualClock]:
    clock = clock or VirtualClock()
    port = EmulatedBno08x(sensor, clock)
    port.open(BNO.baud)
    return SerialImu(BNO, port), port, clock


def test_a_serial_sensor_is_read_without_waiting_and_has_a_rate() -> None:
    """A body that turns to the left by 1 rad/s and leans forward."""
    clock = VirtualClock()

    def motion() -> ImuTruth:
        return ImuTruth(from_roll_pitch_yaw(0.0, 0.3, clock.now()), (0.0, 0.0, 1.0), (0.0, 0.0, G))

    imu, _, _ = serial(ImuStandIn(BNO, motion=motion, errors=PERFECT), clock)
    for _ in range(100):
        clock.advance(0.01)
        before = clock.now()
        imu.post()
        imu.collect()
        assert clock.now() == before
    sample = imu.tracker.sample(clock.now())
    assert sample.valid and sample.age <= PERIOD + 1e-9
    assert sample.tilt == pytest.approx((0.0, 0.3), abs=2e-4)
    assert sample.orientation is not None
    world = rotations.rotate(sample.orientation, sample.angular_velocity)
    np.testing.assert_allclose(world, [0.0, 0.0, 1.0], atol=0.05)
    np.testing.assert_allclose(sample.acceleration, [0.0, 0.0, G], atol=0.01)


@pytest.mark.parametrize(
    ("ailment", "faults"),
    [(Ailment.FROZEN, {ImuFault.FROZEN}), (Ailment.SPIKES, {ImuFault.IMPOSSIBLE}), (Ailment.SWAPPED, set())],
)
def test_a_serial_sensor_that_is_broken_or_silent_is_found(ailment: Ailment, faults: set[ImuFault]) -> None:
    sensor, found = ImuStandIn(BNO), set[ImuFault | None]()
    imu, _, clock = serial(sensor)
    for k in range(100):
        sensor.ailment = ailment if k > 50 else None
        clock.advance(0.008)
        imu.collect()
        assert imu.tracker.sample(clock.now()).valid == (imu.tracker.fault is None)
        found |= {imu.tracker.fault} if k > 3 else set()
    assert found == {None} | faults
    imu, port, clock = serial(ImuStandIn(BNO, errors=ImuErrors(dropouts=1.0)))
    clock.advance(0.5)
    imu.collect()
    assert not imu.tracker.sample(clock.now()).valid and imu.tracker.fault is ImuFault.SILENT and port.read() == b""


@given(st.integers(0, 1000))
def test_a_stand_in_repeats_by_its_seed(seed: int) -> None:
    first, again = (ImuStandIn(seed=seed, errors=ImuErrors(dropouts=0.3)) for _ in range(2))
    assert [first.measure(0.01 * k) for k in range(20)] == [again.measure(0.01 * k) for k in range(20)]
