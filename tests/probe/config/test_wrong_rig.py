"""A rig that is wrong in four ways finds the wrong place and depth; calibrated, the right ones.

`benchmarks/figures/calibrating.py` does the same on finite elements and draws it.
"""

from typing import Any

import numpy as np
import pytest
from figures.emulated_rig import DELAY_MS, GAIN, STIFFNESS_N_MM, TILT_MM, WrongRig

from calibration import load
from probe.core.recording import Recording
from probe.detection import Finding, detect
from probe.storage.run import open_run

LUMP_MM, DEPTH_MM, FORCE_N = 32.0, 2.5, 1.2  # of the lump: 480 N/m, 2.5 mm deep


def reported(rig: WrongRig) -> tuple[Recording, Finding]:
    recording = open_run(rig.scan("", seed=1).path).recording()
    return recording, detect(recording)


def held(recording: Recording, mm: float) -> tuple[float, float]:
    """Depth [mm] that the run believes, and force [N], of the station at ``mm``."""
    station = min(recording.stations, key=lambda s: abs(1e3 * s.x_m - mm))
    hold = (station.time_s > station.hold_s + 0.1) & (station.time_s < station.retract_s)
    force = station.signal_pa[hold, 0] * recording.face_m2
    return 1e3 * float(np.median(station.depth_m[hold])), float(np.median(force))


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> WrongRig:
    return WrongRig(tmp_path_factory.mktemp("rig"), "TIT", winkler)


@pytest.mark.slow
def test_calibrations_make_a_wrong_rig_right(rig: WrongRig) -> None:
    before, wrong = reported(rig)
    rig.calibrate_all()
    after, right = reported(rig)

    # Untold, it believes 2.5 mm everywhere, while springs of 480 N/m on 2000 N/m gave 2.0 mm.
    assert held(before, LUMP_MM)[0] == pytest.approx(DEPTH_MM, abs=0.01)
    assert held(before, LUMP_MM)[1] == pytest.approx(GAIN * FORCE_N / 1.24, rel=0.01)
    assert held(after, LUMP_MM) == pytest.approx((DEPTH_MM, FORCE_N), rel=0.01)
    # the block's ends: 1.3 mm too deep or not deep enough, for 400 N/m
    for mm in (4.0, 60.0):
        assert abs(held(before, mm)[1] - 1.0) > 0.2
        assert held(after, mm) == pytest.approx((DEPTH_MM, 1.0), rel=0.01)
    assert abs(1e3 * wrong.objects[0].position_m - LUMP_MM) > 0.25
    (lump,) = right.objects
    assert lump.kind == "tumour"
    assert 1e3 * lump.position_m == pytest.approx(LUMP_MM, abs=0.05)
    assert lump.peak_pa == pytest.approx(0.2e4, rel=0.25)


def test_each_calibration_found_what_was_wrong(rig: WrongRig) -> None:
    if not rig.files:
        rig.calibrate_all()
    found = {kind: load(rig.folder / name).values for kind, name in rig.files.items()}
    assert found["force"]["sensitivity"].value[0][0] == pytest.approx(GAIN, rel=1e-3)
    assert 1e3 * found["latency"]["delay_s"].value == pytest.approx(DELAY_MS, abs=0.05)
    assert found["compliance"]["stiffness_n_m"].value == pytest.approx(
        1e3 * STIFFNESS_N_MM, rel=2e-3
    )
    height, along, across = found["surface"]["coefficients"].value
    assert height == pytest.approx(0.0, abs=10e-6)
    assert along == pytest.approx(2 * TILT_MM / 64, abs=1e-4)
    assert across == pytest.approx(0.0, abs=1e-3)
