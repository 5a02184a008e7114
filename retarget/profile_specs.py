"""What the servo side needs of a profile: its servos and buses as the hardware's own data."""

from collections.abc import Mapping, Sequence

import hardware.coupling
from hardware.bus_spec import BusSpec, PowerSwitch
from hardware.servo import ServoGains, ServoMode, ServoSpec, find_model
from retarget.profile_parts import Bus, Coupling, Servo

DEFAULT_WATCHDOG = 0.1  # [s]


def servo_specs(servos: Mapping[str, Servo], couplings: Sequence[Coupling]) -> tuple[ServoSpec, ...]:
    """The servos in the profile's order. Raises HardwareError for an unknown model."""
    coupled = {
        joint: hardware.coupling.Coupling(coupling.joints, coupling.matrix)
        for coupling in couplings
        for joint in coupling.joints
    }
    return tuple(
        ServoSpec(
            joint=joint,
            id=servo.id,
            model=find_model(servo.model),
            bus=servo.bus,
            direction=servo.direction,
            zero_tick=servo.zero_tick,
            lower=servo.limits[0],
            upper=servo.limits[1],
            max_velocity=servo.max_velocity,
            max_acceleration=servo.max_acceleration,
            gear=servo.gear,
            gains=ServoGains(
                servo.gains.p, servo.gains.i, servo.gains.d, servo.gains.feedforward_1, servo.gains.feedforward_2
            ),
            current_limit=servo.current,
            mode=ServoMode(servo.mode),
            homing_offset=servo.homing_offset,
            coupling=coupled.get(joint),
        )
        for joint, servo in servos.items()
    )


def bus_specs(buses: Mapping[str, Bus]) -> tuple[BusSpec, ...]:
    """The buses in the profile's order."""
    return tuple(
        BusSpec(
            name=name,
            port=bus.port,
            baud=bus.baud,
            protocol=bus.protocol,
            ids=bus.ids,
            watchdog=_watchdog(bus),
            return_delay=bus.return_delay_us * 1e-6,
            power=None
            if bus.power is None
            else PowerSwitch(bus.power.id, bus.power.register_, bus.power.value, bus.power.wait_s),
        )
        for name, bus in buses.items()
    )


def _watchdog(bus: Bus) -> float:
    """Longest silence in s; servos of Protocol 1.0 have no watchdog."""
    if bus.watchdog_s is not None:
        return bus.watchdog_s
    return DEFAULT_WATCHDOG if bus.protocol == 2 else 0.0
