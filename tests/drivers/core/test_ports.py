"""Serial ports: who may have them."""

import os
import socket
import tty

import pytest

from drivers import DeviceAbsent
from drivers.core.ports import open_port


def test_a_port_is_one_program_s_alone() -> None:
    controller, device = os.openpty()
    tty.setraw(device)
    path = os.ttyname(device)
    first = open_port("grbl", path, 115200)
    with pytest.raises(DeviceAbsent, match="another program has it open"):
        open_port("grbl", path, 115200)
    first.close()
    open_port("grbl", path, 115200).close()
    os.close(controller)
    os.close(device)


def test_a_port_that_nobody_serves_is_said_without_a_number_of_the_system() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = f"socket://127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(DeviceAbsent, match=r"^cell: port = .*: Connection refused$"):
        open_port("cell", port, baud=9600)
