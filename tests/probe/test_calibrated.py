"""Calibrations from files, applied in scans."""

import json
from pathlib import Path

import numpy as np
import pytest

from calibration import record, save
from calibration.compliance import fit_compliance
from calibration.errors import CalibrationError
from calibration.force import fit_force
from calibration.latency import fit_latency
from drivers import Block, Channel, SimulatedClock
from probe.calibrated import CalibratedSensor, calibrated
from probe.cli import main
from probe.devices import connect
from probe.rig import load_rig
from sim_backend.phantom import Respond


class Wrong:
    """A sensor that reads 30 % too much, 8 ms late."""

    name, rate_hz = "cell", 500.0
    channels = (Channel("force", "N", "force"), Channel("fx", "N"))

    def read(self) -> Block:
        t = np.arange(0.0, 1.0, 0.002)
        force = np.sin(20 * t**2)
        return Block(t + 0.008, np.column_stack([1.3 * force, t]), np.zeros((500, 2), dtype=bool))


def force_file(path: Path, device: str = "cell") -> Path:
    loads = np.linspace(0, 20, 12)[:, None]
    rng = np.random.default_rng(1)
    one = fit_force(1.3 * loads + 0.2 + 1e-3 * rng.standard_normal((12, 1)), loads)
    save(record(one, device, {"load_n": loads}), path)
    return path


def latency_file(path: Path) -> Path:
    t = np.arange(0, 12, 0.002)
    course = np.sin(2 * np.pi * (t + 0.4 * t**2))
    late = np.sin(2 * np.pi * ((t - 0.008) + 0.4 * (t - 0.008) ** 2))
    save(record(fit_latency(t, course, t, late), "cell", {}), path)
    return path


def test_wrong_gain_and_delay_are_put_right(tmp_path: Path) -> None:
    files = {"force": str(force_file(tmp_path / "f.json")),
             "latency": str(latency_file(tmp_path / "l.json"))}  # fmt: skip
    (sensor,), notes = calibrated((Wrong(),), files)  # type: ignore[arg-type]  # reads only
    block = sensor.read()
    assert not notes
    assert np.abs(block.values[:, 0] - np.sin(20 * block.time_s**2)).max() < 0.01
    assert (block.values[:, 1] == Wrong().read().values[:, 1]).all()  # not a force


def test_another_devices_file_is_refused(tmp_path: Path) -> None:
    file = force_file(tmp_path / "f.json", "other")
    with pytest.raises(CalibrationError, match=r"made for 'other'; this rig's sensors are cell"):
        calibrated((Wrong(),), {"force": str(file)})  # type: ignore[arg-type]


def test_channels_must_fit(tmp_path: Path) -> None:
    sensor = Wrong()
    sensor.channels = (*Wrong.channels, Channel("second", "N", "force"))
    with pytest.raises(CalibrationError, match="has 1 channels; cell has 2"):
        calibrated((sensor,), {"force": str(force_file(tmp_path / "f.json"))})  # type: ignore[arg-type]


def test_a_rig_file_brings_them_in(tmp_path: Path, winkler: Respond) -> None:
    force_file(tmp_path / "f.json", "force")
    touches = tmp_path / "touches.csv"
    touches.write_text("x_mm,y_mm,z_mm\n0,0,1\n60,0,4\n0,5,1\n60,5,4\n30,2,2.5\n10,4,1.5\n")
    done = main(["calibrate", "surface", str(touches), "--device", "table", "--out",
                 str(tmp_path / "s.json")])  # fmt: skip
    assert done == 0
    rig_file = tmp_path / "rig.toml"
    rig_file.write_text(
        '[stage]\ndriver = "virtual"\n[[sensor]]\ndriver = "virtual"\n[scene]\nname = "TI"\n'
        '[calibration]\nforce = "f.json"\nsurface = "s.json"\n'
    )
    rig = load_rig(rig_file)
    assert rig.plan.surface(0.03, 0.0) == pytest.approx(2.5e-3, abs=1e-5)
    with connect(rig, SimulatedClock(), respond=winkler) as devices:
        (sensor,) = devices.sensors
        assert isinstance(sensor, CalibratedSensor)


def test_calibrate_force_from_a_table(tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    rows = [f"{1.3 * load + 0.2 + 1e-3 * (n % 3 - 1)},{load}" for n, load in enumerate(range(12))]
    table.write_text("raw,load_n\n" + "\n".join(rows))
    out = tmp_path / "c.json"
    assert main(["calibrate", "force", str(table), "--device", "cell", "--out", str(out)]) == 0
    told = json.loads(out.read_text())
    assert told["device"] == "cell"
    assert told["values"]["sensitivity"]["value"][0][0] == pytest.approx(1.3, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("raw\n1\n2\n", "column load_n is missing; it has raw"),
        ("raw,load_n\n1,5\n1,5\n1,5\n1,5\n", "add readings"),
    ],
)
def test_bad_tables_are_explained(
    tmp_path: Path, text: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "t.csv"
    table.write_text(text)
    assert main(["calibrate", "force", str(table), "--device", "cell"]) == 2
    assert told in capsys.readouterr().err


def test_stiffness_is_what_a_run_corrects_depth_by() -> None:
    depth = np.linspace(-1e-4, 8e-4, 40)
    found = fit_compliance(depth, 2000 * np.maximum(depth, 0))
    assert found.true_depth(np.array([2.5e-3]), np.array([0.9]))[0] == pytest.approx(2.05e-3)
