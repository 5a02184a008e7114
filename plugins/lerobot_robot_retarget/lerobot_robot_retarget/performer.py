"""The teleoperator `retarget_performer`: `retarget.lerobot.performer.PerformerDevice` as LeRobot calls it."""

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from typing import Any

from lerobot.teleoperators import Teleoperator
from lerobot.utils.decorators import check_if_not_connected

from hardware.clock import MonotonicClock
from lerobot_robot_retarget.config_performer import RetargetPerformerConfig
from lerobot_robot_retarget.device import RetargetDevice
from retarget.cli.application import FileOptions
from retarget.cli.controls import Control, Oversight, Pedal, open_dead_man
from retarget.cli.exit import StopRequest
from retarget.cli.operator import RunLines, RunOperator
from retarget.cli.run import StreamOptions
from retarget.cli.web.control import PAGE, PageControl, opened_web
from retarget.errors import UsageError
from retarget.human.samples import Performance, Playback
from retarget.lerobot.performer import PerformerDevice, PerformerWiring
from retarget.live.address import StreamAddress, is_address, parse_address
from retarget.live.begin import LiveOptions, begin_live, live_rate_hz
from retarget.live.open_stream import open_stream
from retarget.model.robot import RobotBody
from retarget.run.options import RunOptions
from retarget.run.prepare import Perform, Prepared, performance_of
from retarget.schema.performer import Performer
from retarget.web.feed import ViewFeed
from retarget.web.link import PoseReceiver


class PerformerSource:
    """The source of a performer, and what may hold the robot beside it."""

    def __init__(self, config: RetargetPerformerConfig) -> None:
        """Raises UsageError for options that do not go together."""
        self.config, self.stack, self.notify = config, ExitStack(), RunLines(moving=True).notify
        self.playback = Playback(speed=config.speed, loop=config.loop, mirror=config.mirror)
        self.address: StreamAddress | None = None
        self.begins: LiveOptions | None = None
        self._feed: ViewFeed | None = None
        self._receiver: PoseReceiver | None = None
        self._controls = list[Control]()
        if is_address(config.source):
            oversight = Oversight(dead_man=config.dead_man)
            live = StreamOptions(
                countdown=config.countdown,
                person=config.person,
                check_sides=config.check_sides,
                listen=config.listen,
                oversight=oversight,
            )
            live.refuse_pages(config.source, None)
            self.begins = live.begins(config.source, self.playback, config.stature)
            self.address = parse_address(config.source)
        elif config.dead_man is not None:
            raise UsageError("only a live stream has this", where="dead_man", next_step="Leave it out")

    def perform(self, look: Callable[[], None]) -> Perform:
        """The performance. look: raises KeyboardInterrupt once nobody waits for it."""
        if self.address is None or self.begins is None:
            read = partial(FileOptions(stature=self.config.stature).open, self.config.source)
            return performance_of(read, self.playback)
        return partial(self._live, self.address, self.begins, look)

    def _live(
        self,
        address: StreamAddress,
        begins: LiveOptions,
        look: Callable[[], None],
        performer: Performer,
        robot: RobotBody | None,
    ) -> Performance:
        looks = [look]
        if address.kind == "web":
            config, dead_man = self.config, self.config.dead_man == PAGE
            web = opened_web(address, config.profile, listen=config.listen, dead_man=dead_man, notify=self.notify)
            self._feed, self._receiver = self.stack.enter_context(web)
            control = PageControl(self._feed, self.notify)
            self._controls.append(control)
            looks.append(control.look)
        elif self.config.dead_man is not None:
            pedal = open_dead_man(self.config.dead_man, terminal=False)
            assert isinstance(pedal, Pedal), "a key needs a terminal"
            self.stack.callback(pedal.close)
            self._controls.append(pedal)
        stream = open_stream(address, performer, receiver=self._receiver, smoothing=begins.smoothing)
        self.stack.callback(stream.receiver.close)
        return begin_live(
            stream,
            begins,
            clock=MonotonicClock(),
            rate_hz=live_rate_hz(robot),
            where=address.text,
            notify=self.notify,
            look=lambda: [one() for one in looks],
            has_deadlines=False,
        )

    def operator(self, prepared: Prepared) -> RunOperator:
        """Who may hold the performer."""
        dead_man = self.config.dead_man is not None
        return RunOperator(
            prepared, StopRequest(), page=self._feed, controls=self._controls, dead_man=dead_man, notify=self.notify
        )

    def close(self) -> None:
        """Close what was opened."""
        self.stack.close()
        self._feed, self._receiver = None, None
        self._controls.clear()


class RetargetPerformer(RetargetDevice, Teleoperator):
    """A performer, recorded or live, retargeted to a robot. Actions are radians."""

    config_class = RetargetPerformerConfig
    name = "retarget_performer"

    def __init__(self, config: RetargetPerformerConfig) -> None:
        super().__init__(config)
        self.config = config
        source = PerformerSource(config)
        usual = "web" if config.source.startswith("web:") else None
        # The priorities of a robot with mass, as for real servos.
        options = RunOptions(
            robot=config.profile,
            bus="profile",
            performer=config.performer or usual,
            scene=config.scene,
            playback=source.playback,
        )
        wiring = PerformerWiring(
            perform=source.perform, operator=source.operator, close=source.close, notify=source.notify
        )
        self._device: PerformerDevice = PerformerDevice(
            options, wiring, delay_s=0.0 if source.address else config.delay_s
        )

    @property
    def feedback_features(self) -> dict[str, type]:
        """None: a performer feels nothing."""
        return {}

    @check_if_not_connected
    def get_action(self) -> dict[str, Any]:
        """The newest goals."""
        return dict(self._device.action())

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing."""
