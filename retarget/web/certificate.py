"""A certificate that a run makes for itself: without HTTPS, browsers give camera and headset to localhost alone."""

import hashlib
import ssl
from collections.abc import Sequence


def certified(hosts: Sequence[str]) -> tuple[ssl.SSLContext, str]:
    """A server's side of TLS for these names and IPv4 addresses, and the SHA-256 fingerprint of its certificate as
    browsers show it. Nobody vouches for it: who opens the page compares the fingerprint."""
    import trustme

    names = [host for host in hosts if ":" not in host]
    issued = trustme.CA(organization_name="retarget").issue_cert(*names, organization_name="retarget")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    issued.configure_cert(context)
    der = ssl.PEM_cert_to_DER_cert(issued.cert_chain_pems[0].bytes().decode())
    digest = hashlib.sha256(der).hexdigest().upper()
    return context, ":".join(digest[at : at + 2] for at in range(0, len(digest), 2))
