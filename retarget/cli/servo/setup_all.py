"""`retarget servo setup --all`: set up the servos of a robot one after the other, each connected alone."""

from dataclasses import dataclass, field, replace

from hardware.dynamixel import opencr
from hardware.dynamixel.found_servos import answers_pings_only, is_powered, switch_power_on
from hardware.dynamixel.line_scan import PROTOCOLS, Sighting, Speed, likely_speeds
from hardware.dynamixel.settings import SetupRequest, differing, read_image, settings_of
from hardware.dynamixel.single_requests import OneOff
from hardware.errors import BusError
from retarget.cli.application import answered, confirmed
from retarget.cli.exit import echo
from retarget.cli.servo.find_port import TERMINAL
from retarget.cli.servo.places import (
    Only,
    ServoPort,
    ServoTarget,
    Where,
    all_targets,
    chosen_speeds,
    opened,
    quick_search,
)
from retarget.cli.servo.write_settings import completed_request, set_up
from retarget.errors import suggest

WHERE = "servo setup --all"
DOUBLE = "2X"
"""Prefix of models with two servos in one case, which cannot be connected alone."""


def set_up_all(where: Where, request: SetupRequest, *, yes: bool, dry_run: bool) -> None:
    """Walk through all servos; see `setup`. request: settings of each beside those of its profile."""
    walk = SetupWalk(all_targets(where, yes=yes), request, yes=yes, dry_run=dry_run)
    echo(
        f"{len(walk.targets)} servos, one after the other, each alone on the line: switch the power off, connect it, "
        "switch the power on, press ENTER. It gets id, speed and the settings of the profile at once; nothing moves.\n"
        "s and ENTER: later. A joint's name and ENTER: go on with that one. Ctrl-C ends it; the same command goes on."
    )
    if walk.targets[0].place.connect is not None:
        echo("These servos are emulated and new: the emulator connects each at ENTER, and nothing is kept.")
    try:
        walk.go()
    finally:
        walk.conclude(where)


