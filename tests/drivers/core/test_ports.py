"""Serial ports: who may have them."""

import os
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
