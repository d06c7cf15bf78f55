"""A taxel array over serial: shares of the stress, lost frames by their counter, wrong keys."""

import math
import os
import pty
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from emulated_devices import ARRAY
from running import running

from drivers import ConfigError, WallClock
from drivers.core.frame_cutter import FrameCutter
from drivers.core.reader import Sample
from drivers.taxels import TaxelSource, open_sensor
from sim_backend import load_scene
from sim_backend.emulators import taxels
from sim_backend.emulators.serving import Served
from sim_backend.phantom.array import VirtualArray
from sim_backend.phantom.phantom import Phantom, Respond


@pytest.fixture
def array(clock: WallClock, winkler: Respond, tmp_path: Path) -> Iterator[tuple[Served, Phantom]]:
    phantom = Phantom(load_scene("TI"), clock, winkler, home=(0.032, 0.0, -0.0025))
    quiet = VirtualArray(rows=4, columns=7, noise_pa=0.0, quantum_pa=0.0)
    with taxels.emulate(phantom, at=str(tmp_path / "array"), array=quiet) as device:
        yield device, phantom


def test_the_taxels_share_the_contact_stress(
    array: tuple[Served, Phantom], clock: WallClock
) -> None:
    device, phantom = array
    sensor = open_sensor(clock, port=device.address, **ARRAY, full_scale=1e5)
    with running(sensor):
        time.sleep(0.3)
        block = sensor.read()
    assert [c.name for c in sensor.channels[6:8]] == ["r0c6", "r1c0"]
    force = float(phantom.force_n(np.array([clock.now()]))[0])
    mean_pa = force / (1e-6 * phantom.scene.face_mm2)
    assert block.values.mean() == pytest.approx(mean_pa, rel=0.01)
    rows = block.values[0].reshape(4, 7)
    assert (rows == rows[0]).all()
    np.testing.assert_allclose(rows[0] / rows[0, 0], np.arange(1, 8), rtol=0.01)  # as it is felt
    assert len(block.time_s) > 5
    assert np.median(np.diff(block.time_s)) == pytest.approx(0.01, rel=0.05)  # 100 frames a second


@pytest.mark.parametrize(("counted", "gone"), [(True, [3, 4]), (False, [4])])
def test_a_frame_that_is_not_a_number_is_a_lost_one(
    clock: WallClock, counted: bool, gone: list[int]
) -> None:
    """Ten frames: 4 is not a number; 3 is never sent where a counter tells."""
    layout = ">Bf" if counted else ">f"
    ours, theirs = pty.openpty()
    cutter = FrameCutter(b"\xaa\x55", layout, "none")
    port = os.ttyname(theirs)
    source = TaxelSource(clock, "skin", port, 115200, cutter, counted, 1.0, 0.0, 0.01, 0.0)
    for n in [0, 1, 2, *range(3 + counted, 10)]:
        value = math.nan if n == 4 else float(n)
        os.write(ours, b"\xaa\x55" + struct.pack(layout, *([n] if counted else []), value))
    samples: list[Sample] = []
    end_s = time.monotonic() + 2.0
    while sum(1 + s.lost for s in samples) < 10 and time.monotonic() < end_s:
        samples += source.read()
    source.close()
    os.close(ours)
    os.close(theirs)
    assert [s.values for s in samples] == [[float(n)] for n in range(10) if n not in gone]
    assert [s.lost for s in samples if s.lost] == [len(gone)]
    assert samples[gone[0]].lost == len(gone)


@pytest.mark.parametrize("keys, words", [
    ({"header": "xyz"}, "header = 'xyz': must be hexadecimal"),
    ({"header": ""}, "header = ''"),
    ({"rows": 0}, "rows = 0"),
    ({"unit": "N"}, "taxels measure a pressure"),
])  # fmt: skip
def test_wrong_keys_are_named(clock: WallClock, keys: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        open_sensor(clock, port="x", **(ARRAY | keys))
