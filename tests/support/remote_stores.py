"""Remote file stores on this computer, each in a separate process: an S3 server (moto) and an SFTP server
(asyncssh).
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from tests.support.child_processes import until

BUCKET = "runs"
_CREDENTIALS = {"AWS_ACCESS_KEY_ID": "AKIDOFTHETEST", "AWS_SECRET_ACCESS_KEY": "secret-of-the-test"}
_MOTO = "import sys; from moto.server import main; main(['-H', '127.0.0.1', '-p', sys.argv[1]])"


@dataclass(frozen=True)
class Store:
    """A store: its top-level URL, the environment variables required by rig, and its process, if any."""

    url: str
    environment: dict[str, str]
    process: subprocess.Popen[bytes] | None = None


@contextmanager
def s3_store(directory: Path) -> Iterator[Store]:
    """Run an S3 server with a bucket that contains the files below a directory."""
    import boto3  # noqa: PLC0415 - a test that has none is skipped

    port = _free_port()
    process = subprocess.Popen(
        [sys.executable, "-c", _MOTO, str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        endpoint = f"http://127.0.0.1:{port}"
        client = boto3.client(
            "s3",
            endpoint_url=endpoint,
            region_name="us-east-1",
            aws_access_key_id=_CREDENTIALS["AWS_ACCESS_KEY_ID"],
            aws_secret_access_key=_CREDENTIALS["AWS_SECRET_ACCESS_KEY"],
        )
        if not until(lambda: _made(client)):
            raise TimeoutError("no S3 server started")
        for file in sorted(directory.rglob("*")):
            if file.is_file():
                client.put_object(Bucket=BUCKET, Key=file.relative_to(directory).as_posix(), Body=file.read_bytes())
        environment = _CREDENTIALS | {"AWS_ENDPOINT_URL": endpoint, "AWS_DEFAULT_REGION": "us-east-1"}
        yield Store(f"s3://{BUCKET}", environment, process)
    finally:
        process.kill()
        process.wait()


@contextmanager
def sftp_store(directory: Path, keys: Path) -> Iterator[Store]:
    """Run an SFTP server for a directory. keys: directory for the keys of server and client."""
    keys.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "tests.support.sftp_server", str(directory), str(keys)]
    root = str(Path(__file__).parents[2])
    process = subprocess.Popen(
        command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": root}
    )
    try:
        assert process.stdout
        port = int(process.stdout.readline())
        environment = {
            "FSSPEC_SFTP_CLIENT_KEYS": str(keys / "client"),
            "FSSPEC_SFTP_KNOWN_HOSTS": str(keys / "known_hosts"),
        }
        yield Store(f"sftp://tester@127.0.0.1:{port}", environment, process)
    finally:
        process.kill()
        process.wait()
        if process.stdout:
            process.stdout.close()


def _made(client: object) -> bool:
    from botocore.exceptions import BotoCoreError  # noqa: PLC0415

    with suppress(BotoCoreError):
        client.create_bucket(Bucket=BUCKET)  # type: ignore[attr-defined]
        return True
    return False


def _free_port() -> int:
    import socket  # noqa: PLC0415

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
