"""SFTP server program for a single key. Arguments: directory to serve, and directory for the keys.

It writes a client key and a file of known hosts, then prints its port.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

import asyncssh


async def serve(directory: Path, keys: Path) -> None:
    host, client = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
    client.write_private_key(keys / "client")
    client.write_public_key(keys / "allowed")
    server = await asyncssh.listen(
        "127.0.0.1",
        0,
        server_host_keys=[host],
        authorized_client_keys=str(keys / "allowed"),
        sftp_factory=lambda channel: asyncssh.SFTPServer(channel, chroot=str(directory)),
    )
    port = server.sockets[0].getsockname()[1]
    (keys / "known_hosts").write_bytes(f"[127.0.0.1]:{port} ".encode() + host.export_public_key())
    print(port, flush=True)
    await server.wait_closed()


if __name__ == "__main__":
    asyncio.run(serve(Path(sys.argv[1]), Path(sys.argv[2])))
