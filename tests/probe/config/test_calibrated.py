"""Calibrations from files, applied in scans."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from calibration import Calibration, fit_axes, fit_taxels, record, save
from calibration.compliance import fit_compliance
from calibration.errors import CalibrationError
from calibration.force import fit_force
from calibration.latency import fit_latency
from drivers import Block, Channel, Pose, SimulatedClock
from drivers.core import abilities
from probe.cli import main
from probe.config.calibrated import CalibratedSensor, calibrated
from probe.config.devices import connect
from probe.config.load_rig import load_rig
from probe.config.rig import Rig
from probe.config.scan_plan import plan_for
from probe.core.contact_stress import stress_conversion
from probe.scan.session import scan
from probe.storage.run import open_run
from sim_backend.phantom.phantom import Respond


class Skewed:
    """A stage whose x reads 2 % too little and whose y leans into x."""

    name, simulated, at = "gantry", False, Pose(0.0, 0.0, 0.0)
    matrix = np.array([[1.02, 0.01, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])

    def pose(self) -> Pose:
        return self.at

    def move(self, target: Pose, _speed_m_s: float) -> None:
        self.at = target

    def unreachable(self, poses: Sequence[Pose]) -> dict[Pose, str]:
        """Its x reads up to 50 mm: in truth up to 51 mm and a hundredth of y."""
        return {pose: "out of reach" for pose in poses if pose.x > 0.05}


class Able(Skewed):
    """One that has all that a stage may have."""

    turns = homes = finds_contact = touched = True
    enable_s, max_speed_m_s, pace = 30.0, 0.018, 0.5

    def __init__(self) -> None:
        self.called: list[str] = []

    def __getattr__(self, name: str) -> Callable[[], list[str]]:
        def call() -> list[str]:
            self.called.append(name)
            return [name]

        return call

    def search(self, target: Pose, _speed_m_s: float) -> None:
        self.called.append("search")
        self.at = target


class Wrong:
    """A sensor that reads 30 % too much, 8 ms late."""

    name, rate_hz = "cell", 500.0
    channels = (Channel("force", "N", "force"), Channel("fx", "N"))

    def read(self) -> Block:
        t = np.arange(0.0, 1.0, 0.002)
        force = np.sin(20 * t**2)
        return Block(t + 0.008, np.column_stack([1.3 * force, t]), np.zeros((500, 2), dtype=bool))


class Reads:
    """A sensor that reads these rows, a second apart."""

    rate_hz = 10.0

    def __init__(self, name: str, channels: Sequence[Channel], rows: object) -> None:
        self.name, self.channels, self.rows = name, tuple(channels), np.array(rows, float)

    def read(self) -> Block:
        times = np.arange(float(len(self.rows)))
        return Block(times, self.rows, np.zeros(self.rows.shape, bool))


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
    _, (sensor,), notes = calibrated(Skewed(), [Wrong()], files)
    block = sensor.read()
    assert not notes
    assert np.abs(block.values[:, 0] - np.sin(20 * block.time_s**2)).max() < 0.01
    assert (block.values[:, 1] == Wrong().read().values[:, 1]).all()  # not a force


def test_what_the_device_says_of_its_samples_is_passed_on(tmp_path: Path) -> None:
    class Stumbling(Wrong):
        def read(self) -> Block:
            return replace(super().read(), lost=3, jumped_s=0.02)

    _, (sensor,), _ = calibrated(
        Skewed(), [Stumbling()], {"force": str(force_file(tmp_path / "f"))}
    )
    assert sensor.read().lost == 3
    assert sensor.read().jumped_s == 0.02


def test_another_devices_file_is_refused(tmp_path: Path) -> None:
    file = force_file(tmp_path / "f.json", "other")
    with pytest.raises(CalibrationError, match=r"made for 'other'; this rig's sensors are cell"):
        calibrated(Skewed(), [Wrong()], {"force": str(file)})


def test_channels_must_fit(tmp_path: Path) -> None:
    sensor = Wrong()
    sensor.channels = (*Wrong.channels, Channel("second", "N", "force"))
    with pytest.raises(CalibrationError, match="has 1 channels for 1 loads; cell has 2"):
        calibrated(Skewed(), [sensor], {"force": str(force_file(tmp_path / "f.json"))})


def test_a_rig_file_brings_them_in(tmp_path: Path, winkler: Respond) -> None:
    force_file(tmp_path / "f.json", "force")
    touches = tmp_path / "touches.csv"
    touches.write_text("x_mm,y_mm,z_mm\n0,0,1\n60,0,4\n0,5,1\n60,5,4\n30,2,2.5\n10,4,1.5\n")
    done = main(["calibrate", "surface", str(touches), "--device", "virtual", "--out",
                 str(tmp_path / "s.json")])  # fmt: skip
    assert done == 0
    rig_file = tmp_path / "rig.toml"
    rig_file.write_text(
        '[stage]\ndriver = "virtual"\n[[sensor]]\ndriver = "virtual"\n[scene]\nname = "TI"\n'
        '[calibration]\nforce = "f.json"\nsurface = "s.json"\n'
    )
    rig = load_rig(rig_file)
    assert plan_for(rig).surface(0.03, 0.0) == pytest.approx(2.5e-3, abs=1e-5)
    with connect(rig, SimulatedClock(), respond=winkler) as devices:
        (sensor,) = devices.sensors
        assert isinstance(sensor, CalibratedSensor)


def saved(one: Calibration, path: Path, device: str, days_old: float = 0.0) -> dict[str, str]:
    now = datetime.now(UTC) - timedelta(days=days_old)
    save(record(one, device, {}, now=now), path)
    return {one.KIND: str(path)}


def test_axis_errors_are_put_right_both_ways(tmp_path: Path) -> None:
    read = np.random.default_rng(1).uniform(0, 0.1, (20, 3))
    files = saved(fit_axes(read, read @ Skewed.matrix.T), tmp_path / "a.json", "gantry")
    wrong = Skewed()
    stage, _, _ = calibrated(wrong, [], files)
    stage.move(Pose(0.05, 0.02, -0.002), 0.01)
    assert wrong.matrix @ wrong.at[:3] == pytest.approx([0.05, 0.02, -0.002])
    assert stage.pose()[:3] == pytest.approx([0.05, 0.02, -0.002])
    assert (stage.name, stage.simulated) == ("gantry", False)
    near, far = Pose(0.0509, 0.0, 0.0), Pose(0.0511, 0.0, 0.0)
    assert abilities.unreachable(stage, [near, far]) == {far: "out of reach"}


def test_calibrated_axes_take_no_ability_from_a_stage(tmp_path: Path) -> None:
    read = np.random.default_rng(1).uniform(0, 0.1, (20, 3))
    files = saved(fit_axes(read, read @ Skewed.matrix.T), tmp_path / "a.json", "gantry")
    able = Able()
    stage, _, _ = calibrated(able, [], files)
    assert abilities.enable(stage) == ["enable"]
    abilities.keep_alive(stage)
    abilities.start_again(stage)
    stage.home()
    stage.base_pose()
    assert able.called == ["enable", "keep_alive", "start_again", "home", "base_pose"]
    assert abilities.finds_contact(stage) and abilities.touched(stage)
    assert (abilities.enable_s(stage), abilities.max_speed_m_s(stage)) == (30.0, 0.018)
    assert abilities.pace(stage) == 0.5
    abilities.move(stage, Pose(0.05, 0.02, -0.002), 0.01, search=True)
    assert able.called[-1] == "search"
    assert able.matrix @ able.at[:3] == pytest.approx([0.05, 0.02, -0.002])
    plain, _, _ = calibrated(Skewed(), [], files)
    abilities.move(plain, Pose(0.05, 0.02, -0.002), 0.01, search=True)
    assert not abilities.finds_contact(plain)
    assert (abilities.pace(plain), abilities.enable(plain)) == (1.0, [])


def test_dead_taxels_are_left_out_and_clipped_ones_marked(tmp_path: Path) -> None:
    pressure = np.repeat(np.linspace(0, 100, 6), 4)
    raw = np.outer(pressure, [1.0, 2.0, 0.0]) + 5 + 1e-3 * np.sin(np.arange(72)).reshape(24, 3)
    raw[:, 1] = np.minimum(raw[:, 1], 165.0)
    taxels = [Channel(f"t{n}", "raw", "taxel", full_scale=4096.0) for n in range(3)]
    array = Reads("array", taxels, [[10, 20, 1], [40, 160, 0]])  # of gains 1, 2 and none
    _, (sensor,), _ = calibrated(
        Skewed(), [array], saved(fit_taxels(raw, pressure), tmp_path / "t.json", "array")
    )
    assert [c.role for c in sensor.channels] == ["taxel", "taxel", "other"]
    assert [c.unit for c in sensor.channels] == ["Pa", "Pa", "raw"]
    scales = [c.full_scale for c in sensor.channels]
    assert scales == pytest.approx([4096.0, 2048.0, 4096.0], rel=1e-3)  # in the channel's unit
    block = sensor.read()
    assert block.values[:, :2] == pytest.approx(np.array([[10.0, 10], [40, 80]]), rel=1e-3)
    assert block.saturated.tolist() == [[False] * 3, [False, True, False]]


def test_a_force_calibration_makes_newtons(tmp_path: Path) -> None:
    loads = np.linspace(0, 20, 12)[:, None]
    one = fit_force(-200.0 * loads + 3 + 1e-3 * np.sin(9 * loads), loads)
    files = saved(one, tmp_path / "f.json", "adc")
    counts = Channel("load", "raw", "force", full_scale=8e6), Channel("t", "degC")
    cell = Reads("adc", counts, [[-400, 20], [-800, 20]])  # pressing counts down
    _, (sensor,), _ = calibrated(Skewed(), [cell], files)
    assert [c.unit for c in sensor.channels] == ["N", "degC"]
    assert sensor.channels[0].full_scale == pytest.approx(40e3)
    block = sensor.read()
    assert block.values[:, 0] == pytest.approx([2.0, 4.0], rel=1e-4)
    assert stress_conversion(sensor.channels, 1e-4).stress_pa(block.values)[0] == pytest.approx(2e4)


def test_crosstalk_is_taken_out_of_the_channel_that_has_it(tmp_path: Path) -> None:
    """Each cell counts 100 a newton; the second also feels a fifth of the first's load."""
    felt, loads = np.array([[100, 0], [20, 100]]), np.random.default_rng(2).uniform(0, 5, (20, 2))
    one = fit_force(loads @ felt.T + 1e-3 * np.sin(9 * loads), loads)
    true = np.array([[1.0, 0.0], [0.0, 1.0], [2.0, 3.0]])
    cells = Channel("left", "raw", "force"), Channel("right", "raw", "force")
    pair = Reads("pair", cells, true @ felt.T)
    _, (sensor,), _ = calibrated(Skewed(), [pair], saved(one, tmp_path / "f.json", "pair"))
    assert sensor.read().values == pytest.approx(true, abs=1e-3)


