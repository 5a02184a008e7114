"""`retarget run`: let a robot, or the virtual human alone, follow a recorded performer."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, cast

import typer

from hardware.realtime import Scheduling
from retarget.cli.follow_clip import follow_clip
from retarget.cli.follow_live import follow_live, refuse_for_file, refuse_for_live, sides_are_checked
from retarget.cli.outputs import Outputs
from retarget.cli.oversight import Oversight
from retarget.cli.overwrite import Overwrite
from retarget.clip import Parts, Playback
from retarget.frames import SensorFrames
from retarget.live.begin import LiveOptions
from retarget.live.smoothing import LIGHT
from retarget.options import RunOptions
from retarget.physics_options import PhysicsOptions
from retarget.priorities import Steps

LIVE = "Live streams"
PHYSICS = "Physics"
"""Headings of their options in the help."""


def run(
    robot: Annotated[
        str, typer.Option(help="Robot by name or path; 'human' only reconstructs the performer.", metavar="NAME|PATH")
    ],
    source: Annotated[
        str,
        typer.Option(
            help="Motion file of the performer (AMC, BVH or C3D), 'sample', which comes with the program, or a live "
            "stream: vmc://:39539, mvn://:9763, natnet://HOST, json://:14150, replay://FILE.",
            metavar="FILE|sample|ADDRESS",
        ),
    ],
    bus: Annotated[
        str,
        typer.Option(
            help="Where goals go: servos in this process, an emulator that talks as they do, a robot with mass that "
            "can fall (with the emulator's bytes: +wire), nowhere; or real servos on the ports of the profile, or on "
            "this one.",
            metavar="mock|emulator|physics|physics+wire|none|profile|PORT",
        ),
    ] = "mock",
    faults: Annotated[
        Path | None, typer.Option(help="What goes wrong on the emulator's wire.", metavar="FILE.yaml")
    ] = None,
    performer: Annotated[
        str,
        typer.Option(
            help="Which sensors are worn: five, five_head, three, six, ten, all, avatar, optitrack, "
            "optitrack_skeleton, or a file.",
            metavar="NAME|FILE",
        ),
    ] = "five",
    priorities: Annotated[
        str | None, typer.Option(help="Priority file of the robot (of 'human': its own).", metavar="NAME|FILE")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="What is around the body: table, wall, ..., or a file.", metavar="NAME|FILE")
    ] = None,
    allow_contact: Annotated[
        bool, typer.Option("--allow-contact", help="Also where the body touches the scene at the start.")
    ] = False,
    n_ik: Annotated[
        int | None, typer.Option("--n-ik", help="Iterations per frame at most, both stages.", metavar="N")
    ] = None,
    parts: Annotated[
        str, typer.Option(help="What follows; 'upper' keeps the legs still.", metavar="whole|upper")
    ] = "whole",
    steps: Annotated[
        str | None,
        typer.Option(
            help="When the performer lifts a foot: stay, or step in place once the mass is over the other; 'follow' "
            "for a robot that hangs. Usually as the priority file says: planted.",
            metavar="planted|shift|follow",
        ),
    ] = None,
    mirror: Annotated[bool, typer.Option("--mirror", help="Exchange left and right.")] = False,
    speed: Annotated[float, typer.Option(help="1 is the performer's speed.", metavar="X")] = 1.0,
    start: Annotated[float | None, typer.Option(help="Begin at this time of the recording.", metavar="S")] = None,
    end: Annotated[
        float | None, typer.Option(help="End at this time of the recording; live: after so long.", metavar="S")
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again until Ctrl-C, 10 minutes at most.")] = False,
    no_gate: Annotated[
        bool, typer.Option("--no-gate", help="Send goals unchecked; on servos that do not exist.")
    ] = False,
    skeleton: Annotated[
        Path | None, typer.Option(help="The ASF of an AMC, where it does not lie beside it.", metavar="FILE.asf")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Length unit of the file, where it states none.", metavar="m|cm|mm|inch|cmu")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Frames per second instead of the file's.", metavar="HZ")] = None,
    mount: Annotated[
        str | None,
        typer.Option(
            help="What the robot is on; usually as its profile's root says.",
            metavar="floor|stand|gantry",
            rich_help_panel=PHYSICS,
        ),
    ] = None,
    hook: Annotated[
        str | None,
        typer.Option(
            help="Frame of the profile by which a gantry holds it; usually 'hook'.",
            metavar="FRAME",
            rich_help_panel=PHYSICS,
        ),
    ] = None,
    trouble: Annotated[
        list[str] | None,
        typer.Option(
            help="Another mass (+-10 %), a centre of mass 10 mm off, friction from 0.5 to 1, 30 ms of latency, a push "
            "of 3 N for 0.2 s; drawn by the seed. Also several times.",
            metavar="mass|centre_of_mass|friction|latency|push",
            rich_help_panel=PHYSICS,
        ),
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Of all that chance decides; the same gives the same.", rich_help_panel=PHYSICS)
    ] = 0,
    countdown: Annotated[
        float,
        typer.Option(help="Time to get into the pose of the calibration.", metavar="S", rich_help_panel=LIVE),
    ] = 3.0,
    person: Annotated[
        str | None,
        typer.Option(
            help="Keep the performer's size under this name, and take it from there.",
            metavar="NAME",
            rich_help_panel=LIVE,
        ),
    ] = None,
    recalibrate: Annotated[
        bool,
        typer.Option("--recalibrate", help="Measure a --person anew who was measured before.", rich_help_panel=LIVE),
    ] = False,
    check_sides: Annotated[
        bool | None,
        typer.Option(
            "--check-sides/--no-check-sides",
            help="Raise your left arm to the front first; it proves sides and axes. Usual, but not for replay://.",
            show_default=False,
            rich_help_panel=LIVE,
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="The sides are known to be right: no --check-sides.", rich_help_panel=LIVE)
    ] = False,
    smoothing: Annotated[
        str,
        typer.Option(
            help="Of the sensors: by a One-Euro filter, or by the mean of a window, 60 ms late.",
            metavar="off|light|strong|window",
            rich_help_panel=LIVE,
        ),
    ] = LIGHT,
    latest: Annotated[
        bool,
        typer.Option("--latest", help="The newest poses at once, without a playout buffer.", rich_help_panel=LIVE),
    ] = False,
    record_raw: Annotated[
        Path | None,
        typer.Option("--record-raw", help="Keep every datagram, for replay://.", metavar="FILE", rich_help_panel=LIVE),
    ] = None,
    dead_man: Annotated[
        str | None,
        typer.Option(
            "--dead-man",
            help="The robot moves only while this key of the terminal, or pedal, is held.",
            metavar="KEY|pedal:DEVICE",
            rich_help_panel=LIVE,
        ),
    ] = None,
    stop_file: Annotated[
        Path | None,
        typer.Option("--stop-file", help="Stop when this file appears.", metavar="FILE", rich_help_panel=LIVE),
    ] = None,
    control_socket: Annotated[
        str | None,
        typer.Option(
            "--control-socket",
            help="Be stopped or held by other programs, see `retarget stop`; in XDG_RUNTIME_DIR without a PATH.",
            metavar="[PATH]",
            rich_help_panel=LIVE,
        ),
    ] = None,
    realtime: Annotated[
        int | None,
        typer.Option(
            help="Real-time priority of the ticks (SCHED_FIFO), 1 to 99; 40 if none is given.",
            metavar="[PRIORITY]",
            rich_help_panel=LIVE,
        ),
    ] = None,
    core: Annotated[
        int | None, typer.Option(help="The only core on which the ticks run.", metavar="N", rich_help_panel=LIVE)
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(help="Write the numbers of the run; into a folder, with a page.", metavar="FILE.json|DIR"),
    ] = None,
    save: Annotated[Path | None, typer.Option(help="Write every tick, for other tools.", metavar="FILE.npz")] = None,
    plots: Annotated[Path | None, typer.Option(help="Write pictures.", metavar="DIR")] = None,
    view: Annotated[
        int | None,
        typer.Option(help="Show the run on a web page of this machine.", metavar="[PORT]", min=0, max=65535),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(help="Keep the run while it goes on, for Foxglove and `retarget replay`.", metavar="FILE.mcap"),
    ] = None,
    overwrite: Overwrite = False,
) -> None:
    """Let a robot follow a performer, recorded or live, and say how well it did.

    Exit code 0: done; 1: stopped by the guard or by Ctrl-C, or a file not written; 2: refused before anything
    moved; 130: Ctrl-C before anything moved.
    """
    options = RunOptions(
        robot=robot,
        bus=bus,
        performer=performer,
        priorities=priorities,
        iterations=n_ik,
        parts=cast(Parts, parts),  # RunOptions refuses any other
        steps=cast(Steps | None, steps),
        gate=not no_gate,
        scene=scene,
        allow_contact=allow_contact,
        faults=faults,
        physics=PhysicsOptions(mount=mount, hook=hook, seed=seed, trouble=tuple(trouble or ())),
        playback=Playback(speed=speed, start=start, end=end, loop=loop, mirror=mirror),
    )
    outputs = Outputs.checked(report=report, save=save, plots=plots, record=record, overwrite=overwrite)
    outputs = replace(outputs, view=view)

    given: dict[str, object] = {"--person": person, "--recalibrate": recalibrate or None, "--check-sides": check_sides}
    given |= {"--record-raw": record_raw, "--stop-file": stop_file, "--dead-man": dead_man}
    given |= {"--control-socket": control_socket, "--realtime": realtime, "--core": core}
    if "://" in source:
        refuse_for_live({"--skeleton": skeleton, "--unit": unit, "--rate": rate, "--start": start})
        live = LiveOptions(
            countdown=countdown,
            duration=end,
            mirror=mirror,
            smoothing=smoothing,
            latest=latest,
            person=person,
            recalibrate=recalibrate,
            check_sides=sides_are_checked(source, check_sides, yes=yes),
        )
        ticks = Scheduling(priority=realtime, core=core)
        oversight = Oversight(stop_file=stop_file, dead_man=dead_man, control_socket=control_socket, scheduling=ticks)
        raise typer.Exit(follow_live(source, options, outputs, live, record_raw=record_raw, oversight=oversight))
    refuse_for_file(given)

    def read() -> SensorFrames:
        from retarget.sources.open import open_source

        return open_source(source, skeleton=skeleton, unit=unit, rate=rate)

    raise typer.Exit(follow_clip(read, options, outputs, source=source))
