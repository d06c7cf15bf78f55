"""Serial ports: who may have them."""

import os
import socket
import tty

import pytest
from pydantic import ValidationError

from drivers import DeviceAbsent
from drivers.core.line import Line, NoAnswer
from drivers.core.ports import open_port
from drivers.zaber import ZaberSettings


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


def test_an_address_without_its_scheme_is_told_how_to_write_it() -> None:
    with pytest.raises(DeviceAbsent, match=r"on the network write socket://127\.0\.0\.1:23001"):
        open_port("cell", "127.0.0.1:23001", 9600)


@pytest.mark.parametrize("port", ["socket://a:99999", "socket://a:0", "socket://a", ""])
def test_what_can_be_no_port_is_refused_with_the_rig(port: str) -> None:
    """Before anything is opened or moves."""
    with pytest.raises(ValidationError, match=r"must be .*socket://host:port"):
        ZaberSettings.model_validate({"port": port})


def test_a_silent_address_may_serve_another_program() -> None:
    """Until it has answered: then its silence is its own."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = Line("zaber", f"socket://127.0.0.1:{server.getsockname()[1]}", 9600, 0.05)
        with pytest.raises(NoAnswer, match="or another program is connected to it: end that first"):
            line.ask(b"?", end=b"\n")
        peer, _ = server.accept()
        peer.sendall(b"here\n")
        assert line.listen(end=b"\n") == b"here"
        with pytest.raises(NoAnswer, match=r"no answer within 0.05 s$"):
            line.ask(b"?", end=b"\n")
        peer.close()
        line.close()
