"""What is wrong with a NatNet session, in plain words, and what to set in Motive."""

from retarget.errors import Problem
from retarget.sources.natnet_session import NEWEST, OLDEST, NatnetSession
from retarget.sources.natnet_wire import COMMAND_PORT, ServerInfo

__all__ = ["PATIENCE_S", "natnet_problems"]

PATIENCE_S = 3.0
"""s without an answer before it is called missing."""


def natnet_problems(session: NatnetSession, now: float, *, host: str) -> tuple[Problem, ...]:
    """All that is wrong at `now`, the cause before its consequences; empty where nothing is.

    host: as the user gave it, for the text.
    """
    server = session.server
    if server is None:
        waited = session.started is not None and now - session.started >= PATIENCE_S
        return (_no_answer(session, host),) if waited else ()
    if not OLDEST <= server.version <= NEWEST:
        return (_wrong_version(server, host),)
    found = []
    if session.silent(now):
        wrong = server.multicast != (session.settings.transport == "multicast")
        found.append(_other_transport(server, host) if wrong else _no_frames(session, host))
    if session.asked_at is not None and now - session.asked_at >= PATIENCE_S:
        found.append(
            Problem(
                "Motive tells no model definitions, so bodies have numbers and no names",
                where=host,
                next_step=f"Check that no firewall drops large UDP datagrams from port {COMMAND_PORT}",
            )
        )
    return tuple(found)


def _no_answer(session: NatnetSession, host: str) -> Problem:
    if session.frames:
        return Problem(
            f"frames arrive, but Motive does not answer on UDP port {COMMAND_PORT}: names and clock stay unknown",
            where=host,
            next_step="Check that this is the address of the computer that runs Motive, and both firewalls",
        )
    return Problem(
        f"no answer from Motive on UDP port {COMMAND_PORT}",
        where=host,
        next_step=(
            "In Motive's streaming settings switch streaming on and choose as Local Interface the network card of this "
            "network (not loopback); open UDP 1510 and 1511 in both firewalls"
        ),
    )


def _wrong_version(server: ServerInfo, host: str) -> Problem:
    old = server.version < OLDEST
    return Problem(
        "NatNet version that cannot be read",
        where=host,
        found=f"{server.version}, from {server.name} {server.app_version[0]}.{server.app_version[1]}",
        allowed="3.0 to 4.x (Motive 2.0 and later)",
        next_step="Update Motive" if old else "In Motive's streaming settings choose a 4.x bitstream version",
    )


def _other_transport(server: ServerInfo, host: str) -> Problem:
    sent = "multicast" if server.multicast else "unicast"
    wanted = "unicast" if server.multicast else "multicast"
    detail = f" to {server.group}, port {server.data_port}" if server.multicast else ""
    return Problem(
        "Motive streams another way than is listened for",
        where=host,
        found=sent + detail,
        allowed=wanted,
        next_step=f"In Motive's streaming settings set Transmission Type to {wanted}, or ask for {sent} here",
    )


def _no_frames(session: NatnetSession, host: str) -> Problem:
    if session.settings.transport == "multicast":
        hint = (
            f"; check that {session.group} was joined on the network card that faces Motive, and that UDP port "
            f"{session.data_port} is open in the firewall"
        )
    else:
        hint = "; check that the firewall lets UDP from Motive in"
    return Problem(
        "Motive answers but sends no frames",
        where=host,
        next_step="In Motive switch to Live or press Play, and stream Rigid Bodies or Skeletons" + hint,
    )
