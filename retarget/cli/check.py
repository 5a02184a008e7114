"""`retarget check FILE...`: validate and describe profiles, priorities, performers, scenes and sessions."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import compress
from pathlib import Path

import typer

from hardware.bus import BusSpec
from hardware.errors import counted
from hardware.servo import DEFAULT_P_GAIN, Layout, p_gain
from retarget.cli.exit import echo
from retarget.errors import ConfigError, Problem, RefusedError, UsageError, renamed_to, suggest
from retarget.ik.support_polygon import check_stand
from retarget.model.human_dimensions import proportional_dimensions
from retarget.model.observers import robot_observers
from retarget.model.robot import RobotBody, load_profile, load_robot
from retarget.robot.balance import heaviest_loads
from retarget.robot.follower import Follower
from retarget.robot.reach_map import map_path
from retarget.robot.walking.gait import walks
from retarget.run.options import RunOptions, name_with_mass
from retarget.run.rest_trajectory import at_rest, usual_rest_trajectory
from retarget.run.trial import try_approach, try_robot
from retarget.safety.contact import SLOWEST_HZ, felt_servos
from retarget.safety.joint_ranges import questioned_ranges
from retarget.schema.catalogue import Kind, calibration_path, entries, find, kind_by_keys, kind_of, read_as
from retarget.schema.files import check_place
from retarget.schema.performer import load_performer
from retarget.schema.priorities import load_priorities
from retarget.schema.profile import DRAFT, marked_lines
from retarget.schema.profile_parts import safety_facts
from retarget.schema.scene import load_scene
from retarget.schema.strict_models import Schema, listed, unknown_name
from retarget.schema.strict_yaml import Document, read_text, scan
from retarget.sources.open import SUFFIXES

STATURE_M = 1.75
"""Stature of a performer, m. The map is the same for any other."""
ELSEWHERE = {
    **dict.fromkeys(
        (".xml", ".urdf", ".mjcf"), "A body is checked with the profile that names it: give its robot.yaml"
    ),
    **dict.fromkeys((".asf", *(f".{suffix}" for suffix in SUFFIXES)), "For a motion file use `retarget inspect`"),
}
"""Next step for files with other suffixes."""


def check(files: list[str], reach: Path | None = None) -> None:
    """Validate profiles, priority files, performers, scenes and sessions; all errors of a file are shown at once.

    Arguments:
        files: Files, folders of robots, or names of shipped or own ones.

    Options:
        reach FILE: Draw which hand places a robot reaches, and by which strategy, as PNG; measured once, in a minute or
            more. With a priority file among FILES it is by that, else by hands_first.
    """
    refused = False
    for name in files:
        try:
            for kind, path in _targets(name):
                echo(_REPORTS[kind](path))
        except RefusedError as error:
            refused = True
            echo(f"error: {error}", err=True)
    if refused:
        raise typer.Exit(2)
    if reach is not None:
        _reach([target for name in files for target in _targets(name)], reach)


def _reach(targets: Sequence[tuple[Kind, Path]], picture: Path) -> None:
    from retarget.pictures.reach import draw_reach, reach_numbers

    robots = [path for kind, path in targets if kind is Kind.ROBOT]
    named = [path for kind, path in targets if kind is Kind.PRIORITIES] or [Path("hands_first")]
    if len(robots) != 1 or len(named) != 1 or picture.suffix.lower() != ".png":
        allowed, found = "one robot, at most one priority file, and FILE.png", f"{picture}, {listed(map(str, targets))}"
        raise UsageError("a map is of one robot", where="--reach", found=found, allowed=allowed)
    check_place(picture, option="--reach")
    robot, priorities = load_robot(robots[0]), load_priorities(named[0] if named[0].suffix else str(named[0]))
    if not map_path(robot, priorities).is_file():
        echo("measuring which hand places it reaches, once; it takes a minute or more")
    follower = Follower(robot, priorities, proportional_dimensions(STATURE_M))
    if follower.strategies is None:
        step = "Take a robot with two hands on its own soles, and priorities with `strategies`, as hands_first"
        raise UsageError("there is no map of this robot", where="--reach", found=priorities.name, next_step=step)
    draw_reach(robot, follower.stance, follower.strategies, picture)
    echo("\n".join([*reach_numbers(follower.strategies), f"written: {picture}"]))


def _targets(name: str) -> list[tuple[Kind, Path]]:
    """The files that a name or path means, and their kinds. A name may be that of a robot and of a priority file."""
    every = [(kind, entry) for kind in Kind for entry in entries(kind)]
    named = [(kind, entry.path) for kind, entry in every if entry.name == name]
    if named:
        return named
    path = Path(name)
    if path.suffix.lower() in ELSEWHERE:
        raise UsageError(
            "check takes configurations in YAML",
            where=name[:200],
            allowed="a robot profile (robot.yaml) or its folder, a priority file, a performer, a scene, a session",
            next_step=ELSEWHERE[path.suffix.lower()],
        )
    try:
        path = find(Kind.ROBOT, path)
    except UsageError:
        known = [entry.name for _, entry in every]
        raise UsageError(
            "there is no such file, and no configuration of that name",
            where=name[:200],
            allowed=", ".join(known),
            next_step=suggest(name, known) or renamed_to(Path(name).stem, known) or "Check the path",
        ) from None
    keys = scan(read_text(path), path).data.keys()
    kind = kind_by_keys(keys) or kind_of(path)
    if kind is None:
        raise ConfigError(
            "this is no configuration that can be checked",
            where=str(path),
            found="keys " + (", ".join(map(str, list(keys)[:10])) or "none"),
            allowed="a robot profile (servos, frames, ...), a priority file (levels), a performer (sensors), "
            "a scene (obstacles), a session (robot, source)",
        )
    return [(kind, path)]


def _robot(path: Path) -> str:
    from sim.buses import topples_at_rest
    from sim.physics.mount import simulation_problem

    problems = _unknown_priorities(scan(read_text(path), path))
    try:
        profile = load_profile(path)
    except ConfigError as error:
        problems = [*error.problems, *problems]
    if problems:
        raise ConfigError.from_problems(problems, title=f"{path}: {len(problems)} problems")
    robot = load_robot(path)
    observers = robot_observers(robot)
    margin, to_rest = check_stand(robot), usual_rest_trajectory(robot)
    for bus in ("mock", "profile"):  # without mass, and with it
        try_robot(robot, RunOptions(robot=str(path), bus=bus))
    try_approach(robot)
    dropped = [f"{one.first} and {one.second}: {one.reason}" for one in observers.dropped if not one.neighbours]
    models, layouts = [servo.model for servo in profile.servos.values()], profile.layouts()
    facts = {
        "body": f"{profile.body_path.name}, root {profile.root}",
        "servos": ", ".join(f"{models.count(model)} x {model}" for model in dict.fromkeys(models)),
        "buses": "; ".join(_bus(bus, layouts[bus.name]) for bus in profile.bus_specs()),
        "stiffness": _stiffness(robot),
        "calibration": _calibration(robot),
        "frames": f"{len(profile.frames)}",
        "landmarks": ", ".join(profile.landmarks),
        "observers": f"{len(observers.names)}, {len(observers.pairs)} pairs of them checked",
        "not checked": listed(dropped, limit=3) or "only neighbours along the body",
        "feet": ", ".join(profile.feet) or "none",
        "presses": _contacts(robot),
    }
    if margin is not None:
        facts["stands"] = f"centre of mass {1e3 * margin:.0f} mm inside the edge of the soles"
        facts["carries"] = "; ".join(map(str, heaviest_loads(robot)))
        facts["walks"] = walks(robot)
        facts["to rest"] = str(to_rest)
        how, stays = topples_at_rest(robot), profile.postures.stays_at_rest
        facts["at rest"] = f"{at_rest(robot)}; {_rests(how, stays=stays)}"
    if wide := tuple(questioned_ranges(robot, observers)):
        facts["warning"] = wide_ranges(wide)
    facts |= {"tick": f"{profile.safety.rate_hz:g} Hz", **safety_facts(profile.safety)}
    facts["priorities"] = (
        f"reconstruct {profile.reconstruct}, retarget {profile.retarget}, with mass {name_with_mass(robot)}"
    )
    facts["physics"] = "ready" if (missing := simulation_problem(robot)) is None else f"not possible: {missing}"
    if marked := marked_lines(read_text(path)):
        shown = ", ".join(map(str, marked[:8])) + (", ..." if len(marked) > 8 else "")
        facts["still a draft"] = f"{counted(len(marked), 'line')} marked {DRAFT}, to be corrected or confirmed: {shown}"
    verdict = "good" if to_rest is None or to_rest.is_safe else "good, but its way to rest is not safe"
    return _paragraph("robot", profile, path, facts, verdict=verdict)


def wide_ranges(wide: Sequence[str]) -> str:
    """Findings of `questioned_ranges` in words, with the next step."""
    advice = "Draw `limits` in to what the robot can do: the gate stops at a touch, and nothing else does"
    return f"{counted(len(wide), 'wide range')}: {listed(wide, limit=3)}. {advice}"


def _rests(how: str | None, *, stays: bool) -> str:
    """Words about a robot without torque. how: it falls in simulation; stays: by its profile."""
    if how is not None:
        then = "though its profile says that it stays" if stays else "so a run ends standing, with torque"
        return f"it goes down without torque ({how}), {then}"
    if stays:
        return "it stays there without torque, as tried in simulation"
    return "it stays there without torque in simulation: write `stays_at_rest: true`, and runs end there"


def _stiffness(robot: RobotBody) -> str:
    found: dict[str, None] = {}
    for servo in robot.joint_map.servos:
        name, gain = servo.model.name, p_gain(servo) / DEFAULT_P_GAIN
        one = servo.model.stiffness.scaled(gain)
        gains = "" if servo.gains.position_p is None else f" at P {servo.gains.position_p}"
        found[f"{name}{gains} {one.nominal:.3g} (range {one.lowest:.3g} to {one.highest:.3g})"] = None
    return ", ".join(found) + " N m/rad"


def _contacts(robot: RobotBody) -> str:
    felt = felt_servos(robot)
    if not felt.any():
        return f"not noticed: no servo beside those that carry it measures a current {SLOWEST_HZ:g} times a second"
    return f"noticed by {', '.join(compress(robot.joint_map.joints, felt))}"


def _calibration(robot: RobotBody) -> str:
    if robot.calibration is None:
        return "none: zero ticks of the profile"
    servos = robot.calibration.servos
    days = sorted({servo.date for servo in servos.values()})
    when = days[0] if len(days) == 1 else f"{days[0]} to {days[-1]}"
    path = calibration_path(robot.profile.name)
    return f"{len(servos)} of {len(robot.profile.servos)} servos homed on {when} ({path})"


def _bus(bus: BusSpec, layout: Layout) -> str:
    watchdog = f"bus watchdog {bus.watchdog:g} s" if bus.watchdog else "bus watchdog off"
    if layout is Layout.OLDER:
        watchdog = f"no bus watchdog: servos of {layout.value} hold their last goal when the host goes silent"
    return f"{bus.name} ({bus.port}, {bus.baud} baud, {len(bus.ids)} ids, {watchdog})"


def _unknown_priorities(document: Document) -> list[Problem]:
    known = tuple(entry.name for entry in entries(Kind.PRIORITIES))
    named = {key: document.data.get(key) for key in ("reconstruct", "retarget", "standing")}
    return [
        unknown_name(document, (key,), Kind.PRIORITIES.label, name, known)
        for key, name in named.items()
        if isinstance(name, str) and name not in known
    ]


def _priorities(path: Path) -> str:
    priorities = load_priorities(path)
    levels = {
        f"level {index}": f"{level.name}: {', '.join(task.type for task in level.tasks) or 'nothing'}"
        for index, level in enumerate(priorities.levels, 1)
    }
    about = {"description": priorities.description, "iterations": f"{priorities.iterations} per frame at most"}
    return _paragraph("priorities", priorities, path, about | levels)


def _performer(path: Path) -> str:
    performer = load_performer(path)
    sensors = (
        (name if name == sensor.joint else f"{name} on {sensor.joint}") + (" (oriented)" if sensor.orientation else "")
        for name, sensor in performer.sensors.items()
    )
    return _paragraph(
        "performer", performer, path, {"description": performer.description, "sensors": ", ".join(sensors)}
    )


def _scene(path: Path) -> str:
    scene = load_scene(path)
    facts = {"description": scene.description}
    for name, obstacle in scene.obstacles.items():
        poses = obstacle.path
        if poses is not None:
            again = ", again and again" if obstacle.loop else ""
            moves = f", {len(poses)} poses in {poses[-1].time - poses[0].time:g} s{again}"
        else:
            moves = "" if obstacle.velocity is None and obstacle.angular_velocity is None else ", at constant velocity"
        place = f"{obstacle.shape.label} in the {obstacle.frame}{moves}"
        stands = "; soles may stand on it" if obstacle.ground else ""
        facts[name] = f"{place}; influence {obstacle.influence:g} m, margin {obstacle.margin:g} m{stands}"
    return _paragraph("scene", scene, path, facts)


STAND_INS = {"robot": "op3", "source": "sample"}
"""Options for the check of a session file without them."""


def _session(path: Path) -> str:
    from retarget.cli.application import Command, called, command_of, session_options
    from retarget.cli.run import check_request

    command = command_of(check_request)
    options = {name: value() for name, value in session_options(read_as(Kind.SESSION, path), command).items()}
    words = [word for name, value in STAND_INS.items() if name not in options for word in (f"--{name}", value)]
    commands = typer.Typer(add_completion=False, rich_markup_mode=None)
    commands.command(cls=Command)(command)
    try:
        called(commands, [str(path), *words], "retarget run")
    except RefusedError as error:
        problems = [
            one if one.line else replace(one, where=": ".join(filter(None, (str(path), one.where))))
            for one in error.problems
        ]
        raise ConfigError.from_problems(problems) from error
    return _paragraph("session", None, path, {name: str(value) for name, value in options.items()})


_REPORTS: dict[Kind, Callable[[Path], str]] = {
    Kind.ROBOT: _robot,
    Kind.PRIORITIES: _priorities,
    Kind.PERFORMER: _performer,
    Kind.SCENE: _scene,
    Kind.SESSION: _session,
}


def _paragraph(kind: str, model: Schema | None, path: Path, facts: dict[str, str], *, verdict: str = "good") -> str:
    width = max(map(len, facts)) + 2
    head = f"{kind} {getattr(model, 'name', path.stem)}: {verdict} ({path})"
    return "\n".join([head, *(f"  {key + ':':<{width}}{value}" for key, value in facts.items())])
