"""Nothing arrives: where the sender may be sending instead, and what may be in the way."""

from ipaddress import IPv4Address

from retarget.doctor.elsewhere import Stray
from retarget.doctor.finding import Finding, mend, note
from retarget.doctor.firewall import firewall_findings
from retarget.live.address import EVERYWHERE, LOOPBACK, StreamAddress, for_others
from retarget.live.interfaces import local_interfaces
from retarget.live.mix_ups import SENDERS
from retarget.sources.natnet_wire import DATA_PORT

__all__ = ["silence_findings", "stray_finding"]


def silence_findings(
    address: StreamAddress, strays: tuple[Stray, ...], *, seconds: float, answered: bool = False
) -> list[Finding]:
    """Why an address hears nothing, the surest cause first. answered: what is wrong was told in another way."""
    found = []
    if not answered:
        found.append(mend("stream", f"nothing arrives in {seconds:.1f} s at {_place(address)}", _start(address)))
    found += [stray_finding(address, stray) for stray in strays]
    if strays or address.kind == "replay":
        return found
    if IPv4Address(address.bind).is_loopback:
        if address.kind != "natnet":
            option = "allow" if _protocol(address) == "UDP" else "tcp"
            step = for_others(address.kind, address.port, option=option)
            found.append(note("network", f"only this machine is heard; its own addresses are {_interfaces()}", step))
        return found
    allowed = ", ".join(str(network) for network in address.allow)
    found.append(note("network", f"this machine is {_interfaces()}; allowed to send: {allowed}", "Compare both ends"))
    port = address.port or DATA_PORT
    return found + firewall_findings(port, protocol="udp" if _protocol(address) == "UDP" else "tcp")


def _place(address: StreamAddress) -> str:
    if address.kind == "replay":
        return address.text
    if not address.port:
        return f"{address.bind}, any UDP port"
    return f"{address.bind}, {_protocol(address)} port {address.port}"


def _start(address: StreamAddress) -> str:
    """What is to be done at the sender."""
    if address.kind == "replay":
        return "Record anew: there is no datagram in it"
    if address.kind == "natnet":
        return "Start Motive, switch its streaming on, and see that this is its computer"
    return f"Start {SENDERS[address.kind]}, and let it send to {_target(address)}, port {address.port}"


def stray_finding(address: StreamAddress, stray: Stray) -> Finding:
    """One who sends to another place than is listened on."""
    what = f"{stray.host} sends {stray.got.text} to port {stray.port}"
    if stray.port == address.port:
        what += f" of {stray.interface}, and {address.bind} is listened on"
        return mend("network", what, f"Use {address.kind}://0.0.0.0:{address.port}?allow={stray.host}")
    if not stray.got.kind:
        return note("network", what, "It is not read here")
    if stray.got.kind == "natnet":
        return mend("network", what, f"Use natnet://{stray.host}, with ?multicast=GROUP where Motive streams multicast")
    local = IPv4Address(stray.host).is_loopback
    use = (
        f"{stray.got.kind}://:{stray.port}" if local else f"{stray.got.kind}://0.0.0.0:{stray.port}?allow={stray.host}"
    )
    if stray.got.kind != address.kind:
        return note("network", what, f"To use that: {use}")
    return mend("network", what, f"Use {use}, or let it send to port {address.port}")


def _protocol(address: StreamAddress) -> str:
    return "TCP" if address.kind == "mvn" and address.host is not None else "UDP"


def _target(address: StreamAddress) -> str:
    if address.bind == LOOPBACK:
        return LOOPBACK
    return "one of this machine's addresses" if address.bind == EVERYWHERE else address.bind


def _interfaces() -> str:
    return ", ".join(f"{number} ({name})" for name, number in local_interfaces().items()) or "none"
