import os
import select
import socket
import threading
import time

from daq.discovery import rigfeed


def test_served_client_gets_complete_lines_until_another_connects():
    lines, sampler = os.pipe()
    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=rigfeed.serve, args=(lines, server))
        thread.start()
        os.write(sampler, b"old 1\nol")
        while select.select([lines], [], [], 0)[0]:  # read before a client connects
            time.sleep(0.001)
        with socket.create_connection(server.getsockname()) as first:
            os.write(sampler, b"d 2\nnew\nha")
            assert set(iter(first.makefile("rb").readline, b"new\n")) <= {b"old 1\n", b"old 2\n"}
            with socket.create_connection(server.getsockname()) as second:
                while first.recv(100):
                    pass
                os.write(sampler, b"lf\n")
                assert second.recv(100) == b"half\n"
                os.close(sampler)
                thread.join()
    os.close(lines)