def test_what_is_old_absent_or_unknown_is_reported(tmp_path: Path) -> None:
    loads = np.arange(6.0)[:, None]
    one = fit_force(loads + 1e-3 * np.sin(9 * loads), loads)
    files = saved(one, tmp_path / "f.json", "cell", days_old=100)
    _, _, notes = calibrated(Skewed(), [Wrong()], files)
    assert "100.0 days old; it was meant to last 90 days" in notes[0]
    _, (sensor,), notes = calibrated(Skewed(), [Wrong()], files, stand_ins=["cell"])
    assert "which is simulated: not applied" in notes[0]
    assert isinstance(sensor, Wrong)
    with pytest.raises(CalibrationError, match="is a calibration of force"):
        calibrated(Skewed(), [Wrong()], {"latency": files["force"]})
    for key, said in (("tool", "'tool' is no kind"), ("surface_left", "a rig has one stage")):
        with pytest.raises(ValidationError, match=rf"calibration\.{key}: {said}"):
            Rig.model_validate({"calibration": {key: files["force"]}})
    with pytest.raises(CalibrationError, match="a calibration of force, not of compliance"):
        plan_for(Rig.model_validate({"calibration": {"compliance": files["force"]}}))


def test_a_soft_rig_is_moved_on_until_the_tip_is_deep_enough(
    tmp_path: Path, winkler: Respond
) -> None:
    """Tissue of 400 N/m on a rig of 2000 N/m: 2.5 mm of travel are 2.08 mm of indentation."""
    depth = np.linspace(-1e-3, 2e-3, 40)
    found = fit_compliance(depth, 2000 * np.maximum(depth, 0) + 1e-6 * np.sin(depth * 1e6))
    tables = {
        "stage": {"driver": "virtual", "stiffness_n_mm": 2.0},
        "scan": {"start_mm": 24, "stations": 1},
        "safety": {"max_force_n": 2.0, "workspace_mm": {"z": [-5.0, 50.0]}},
    }
    deep = []
    for files in ({}, saved(found, tmp_path / "c.json", "virtual")):
        rig = Rig.model_validate({**tables, "calibration": files})
        ran = scan(rig, "TI", tmp_path, respond=winkler)
        (station,) = open_run(ran.path).recording().stations
        held = station.time_s > station.hold_s
        force = 1e-4 * station.signal_pa[held, 0].max()
        deep.append((1e3 * np.median(station.depth_m[held][:300]), 1e3 * force / 400))
    assert deep[0] == pytest.approx((2.5, 2.083), abs=0.01)  # what it says, and what it was
    assert deep[1] == pytest.approx((2.5, 2.5), abs=0.01)
