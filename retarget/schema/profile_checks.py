"""Cross checks of a robot profile that need no body file.

Every check takes the valid part of a profile and its document, and returns problems with their places. Names are looked
up among the keys of the document, so that an invalid entry is not called unknown as well.
"""

from collections.abc import Iterable, Sequence
from itertools import chain
from math import pi, radians

from hardware.bus import BAUDS, WATCHDOG_STEP
from hardware.dynamixel.control_table import fastest_baud, find_table
from hardware.errors import HardwareError
from hardware.joint_map import coupling_problems
from hardware.servo import (
    HOMING_REACH,
    SERVO_MODELS,
    Layout,
    ServoModel,
    find_model,
)
from retarget.errors import Problem
from retarget.frames import JOINTS
from retarget.schema.profile import RobotProfile
from retarget.schema.profile_parts import Bus, Point2, Postures, Safety, Servo, servo_specs
from retarget.schema.strict_models import keys_of, listed, unknown_name
from retarget.schema.strict_yaml import Document, KeyPath

TOLERANCE = 1e-9  # [s] by which a watchdog may miss a multiple of its step


def check_servos(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    """Names and ids, and what model, protocol and mode cannot do."""
    yield from _duplicate_ids(document)
    buses = keys_of(document, "buses")
    for joint, servo in profile.servos.items():
        here: KeyPath = ("servos", joint)
        bus, model = profile.buses.get(servo.bus), _model(servo)
        if servo.bus not in buses:
            yield unknown_name(document, (*here, "bus"), "bus", servo.bus, buses)
        elif bus is not None and servo.id not in bus.ids:
            found = f"{servo.id}, which is not among the ids of bus {servo.bus!r}"
            yield document.problem((*here, "id"), "servo id not on its bus", found=found)
        if model is None:
            yield unknown_name(document, (*here, "model"), "servo model", servo.model, SERVO_MODELS)
            continue
        unfit = list(_mode(here, servo, model, document))
        yield from unfit
        if bus is not None:
            yield from _protocol(here, servo, model, bus, document)
        if not unfit:
            (spec,) = servo_specs({joint: servo}, profile.couplings)
            (low, high), step = servo.limits, "Check limits, zero_tick, direction, gear and mode"
            if servo.mode == "position" and high - low > 2.0 * pi:  # as limits in degrees are
                step = f"Limits are in rad: {low:g} to {high:g} degrees are [{radians(low):.5g}, {radians(high):.5g}]"
            for text in spec.problems():
                yield document.problem(here, text.removeprefix(f"{joint}: "), next_step=step)


def check_stiffness(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    """Models of the robot, a nominal value within its range, and one P gain that it is for."""
    for name, entry in profile.stiffness.items():
        here: KeyPath = ("stiffness", name)
        gains = {servo.gains.p for servo in profile.servos.values() if servo.model == name}
        if not gains:
            models = tuple(dict.fromkeys(servo.model for servo in profile.servos.values()))
            yield unknown_name(document, here, "servo model of this robot", name, models)
        elif entry.p is None and len(gains) > 1:
            found = "servos with P gains " + ", ".join(sorted(map(str, gains)))
            yield document.problem(here, "stiffness with which P gain", found=found, next_step="Add p, the gain of it")
        lowest, highest = entry.range_
        if not 0.0 < lowest <= entry.nominal <= highest:
            found, allowed = f"{entry.nominal:g}, range {lowest:g} to {highest:g}", "0 < lowest <= nominal <= highest"
            yield document.problem(here, "a nominal stiffness outside of its range", found=found, allowed=allowed)


def check_couplings(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    """Joints that exist, each in one coupling only; matrices that can be inverted; limits that the servos can serve."""
    joints = keys_of(document, "servos")
    holder: dict[str, int] = {}
    for index, coupling in enumerate(profile.couplings):
        here: KeyPath = ("couplings", index)
        for place, joint in enumerate(coupling.joints):
            if joint not in joints:
                yield unknown_name(document, (*here, "joints", place), "joint", joint, joints)
            elif holder.setdefault(joint, index) != index:
                yield document.problem((*here, "joints", place), "the joint is coupled already", found=joint)
        pair = {joint: profile.servos[joint] for joint in coupling.joints if joint in profile.servos}
        if all(joint in pair and _model(pair[joint]) and holder[joint] == index for joint in coupling.joints):
            for text in coupling_problems(servo_specs(pair, (coupling,))):
                yield document.problem(here, text, next_step="Check joints, matrix, limits, zero_tick and direction")


def _model(servo: Servo) -> ServoModel | None:
    try:
        return find_model(servo.model)
    except HardwareError:
        return None


def check_buses(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    """Ids, speed, watchdog and power switch of each bus."""
    for name, bus in profile.buses.items():
        here: KeyPath = ("buses", name)
        twice = sorted({number for number in bus.ids if bus.ids.count(number) > 1})
        if twice:
            yield document.problem((*here, "ids"), "an id is listed twice", found=", ".join(map(str, twice)))
        servos = [servo for servo in profile.servos.values() if servo.bus == name]
        models = [one for one in dict.fromkeys(map(_model, servos)) if one and bus.protocol in one.protocols]
        yield from _baud(here, bus, models, document)
        yield from _layouts(here, bus, models, document)
        yield from _watchdog(here, bus, models, document)
        yield from _power(here, bus, servos, document)


def _duplicate_ids(document: Document) -> Iterable[Problem]:
    """Looked for among all entries of the file, so that another fault of a servo hides none."""
    servos = document.data.get("servos")
    first: dict[tuple[str, int], str] = {}
    for joint, servo in servos.items() if isinstance(servos, dict) else ():
        number, bus = (servo.get("id"), servo.get("bus")) if isinstance(servo, dict) else (None, None)
        if type(number) is not int or not isinstance(bus, str):
            continue
        holder = first.setdefault((bus, number), joint)
        if holder != joint:
            found = f"{number}, also of {holder} on bus {bus!r}"
            step = "Give each servo of a bus its own id"
            yield document.problem(("servos", joint, "id"), "duplicate servo id", found=found, next_step=step)


def _mode(here: KeyPath, servo: Servo, model: ServoModel, document: Document) -> Iterable[Problem]:
    if servo.mode == "position" and abs(servo.homing_offset) > HOMING_REACH:
        what, allowed = "more than this mode honours", f"{-HOMING_REACH} to {HOMING_REACH} ticks"
        yield document.problem((*here, "homing_offset"), what, found=str(servo.homing_offset), allowed=allowed)
    if model.current_unit is None:
        limited = [entry for entry in SERVO_MODELS.values() if entry.current_unit is not None]
        names = ", ".join(entry.name for entry in limited)
        if servo.mode == "current_based_position":
            what, allowed = f"the {model.name} has no such mode", "position, extended_position, or one of " + names
            yield document.problem((*here, "mode"), what, found=servo.mode, allowed=allowed)
        if servo.current is not None:
            what = f"the {model.name} limits no current"
            yield document.problem((*here, "current"), what, found=f"{servo.current} A", next_step="Leave it out")
    elif servo.mode == "current_based_position" and servo.current is None:
        step = "Add the most that the servo may draw, in A"
        yield document.problem((*here, "current"), "missing key: this mode needs it", next_step=step)


def _protocol(here: KeyPath, servo: Servo, model: ServoModel, bus: Bus, document: Document) -> Iterable[Problem]:
    if bus.protocol not in model.protocols:
        spoken = " and ".join(map(str, model.protocols))
        found = f"{model.name} on bus {servo.bus!r} of protocol {bus.protocol}"
        yield document.problem((*here, "model"), "the servo speaks another protocol", found=found, allowed=spoken)
        return
    if model.layout_in(bus.protocol) is not Layout.OLDER:
        return
    table, subject = find_table(model.name, bus.protocol), f"the {model.name} with protocol {bus.protocol}"
    if servo.mode != "position":
        what = f"{subject} holds positions within one turn only"
        yield document.problem((*here, "mode"), what, found=servo.mode, allowed="position")
    if servo.current is not None and model.current_unit is not None:
        yield document.problem((*here, "current"), f"{subject} limits no current", found=f"{servo.current} A")
    if servo.homing_offset:
        what = f"{subject} has no homing offset"
        yield document.problem((*here, "homing_offset"), what, found=str(servo.homing_offset))
    for key, value in servo.gains.model_dump(exclude_none=True).items():
        name = f"{key}_gain"
        if not table.has(name):
            yield document.problem((*here, "gains", key), f"{subject} has no such gain", found=str(value))
        elif not table[name].allows(value):
            what, allowed = f"wrong value for {subject}", f"0 to {table[name].highest}"
            yield document.problem((*here, "gains", key), what, found=str(value), allowed=allowed)


def _baud(here: KeyPath, bus: Bus, models: Sequence[ServoModel], document: Document) -> Iterable[Problem]:
    allowed = BAUDS[bus.protocol]
    if bus.baud not in allowed:
        what, speeds = f"no speed of protocol {bus.protocol} servos", ", ".join(map(str, allowed))
        yield document.problem((*here, "baud"), what, found=str(bus.baud), allowed=speeds)
        return
    for model in models:
        most = fastest_baud(find_table(model.name, bus.protocol))
        if bus.baud > most:
            what = f"too fast for the {model.name} on this bus"
            yield document.problem((*here, "baud"), what, found=str(bus.baud), allowed=f"at most {most}")


def _layouts(here: KeyPath, bus: Bus, models: Sequence[ServoModel], document: Document) -> Iterable[Problem]:
    """Servos that keep their registers in other places than the others of the bus."""
    by_layout: dict[Layout, list[str]] = {}
    for model in models:
        by_layout.setdefault(model.layout_in(bus.protocol), []).append(model.name)
    if len(by_layout) > 1:
        what = "servos with control tables of two layouts: what is sent to all of them, torque off too, fits one only"
        found = "; ".join(f"{', '.join(names)} with {layout.value}" for layout, names in by_layout.items())
        step = "Give the servos of each layout a bus of their own, with its own port"
        yield document.problem(here, what, found=found, allowed="one layout for each bus", next_step=step)


def _watchdog(here: KeyPath, bus: Bus, models: Sequence[ServoModel], document: Document) -> Iterable[Problem]:
    silence = bus.watchdog_s
    if silence is None:
        return
    if bus.layout(models) is Layout.OLDER and silence > 0:
        what, step = f"servos of {Layout.OLDER.value} have no watchdog", "Leave it out, or write 0"
        yield document.problem((*here, "watchdog_s"), what, found=f"{silence:g} s", next_step=step)
    elif abs(silence - round(silence / WATCHDOG_STEP) * WATCHDOG_STEP) > TOLERANCE:
        allowed = "a multiple of 0.02 s up to 2.54 s, or 0 for none"
        yield document.problem((*here, "watchdog_s"), "wrong value", found=f"{silence:g} s", allowed=allowed)


def _power(here: KeyPath, bus: Bus, servos: list[Servo], document: Document) -> Iterable[Problem]:
    if bus.power is None:
        return
    number = bus.power.id
    if number not in bus.ids:
        found = f"{number}, which is not among the ids of the bus"
        yield document.problem((*here, "power", "id"), "the power switch is not on its bus", found=found)
    elif any(servo.id == number for servo in servos):
        found = f"{number}, the id of a servo"
        yield document.problem((*here, "power", "id"), "a servo cannot switch the servos' power", found=found)


def check_imu(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    """The keys of its kind, and a device on a bus that can carry it."""
    imu = profile.imu
    if imu is None:
        return
    needed, foreign = (("bus", "id"), ("port", "baud")) if imu.kind == "opencr" else (("port",), ("bus", "id"))
    lacking = [key for key in needed if getattr(imu, key) is None]
    if lacking:
        yield document.problem(("imu",), f"an IMU of this kind needs {' and '.join(lacking)}", found=imu.kind)
    for key in foreign:
        if getattr(imu, key) is not None:
            found, step = str(getattr(imu, key)), "Remove the key, or correct the kind"
            yield document.problem(
                ("imu", key), f"an IMU of kind {imu.kind} has no such key", found=found, next_step=step
            )
    if imu.kind != "opencr" or lacking:
        return
    buses, bus = keys_of(document, "buses"), profile.buses.get(imu.bus or "")
    if imu.bus not in buses:
        yield unknown_name(document, ("imu", "bus"), "bus", str(imu.bus), buses)
    elif bus is not None and bus.protocol != 2:
        found = f"{imu.bus}, of protocol {bus.protocol}"
        yield document.problem(("imu", "bus"), "an OpenCR speaks protocol 2.0 only", found=found)
    elif bus is not None and imu.id not in bus.ids:
        found = f"{imu.id}, which is not among the ids of bus {imu.bus!r}"
        yield document.problem(("imu", "id"), "the IMU is not on its bus", found=found)
    elif any(servo.bus == imu.bus and servo.id == imu.id for servo in profile.servos.values()):
        yield document.problem(("imu", "id"), "a servo has no IMU", found=f"{imu.id}, the id of a servo")


LANDMARKS = ("l_hand", "r_hand", "head")
"""Landmarks that every robot needs; one that stands on its feet needs the next ones too."""
STANDING_LANDMARKS = ("pelvis", "l_sole", "r_sole")
MIN_AREA = 1e-9  # [m^2] twice the area of the smallest triangle that counts as a turn


def check_parts(profile: RobotProfile, document: Document) -> list[Problem]:
    """All problems of the profile by itself."""
    checks = (
        check_servos,
        check_buses,
        check_imu,
        check_couplings,
        check_stiffness,
        _frame_names,
        _feet,
        _postures,
        _landmarks,
        _observers,
        _ignore_pairs,
        _safety,
    )
    return [problem for check in checks for problem in check(profile, document)]


def _frame_names(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    frames = keys_of(document, "frames")
    for name, foot in profile.feet.items():
        if foot.frame not in frames:
            yield unknown_name(document, ("feet", name, "frame"), "frame", foot.frame, frames)
    for name, landmark in profile.landmarks.items():
        for key, named in (("frame", (landmark.frame,)), ("anchor", landmark.anchor)):
            for frame in named:
                if frame not in frames:
                    yield unknown_name(document, ("landmarks", name, key), "frame", frame, frames)


def _feet(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    for name, foot in profile.feet.items():
        if not is_convex(foot.polygon):
            yield document.problem(
                ("feet", name, "polygon"),
                "the sole's outline is not convex and counter-clockwise",
                found=" ".join(f"({x:g}, {y:g})" for x, y in foot.polygon),
                allowed="corners in counter-clockwise order seen from above, without dents",
                next_step="Reorder the corners, or leave out those that dent",
            )


def is_convex(polygon: tuple[Point2, ...]) -> bool:
    """True if every corner turns left, and none lies right of an edge."""
    edges = list(zip(polygon, polygon[1:] + polygon[:1], strict=True))
    after = polygon[2:] + polygon[:2]
    turns_left = all(_side(*edge, corner) > MIN_AREA for edge, corner in zip(edges, after, strict=True))
    return turns_left and all(_side(*edge, corner) > -MIN_AREA for edge in edges for corner in polygon)


def _side(start: Point2, end: Point2, point: Point2) -> float:
    """Twice the signed area of the triangle, m^2: positive where `point` is left of the line from `start` to `end`."""
    return (end[0] - start[0]) * (point[1] - start[1]) - (end[1] - start[1]) * (point[0] - start[0])


def _postures(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    joints = keys_of(document, "servos")
    for name in (key for key in Postures.model_fields if key not in ("to_rest", "stays_at_rest")):
        posture = getattr(profile.postures, name, None)  # absent where the section is not valid
        if posture is None:
            continue
        for joint in posture:
            if joint not in joints:
                yield unknown_name(document, ("postures", name, joint), "joint", joint, joints)
        for joint, servo in profile.servos.items():
            angle = posture.get(joint, 0.0)
            if not servo.limits[0] <= angle <= servo.limits[1]:
                yield document.problem(
                    ("postures", name, joint),
                    "posture outside the joint's limits",
                    found=f"{angle} rad" + ("" if joint in posture else " (not named, so 0)"),
                    allowed=f"{servo.limits[0]} to {servo.limits[1]} rad",
                )


def _landmarks(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    present = keys_of(document, "landmarks")
    needed = LANDMARKS + (STANDING_LANDMARKS if profile.root == "free" else ())
    missing = [name for name in needed if name not in present]
    if missing and "landmarks" in document.data:
        step = f"Add {', '.join(missing)}"
        yield document.problem(
            ("landmarks",), "landmarks are missing", found=listed(present), allowed=listed(needed), next_step=step
        )
    for name, landmark in profile.landmarks.items():
        joints = {"follows": landmark.follows, "from": landmark.measured_from}
        joints["human_length"] = tuple(chain.from_iterable(landmark.human_length))
        for key, named in joints.items():
            for joint in named:
                if joint not in JOINTS:
                    yield unknown_name(document, ("landmarks", name, key), "human joint", joint, JOINTS)


def _observers(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    for name, observer in profile.observers.items():
        if observer.margin >= observer.influence:
            yield document.problem(
                ("observers", name, "margin"),
                "the margin must be smaller than the influence",
                found=f"{observer.margin} m",
                allowed=f"less than {observer.influence} m",
            )


def _ignore_pairs(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    for index, ignored in enumerate(profile.ignore_pairs):
        if ignored.pair[0] == ignored.pair[1]:
            found = f"{ignored.pair[0]} twice"
            yield document.problem(("ignore_pairs", index, "pair"), "a pair needs two different links", found=found)


WITHIN = (
    ("freshness_warn", "freshness", "s"),
    ("temperature_warn_c", "temperature_c", "degrees Celsius"),
    ("following_error_sustained", "following_error", "rad"),
    ("following_error_warn", "following_error_sustained", "rad"),
    ("planned_lag", "following_error_sustained", "rad"),
    ("following_error_warn", "following_error", "rad"),
    ("current_warn_a", "current_a", "A"),
)
"""Keys whose value must be below that of another, and their unit."""


def _safety(profile: RobotProfile, document: Document) -> Iterable[Problem]:
    """Warnings that would come only after the stop, and planned motion that would cause one."""
    safety: Safety | None = profile.safety
    if safety is None:  # the section is not valid
        return
    for key, other, unit in WITHIN:
        value, most = getattr(safety, key), getattr(safety, other)
        if value is not None and most is not None and value >= most:
            yield document.problem(
                ("safety", key),
                f"must be below {other}",
                found=f"{value:g} {unit}",
                allowed=f"less than {most:g} {unit}",
            )
    warn, stop = safety.voltage_warn, safety.voltage
    for name in {servo.model: None for servo in profile.servos.values() if servo.model in SERVO_MODELS}:
        table = find_table(name, max(SERVO_MODELS[name].protocols))
        low, high = (0.1 * (table[f"{end}_voltage_limit"].initial or 0) for end in ("min", "max"))
        if high and (high < stop[0] or low > stop[1]):
            what, allowed = f"the supply is not one of {name}", f"a range that meets {low:g} to {high:g} V"
            found = f"{stop[0]:g} to {stop[1]:g} V"
            yield document.problem(("safety", "voltage"), what, found=found, allowed=allowed)
    if warn is not None and not (stop[0] <= warn[0] and warn[1] <= stop[1]):
        yield document.problem(
            ("safety", "voltage_warn"),
            "must lie within voltage",
            found=f"{warn[0]:g} to {warn[1]:g} V",
            allowed=f"{stop[0]:g} to {stop[1]:g} V",
        )
