from pathlib import Path

import numpy as np
import pytest

from sim_backend.scene.scene_file import Pulse, SceneError
from sim_backend.scene.waves import PA_PER_MMHG, load_wave


def test_paper_wave_passes_through_its_knots() -> None:
    wave = load_wave(Pulse(wave="paper"))
    mmhg = wave.pressure_pa(np.array([0.0, 0.10, 0.40, 0.825 - 1e-9])) / PA_PER_MMHG
    assert mmhg == pytest.approx([90, 120, 80, 90], abs=0.02)


def test_brachial_wave_agrees_with_its_series_before_scaling() -> None:
    wave = load_wave(Pulse(wave="brachial"))
    t = np.linspace(0, 0.825, 2000)
    mmhg = wave.pressure_pa(t) / PA_PER_MMHG
    assert mmhg.mean() == pytest.approx(96.6, abs=1.5)  # the published mean
    assert np.argmax(mmhg) < 0.4 * len(t)  # systole comes first


@pytest.mark.parametrize("name", ["paper", "brachial"])
def test_waves_span_diastole_to_systole_and_repeat_with_the_heart(name: str) -> None:
    wave = load_wave(Pulse(wave=name, rate_bpm=60, systolic_mmhg=150, diastolic_mmhg=70))
    t = np.linspace(0, 1, 5000)
    mmhg = wave.pressure_pa(t) / PA_PER_MMHG
    assert (mmhg.min(), mmhg.max()) == pytest.approx((70, 150), abs=0.05)
    assert wave.pressure_pa(t + 3) == pytest.approx(wave.pressure_pa(t), rel=1e-9)


def test_csv_wave_is_scaled(tmp_path: Path) -> None:
    (tmp_path / "beat.csv").write_text("time_s,pressure_mmhg\n0,1\n0.2,3\n0.5,2\n1,1\n")
    wave = load_wave(Pulse(wave="beat.csv", rate_bpm=120), tmp_path)
    assert wave.period_s == 0.5
    mmhg = wave.pressure_pa(np.array([0.0, 0.1, 0.25])) / PA_PER_MMHG
    assert mmhg == pytest.approx([80, 120, 100], abs=0.1)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time_s,p\n0,1\n", "pressure_mmhg"),
        ("time_s,pressure_mmhg\n0,1\n0,2\n1,3\n2,1\n", "line 3"),
        ("time_s,pressure_mmhg\n0,1\n1,x\n", "not a table of numbers"),
        ("time_s,pressure_mmhg\n0,1\n1,1\n2,1\n3,1\n", "never changes"),
        ("time_s,pressure_mmhg\n0,1\n1,nan\n2,1\n3,1\n", "not finite"),
    ],
)
def test_wrong_waves_are_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "w.csv").write_text(text)
    with pytest.raises(SceneError, match=said):
        load_wave(Pulse(wave="w.csv"), tmp_path)
