"""Calibration by weights, taken from the sensor: what a person says and what it then reads."""

import json
from contextlib import contextmanager, suppress
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from one_sensor import FunctionSensor

from calibration.errors import CalibrationError
from drivers import Channel, SimulatedClock
from probe.calibrate.weigh import newtons, take_weights
from probe.cli import main

GAIN, OFFSET = 0.37, 11.0


class Bench:
    """A person who puts on what they say, ``answers`` typed one after the other, by a hand that
    presses for a second."""

    def __init__(self, answers, wobble=()):
        self.clock = SimulatedClock()
        self.answers, self.wobble = list(answers), list(wobble)
        self.load_n, self.moving, self.reported = 0.0, False, []
        self.rng = np.random.default_rng(2)
        self.sensor = FunctionSensor(self.clock, self.reading)

    def reading(self, t):
        noise = 0.002 * self.rng.standard_normal(len(t))
        swing = 0.05 * (t - self.began_s) if self.moving else 0.0
        hand = np.where(t < self.began_s - 1e-3, 3.0, 0.0)
        return OFFSET + GAIN * self.load_n + noise + swing + hand

    def ask(self, question):
        self.reported.append(question)
        answer = self.answers.pop(0)
        self.clock.sleep_until(self.clock.now() + 1.0)
        self.began_s = self.clock.now()
        self.moving = bool(self.wobble) and self.wobble.pop(0)
        with suppress(ValueError):
            self.load_n = newtons(answer)
        return answer + "\n"


def take(bench, path):
    take_weights(bench.sensor, bench.clock, path, bench.ask, bench.reported.append)
    return np.loadtxt(path, delimiter=",", skiprows=1)


def test_the_table_holds_what_was_said_and_read(tmp_path):
    bench = Bench(["0", "0.5", "1N", "100g", ""])
    table = take(bench, tmp_path / "loads.csv")
    assert table[:, 1] == pytest.approx([0, 0.5, 1, 0.980665])
    assert table[:, 0] == pytest.approx(OFFSET + GAIN * table[:, 1], abs=0.001)
    assert not bench.sensor.running


def test_what_cannot_be_read_is_asked_again_and_a_moving_load_is_not_taken(tmp_path):
    bench = Bench(["heavy", "1 2", "0.5", "0.5", ""], wobble=[False, False, True, False, False])
    table = np.atleast_2d(take(bench, tmp_path / "loads.csv"))
    assert len(table) == 1
    assert table[0, 0] == pytest.approx(OFFSET + GAIN * 0.5, abs=0.001)
    said = "\n".join(bench.reported)
    assert "'heavy' is no load" in said
    assert "1 numbers are needed" in said
    assert "still moving" in said


def test_what_was_taken_is_kept_when_the_sensor_is_lost(tmp_path):
    bench = Bench(["0", "1", "2", ""])
    bench.sensor.fails_s = 7.5
    with pytest.raises(Exception, match=r"unplugged.*; 2 loads are kept in .*loads.csv: palpate"):
        take(bench, tmp_path / "loads.csv")
    assert len((tmp_path / "loads.csv").read_text().splitlines()) == 3


def test_a_mistyped_load_is_taken_back(tmp_path):
    bench = Bench(["undo", "0", "5", "undo", "-50g", "0.5", "-1", ""])
    table = take(bench, tmp_path / "loads.csv")
    assert table[:, 1] == pytest.approx([0, 0.5, -1])
    said = "\n".join(bench.reported)
    assert "none to take back" in said
    assert "taken back: 5.0 N" in said
    assert "a weight is not negative" in said


def test_ctrl_c_says_what_is_kept(tmp_path):
    bench = Bench(["0", "1"])
    typed = bench.ask

    def ask(question):
        if not bench.answers:
            raise KeyboardInterrupt
        return typed(question)

    bench.ask = ask
    with pytest.raises(KeyboardInterrupt, match=r"2 loads are kept in .*--device gauge fits them"):
        take(bench, tmp_path / "loads.csv")
    assert len((tmp_path / "loads.csv").read_text().splitlines()) == 3
    assert not bench.sensor.running


def test_without_a_load_there_is_no_table_in_the_way(tmp_path):
    for answers in ([""], ["heavy", ""], ["1", "undo", ""]):
        bench = Bench(answers)
        take_weights(
            bench.sensor, bench.clock, tmp_path / "loads.csv", bench.ask, bench.reported.append
        )
        assert not list(tmp_path.iterdir())


def test_a_load_beyond_the_range_is_asked_again(tmp_path, monkeypatch):
    bench = Bench(["1", "900", "2", ""])
    read = bench.sensor.read

    def clipping():
        block = read()
        return replace(block, saturated=np.full(block.values.shape, bench.load_n > 100))

    monkeypatch.setattr(bench.sensor, "read", clipping)
    assert take(bench, tmp_path / "loads.csv")[:, 1] == pytest.approx([1, 2])
    assert "at the end of its range" in "\n".join(bench.reported)


def test_an_older_table_is_not_overwritten(tmp_path):
    (tmp_path / "loads.csv").write_text("raw,load_n\n1,2\n")
    with pytest.raises(CalibrationError, match="exists already"):
        take(Bench([""]), tmp_path / "loads.csv")


def test_a_sensor_without_a_force_is_refused(tmp_path):
    bench = Bench([""])
    bench.sensor.channels = (Channel("ppg", "V", "reference"),)
    with pytest.raises(CalibrationError, match="no channel of role force"):
        take(bench, tmp_path / "loads.csv")


def test_the_command_takes_fits_and_writes(tmp_path, monkeypatch, capfd):
    bench = Bench(["0", "1", "2", "5", "2", "0", ""])

    @contextmanager
    def sensors(*_rig, **_options):
        yield (bench.sensor,)

    monkeypatch.setattr("probe.config.devices.open_sensors", sensors)
    monkeypatch.setattr("drivers.WallClock", lambda: bench.clock)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(readline=lambda: bench.ask("typed")))
    monkeypatch.chdir(tmp_path)
    rig = tmp_path / "rig.toml"
    rig.write_text(
        '[stage]\ndriver = "virtual"\n[[sensor]]\ndriver = "virtual"\n[scene]\nname = "TI"\n'
    )
    assert main(["calibrate", "force", "--live", str(rig), "--json"]) == 0
    reported = json.loads(capfd.readouterr().out)
    assert reported["device"] == "gauge"
    (gain,) = [
        q["value"] for name, q in reported["values"].items() if name.startswith("sensitivity")
    ]
    assert np.squeeze(gain) == pytest.approx(GAIN, rel=0.01)
    assert (tmp_path / "loads-gauge.csv").is_file()
    assert main(["calibrate", "tare", "--live", str(rig)]) == 2
    (tmp_path / "loads-gauge.csv").unlink()
    bench.answers = [""]
    assert main(["calibrate", "force", "--live", str(rig)]) == 2
    assert "no load was taken" in capfd.readouterr().err
