#!/usr/bin/python3
"""Send the joints of LinuxCNC to the computer of rig. This program runs on the controller and moves nothing.

rig.hal starts it: it reads the lines of halsampler and sends them to the client of a TCP port. There is one client; a
new one replaces it. Lines that arrive without a client are dropped, so that a client never receives old samples. The
program ends with halsampler, when LinuxCNC ends, or when the samples stop.
"""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
from time import monotonic, sleep

_PATIENCE_S = 30.0
"""Time that a client may read nothing. The samples wait in the buffers of socket, pipe and HAL, and lost ones are
counted there."""
_FIRST_S, _NEXT_S = 60.0, 5.0
"""Longest time before the first lines, while LinuxCNC loads, and between later lines. Then the servo thread is dead."""
_PORT_S = 10.0
"""Time for a previous program to release the port."""


def serve(lines: int, server: socket.socket) -> None:
    """Send the lines of a file descriptor to the clients of a listening socket until the file ends."""
    client: socket.socket | None = None
    rest, until_s = b"", monotonic() + _FIRST_S
    while True:
        ready, _, _ = select.select([lines, server.fileno()], [], [], max(0.0, until_s - monotonic()))
        if not ready:
            break
        if server.fileno() in ready:
            if client:
                client.close()
            client, _ = server.accept()
            client.settimeout(_PATIENCE_S)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if lines not in ready:
            continue
        data, until_s = os.read(lines, 65536), monotonic() + _NEXT_S
        if not data:
            break
        whole, end, rest = (rest + data).rpartition(b"\n")
        if client:
            try:
                client.sendall(whole + end)
            except OSError:
                client.close()
                client = None
    if client:
        client.close()


def listen(port: int) -> socket.socket:
    """Open the port, also if a previous program releases it only later."""
    until_s = monotonic() + _PORT_S
    while True:
        try:
            return socket.create_server(("", port))
        except OSError:
            if monotonic() > until_s:
                raise
            sleep(0.5)


def main() -> None:
    """Start halsampler and serve its lines. Arguments: TCP port and channel of the sampler."""
    # Without stdbuf, halsampler collects 4 KB before it writes to a pipe.
    command = ["/usr/bin/stdbuf", "-oL", "/usr/bin/halsampler", "-t", "-c", sys.argv[2]]
    with listen(int(sys.argv[1])) as server, subprocess.Popen(command, stdout=subprocess.PIPE) as sampler:
        assert sampler.stdout is not None  # noqa: S101 - a pipe
        serve(sampler.stdout.fileno(), server)
        sampler.kill()


if __name__ == "__main__":
    main()
