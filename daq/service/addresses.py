"""Print the network addresses required by a rig as a systemd drop-in for `rig-addresses`. The unit denies all others.

python -m daq.service.addresses RIG

If an instrument has a host name, the name servers are also allowed. The rig file does not contain the address of a
controller that connects to us, so private networks are allowed in this case.
"""

from __future__ import annotations

import ipaddress
import socket
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rigs.errors import CellError, RigError
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.links import tcp_address, udp_address

Resolve = Callable[[str], Sequence[str]]
_PRIVATE = ("10.0.0.0/8", "172.16.0.0/12", "192.168.0.0/16", "169.254.0.0/16", "fc00::/7", "fe80::/10")
"""Networks without a route to the internet: RFC 1918, RFC 3927, RFC 4193 and RFC 4291."""
_RESOLVERS = Path("/etc/resolv.conf")


def main(arguments: Sequence[str]) -> int:
    try:
        rig, _ = load(arguments[0])
        print(drop_in(rig, resolved, _RESOLVERS.read_text("utf-8", "replace") if _RESOLVERS.exists() else ""), end="")
    except RigError as error:
        print(f"error: {error.lines()[0]}", file=sys.stderr)
        return error.exit_code
    return 0


def drop_in(rig: Rig, resolve: Resolve, resolv_conf: str) -> str:
    """Drop-in with the addresses required by a rig. resolv_conf: content of /etc/resolv.conf."""
    listens = rig.feedback.listens
    ports = [*(gauge.port for gauge in rig.gauges.recorded.values()), *([] if listens else [rig.feedback.port])]
    hosts = [address[0] for port in ports if (address := tcp_address(port) or udp_address(port))]
    lines = (line.strip().partition(" ") for line in resolv_conf.splitlines())
    resolvers = [value.strip() for key, _, value in lines if key == "nameserver" and _is_address(value.strip())]
    needed = list(_PRIVATE) if listens else []
    for host in hosts:
        if _is_address(host):
            needed.append(host)
        else:
            needed += [*resolve(host), *resolvers]
    head = [f"# What {rig.name} reads, by the rig file; rig-addresses writes it again.", "[Service]"]
    return "\n".join([*head, *(f"IPAddressAllow={address}" for address in dict.fromkeys(needed))]) + "\n"


def resolved(name: str) -> Sequence[str]:
    try:
        addresses = socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        problem = f"cannot be resolved here: {getattr(error, 'strerror', None) or error}"
        raise CellError(name, problem, "write the IP address into the rig file", code="address.invalid") from None
    return [str(address[4][0]) for address in addresses]


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return "%" not in text  # systemd does not accept an IPv6 zone


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
