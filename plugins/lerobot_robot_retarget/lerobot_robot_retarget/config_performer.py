"""Options of the teleoperator: `--teleop.type=retarget_performer --teleop.profile=op3 --teleop.source=vmc://:39539`."""

from dataclasses import dataclass

from lerobot.teleoperators import TeleoperatorConfig


@TeleoperatorConfig.register_subclass("retarget_performer")
@dataclass(kw_only=True)
class RetargetPerformerConfig(TeleoperatorConfig):
    """profile: of the robot that is to follow. source: a motion file, `sample`, or the address of a stream, as of
    `retarget run`. performer, scene, loop, speed, mirror, stature, countdown, person, check_sides, listen, dead_man
    (pedal:DEVICE, or page): the same. delay_s: before a file begins, the robot's stance is given for so long."""

    profile: str = "op3"
    source: str = "sample"
    performer: str | None = None
    scene: str | None = None
    delay_s: float = 5.0
    loop: bool = False
    speed: float = 1.0
    mirror: bool = False
    stature: float | None = None
    countdown: float | None = None
    person: str | None = None
    check_sides: bool | None = None
    listen: bool = False
    dead_man: str | None = None