@dataclass
class SetupWalk:
    """Set-up of the servos of a robot, in its order. ready: joints whose servos are set up."""

    targets: list[ServoTarget]
    request: SetupRequest
    yes: bool
    dry_run: bool
    ready: set[str] = field(default_factory=set)
    _powers: bool = False  # whether the operator agreed to switch the servos' power on

    def go(self) -> None:
        """Ask for each servo until the last one. Raises UsageError when the input ends."""
        joints = [_joint(target) for target in self.targets]
        index = 0
        while index < len(joints):
            target, joint = self.targets[index], joints[index]
            if joint in self.ready:
                index += 1
                continue
            assert target.servo is not None
            place = f"[{index + 1}/{len(joints)}] {joint}"
            question = f"{place}: connect its {target.servo.model.name} alone, press ENTER: "
            word = answered(question, where=WHERE, step=TERMINAL)
            if word in joints:
                self.ready.discard(word)
                index = joints.index(word)
            elif word == "s":
                index += 1
            elif word:
                echo(f"{word[:80]!r} is no joint. {suggest(word, joints) or 'Joints: ' + ', '.join(joints)}")
            else:
                index += self._done(target)

    def conclude(self, where: Where) -> None:
        """Print which servos are set up, and the next step."""
        left = [_joint(target) for target in self.targets if _joint(target) not in self.ready]
        count = len(self.targets)
        if not left:
            port = "" if where.port is None else f" --port {where.port}"
            echo(f"all {count} servos are set up: connect all, then `retarget servo scan --robot {where.robot}{port}`")
        else:
            echo(f"set up: {count - len(left)} of {count}; left: {', '.join(left)}")

    def _done(self, target: ServoTarget) -> bool:
        """Set up the servo that answers. False if it is not set up; the reason is printed."""
        joint = _joint(target)
        if target.place.connect is not None:
            target.place.connect(joint)
        try:
            with opened([target.place]):
                seen = self._alone(target)
                if seen is None:
                    return False
                if not set_up(
                    replace(target, device=seen.found.id), self.request, seen, yes=True, dry_run=self.dry_run
                ):
                    return self.dry_run
        except BusError as error:
            echo(f"not set up: {error}")
            return False
        assert target.servo is not None
        self.ready.add(joint)
        echo(f"{joint} is set up: write {target.servo.id} on it")
        return True

    def _alone(self, target: ServoTarget) -> Sighting | None:
        """The only servo on the line that is not set up, or None if the operator rejects it. Raises BusError for none
        or several."""
        joint, place = _joint(target), target.place
        found = [(one, self._owner(place, one)) for one in self._look(place)]
        new = [one for one, owner in found if owner in (None, joint)]
        others = sorted({owner for _, owner in found if owner not in (None, joint)})
        for owner in others:
            if owner not in self.ready:
                echo(f"{owner} is set up already")
                self.ready.add(owner)
        step = f"Connect that of {joint} alone"
        if any(one.found.clash for one, _ in found):
            raise BusError("several servos with one id answer", where=place.where, then=step)
        if len(new) == 1:
            return new[0]
        if len(new) == 2 and all(one.model.startswith(DOUBLE) for one in new):  # one case
            ids = {str(one.found.id): one for one in new}
            word = answered(f"ids {' and '.join(ids)} answer, of one case: which is {joint}? ", where=WHERE)
            return ids.get(word)
        if new:
            text = ", ".join(f"id {one.found.id} ({one.model}, {one.speed})" for one in new)
            raise BusError(f"{len(new)} servos answer", where=place.where, found=text, allowed="one", then=step)
        if not found:
            then = "Check its power, its cable and the adapter"
            raise BusError("no servo answers at the usual speeds", where=place.where, then=then)
        if len(found) == 1 and not self.yes:
            question = f"This is {others[0]} (id {found[0][0].found.id}), set up already. Make it {joint}?"
            if confirmed(question, enter=False, where=WHERE):
                self.ready.discard(others[0])
                return found[0][0]
        text = ", ".join(others)
        raise BusError("only servos that are set up already answer", where=place.where, found=text, then=step)

    def _look(self, place: ServoPort) -> list[Sighting]:
        assert place.spec is not None
        own = place.spec.protocol
        for protocol in (own, *(one for one in PROTOCOLS if one != own)):
            seen = self._answering(place, protocol)
            if protocol == own and self._power(place, seen):
                seen = self._answering(place, protocol)
            servos = [one for one in seen if one.found.model != opencr.NUMBER]
            if servos:
                break
        return servos

    def _answering(self, place: ServoPort, protocol: int) -> tuple[Sighting, ...]:
        speeds = likely_speeds(chosen_speeds(place, Only(protocol=protocol)))
        return quick_search(place, speeds, lambda seen: None).sightings

    def _power(self, place: ServoPort, seen: tuple[Sighting, ...]) -> bool:
        """Switch the servos' power on if a device on the line has it off. True if that was done."""
        switch = None if place.spec is None else place.spec.power
        device = next((one for one in seen if switch is not None and one.found.id == switch.id), None)
        if switch is None or device is None:
            return False
        place.port.set_baud(device.speed.baud)
        client = OneOff(place.port, device.speed.protocol)
        if is_powered(client, switch):
            return False
        question = f"device {switch.id} has the servos' power switched off. Switch it on, now and for each servo?"
        self._powers = self._powers or self.yes or confirmed(question, where=WHERE)
        if self._powers:
            switch_power_on(place.port, client, switch)
        return self._powers

    def _owner(self, place: ServoPort, seen: Sighting) -> str | None:
        """The joint whose id, speed and settings a servo has, or None."""
        spec, found = place.spec, seen.found
        target = next((one for one in self.targets if one.place is place and one.device == found.id), None)
        if target is None or target.servo is None or spec is None or found.clash or seen.table is None:
            return None
        if seen.speed != Speed(spec.protocol, spec.baud) or seen.model != target.servo.model.name:
            return None
        place.port.set_baud(seen.speed.baud)
        client = OneOff(place.port, seen.speed.protocol)
        if answers_pings_only(client, found.id):
            return None
        image = read_image(client, found.id, seen.table)
        completed = settings_of(image.table, completed_request(target, self.request, seen, image))
        return None if differing(completed, image) else target.servo.joint


def _joint(target: ServoTarget) -> str:
    assert target.servo is not None
    return target.servo.joint
