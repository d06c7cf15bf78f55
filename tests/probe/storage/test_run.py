"""Reading a run file, and refusing whatever is none."""

import resource
import shutil
import sqlite3
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from databases import opened
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers import Block, Channel
from probe.config.rig import Rig
from probe.core.cut_stations import quantum, record
from probe.core.events import (
    Event,
    Finish,
    Phase,
    PhaseEntered,
    RunEnded,
    RunStarted,
    Samples,
    StationEnded,
    StationStarted,
)
from probe.scan.session import scan
from probe.storage.reader import COLUMNS, judged_rows
from probe.storage.run import NotBegun, RunFileError, follow, open_run
from probe.storage.verify import verify
from probe.storage.writer import create_store

FEW = Rig.model_validate({"scan": {"start_mm": 28, "stations": 3}})
QUICK = settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> Path:
    """A finished run of three stations around an artery."""
    out = tmp_path_factory.mktemp("runs")
    return scan(FEW, "TIHA", out, seed=2, respond=winkler).path


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory, winkler: Any) -> Path:
    """A finished run of one short press: a flipped byte in it seldom lies among samples alone."""
    rig = Rig.model_validate({"scan": {"start_mm": 32, "stations": 1, "hold_s": 0.2}})
    return scan(rig, "TIHA", tmp_path_factory.mktemp("short"), seed=2, respond=winkler).path


def read_all(path: Path) -> None:
    """Everything a user can ask a run for."""
    run = open_run(path)
    list(run.events())
    run.recording()
    run.stations()
    run.samples()
    _ = run.finish


def test_stations_come_as_a_table_with_units(path: Path) -> None:
    table = open_run(path).stations()
    assert table["x_mm"].to_list() == pytest.approx([28, 32, 36])
    assert table["station"].to_list() == [1, 2, 3]
    assert table["attempt"].to_list() == [1, 1, 1]
    assert table["complete"].all()
    assert (table["ended_s"] - table["started_s"]).to_numpy() == pytest.approx(2.8, abs=0.25)
    assert table["samples"].to_numpy() == pytest.approx(500 * 2.8, rel=0.1)


def test_samples_come_as_labelled_arrays_with_units(path: Path) -> None:
    run = open_run(path)
    data = run.samples()
    assert data["time_s"].attrs["units"] == "s"
    assert data["force"].attrs == {"units": "N", "role": "force", "simulated": 1}
    held = data.where((data["station"] == 2) & (data["phase"] == "holding"), drop=True)
    assert float(held["force"].max()) == pytest.approx(1.2 + 2e-6 * 120 * 133.322, rel=0.02)
    assert not data["force_saturated"].any()
    pose = run.samples("stage", station=3)
    assert set(pose) >= {"x", "y", "z"}
    assert float(pose["z"].min()) == pytest.approx(-2.5e-3, abs=1e-6)
    assert set(np.unique(pose["station"])) == {3}


def test_samples_carry_the_depth_of_the_tip_at_their_time(path: Path) -> None:
    for device in ("stage", "force"):
        data, stage = (open_run(path).samples(name) for name in (device, "stage"))
        deep_mm = data["depth_mm"].to_numpy()
        height_m = np.interp(data["time_s"], stage["time_s"], stage["z"])
        known = np.isfinite(deep_mm)
        assert np.abs(deep_mm + 1e3 * height_m)[known].max() <= 0.01
        by_phase = {str(p): deep_mm[data["phase"] == p] for p in np.unique(data["phase"])}
        assert np.median(by_phase["holding"]) == pytest.approx(2.5)
        assert 0.5 < np.nanmedian(by_phase["indenting"]) < 2.0
        assert np.nanmedian(by_phase["approaching"]) < 0


def test_what_is_asked_for_must_be_there(path: Path) -> None:
    with pytest.raises(RunFileError, match="no device 'nose'; it has force, stage"):
        open_run(path).samples("nose")
    with pytest.raises(RunFileError, match="no station 0; it has 1 to 3"):
        open_run(path).samples(station=0)


def test_a_recording_is_what_was_felt(path: Path) -> None:
    run = open_run(path)
    recording = run.recording()
    face_m2 = recording.face_m2
    assert recording.finish == "completed"
    assert recording.channels == ("force.force",)
    assert recording.simulated == run.simulated
    assert recording.quantum_pa == pytest.approx(0.1e-3 / face_m2)
    assert [s.index for s in recording.stations] == [0, 1, 2]
    assert [s.x_m for s in recording.stations] == pytest.approx([0.028, 0.032, 0.036])
    for station in recording.stations:
        assert station.indent_s < station.hold_s < station.retract_s
        hold = (station.time_s > station.hold_s) & (station.time_s < station.retract_s)
        assert station.depth_m[hold] == pytest.approx(2.5e-3, abs=1e-6)
        air = station.time_s < station.indent_s
        assert np.abs(station.signal_pa[air]).max() < 5e-3 / face_m2  # tared: no step before
    middle = recording.stations[1]
    assert middle.signal_pa.max() * face_m2 == pytest.approx(1.2 + 2e-6 * 120 * 133.322, rel=0.02)


def test_depth_is_from_where_touch_found_the_surface(tmp_path: Path, winkler: Any) -> None:
    table = {"scan": {"start_mm": 32, "stations": 1, "touch_n": 0.05, "indentation_mm": 1.0}}
    ran = scan(Rig.model_validate(table), "TIHA", tmp_path, respond=winkler)
    (station,) = open_run(ran.path).recording().stations
    assert station.depth_m.max() == pytest.approx(1.0e-3, abs=1e-5)
    assert open_run(ran.path).samples("stage")["z"].min() < -1.09e-3  # it was found lower


def test_depth_on_a_slope_is_along_its_normal(tmp_path: Path, winkler: Any) -> None:
    slope = [[0, 0, 0], [60, 0, 20], [0, 5, 0]]
    table = {"scan": {"start_mm": 32, "stations": 1, "surface_mm": slope}}
    ran = scan(Rig.model_validate(table), "TIHA", tmp_path, respond=winkler)
    (station,) = open_run(ran.path).recording().stations
    held = (station.time_s > station.hold_s) & (station.time_s < station.retract_s)
    assert station.depth_m[held] == pytest.approx(2.5e-3, abs=1e-5)


def test_a_rig_that_bends_is_less_deep_by_its_force_over_its_stiffness() -> None:
    kept = {"content": {"values": {"stiffness_n_m": {"value": 2000.0}}}}
    started = RunStarted(
        0.0, "", {"face_mm2": 100.0, "calibration": {"compliance": kept}},
        {"cell": (Channel("force", "N", "force"),)},
    )  # fmt: skip
    time_s, n = np.arange(1, 11) / 10, 10
    poses = np.zeros((n, 6))
    poses[1:, 2] = -3e-3
    events: list[Event] = [
        started,
        StationStarted(0.0, 0, 1, 0.0, 0.0),
        PhaseEntered(0.1, Phase.INDENTING, 0),
        Samples("stage", Block(time_s, poses, np.zeros(poses.shape, bool)), 0, 1),
        Samples("cell", Block(time_s, np.full((n, 1), 1.0), np.zeros((n, 1), bool)), 0, 1),
        StationEnded(1.1, 0, 1, complete=True),
    ]
    (station,) = record(events).stations
    assert station.depth_m[1:] == pytest.approx(2.5e-3)


def test_taxels_share_the_face_and_a_reference_stays_beside() -> None:
    channels = {
        "skin": tuple(Channel(f"t{n}", "N", "taxel") for n in range(4)),
        "ppg": (Channel("light", "V", "reference"),),
    }
    started = RunStarted(0.0, "", {"face_mm2": 100.0}, channels)
    time_s = np.arange(1, 11) / 10
    force = np.tile([1.0, 2.0, 3.0, 4.0], (10, 1))
    light = np.sin(time_s)[:, None]
    events: list[Event] = [
        started,
        StationStarted(0.0, 0, 1, float("nan"), float("nan")),
        Samples("skin", Block(time_s, force, force > 3.5), 0, 1),
        Samples("ppg", Block(time_s, light, light > 2), 0, 1),
        StationEnded(1.1, 0, 1, complete=True),
    ]
    recording = record(events)
    (station,) = recording.stations
    assert station.signal_pa[0] == pytest.approx(np.array([1, 2, 3, 4]) / 25e-6)
    assert station.saturated[0].tolist() == [False, False, False, True]
    assert (station.reference == light[:, 0]).all()
    assert np.isnan([station.x_m, station.hold_s]).all()
    assert np.isnan(station.depth_m).all()
    assert recording.finish == "faulted"  # it never ended
    with pytest.raises(RunFileError, match="face is not known"):
        record([RunStarted(0.0, "", {}, channels), *events[1:]])
    assert record([RunStarted(0.0, "", {}, channels), *events[1:]], 100.0).stations


@given(
    st.floats(1e-5, 1e3), st.lists(st.integers(-500, 500), min_size=40, max_size=200), st.floats()
)
def test_the_step_of_readings_is_found(step: float, counts: list[int], offset: float) -> None:
    tare = 0.37 * step if not np.isfinite(offset) else (offset % 1) * step
    levels = np.unique(counts)
    found = quantum([step * np.array(counts) - tare])
    true = step * float(np.gcd.reduce(np.diff(levels))) if len(levels) > 1 else 0.0
    assert found == pytest.approx(true, rel=1e-3) or (found == 0 and len(levels) < 17)


def test_readings_without_steps_have_none() -> None:
    assert quantum([np.random.default_rng(1).normal(size=1000)]) == 0.0
    assert quantum([np.zeros(5)]) == 0.0


def test_a_file_that_cannot_be_opened_now_is_not_called_damaged(path: Path) -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, hard))
    try:
        with pytest.raises(RunFileError) as refused:
            open_run(path).recording()
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    assert "cannot be read (unable to open database file)" in str(refused.value)


def test_reading_leaves_nothing_beside_a_finished_run(path: Path) -> None:
    before = {p.name: p.read_bytes() for p in path.parent.iterdir()}
    read_all(path)
    verify(path)
    assert {p.name: p.read_bytes() for p in path.parent.iterdir()} == before


def test_a_growing_run_is_read_and_followed(tmp_path: Path, path: Path) -> None:
    events = list(open_run(path).events())
    seen = follow(tmp_path / "new.run")
    assert list(islice(seen, 2)) == [None, None]  # not there yet
    found: list[Event] = []
    with create_store(tmp_path / "new.run") as store:
        assert next(seen) is None  # there, but empty
        with pytest.raises(NotBegun):
            open_run(tmp_path / "new.run")
        for n, event in enumerate(events):
            store(event)
            if n % 40 == 0:
                store.flush()
                found += [e for e in islice(seen, 60) if e is not None]
                assert len(found) == n + 1
                run = open_run(tmp_path / "new.run")
                ended = sum(isinstance(e, StationEnded) for e in events[: n + 1])
                assert run.finish is None
                assert len(run.recording().stations) == ended
    found += [e for e in islice(seen, len(events)) if e is not None]
    assert [type(e) for e in found] == [type(e) for e in events]
    assert found[-1] == events[-1]


def write(path: Path, *statements: str) -> Path:
    with opened(path, isolation_level=None) as connection:
        for statement in statements:
            connection.execute(statement)
    return path


def test_what_is_no_run_is_refused_with_a_reason(tmp_path: Path, path: Path) -> None:
    text = tmp_path / "text.csv"
    text.write_text("x_mm,force_n\n1,2\n" * 100)
    other = write(tmp_path / "other.run", "CREATE TABLE photos (a)")
    newer = Path(shutil.copyfile(path, tmp_path / "newer.run"))
    write(newer, "PRAGMA user_version = 99")
    trap = Path(shutil.copyfile(path, tmp_path / "trap.run"))
    write(trap, "DROP VIEW station", "CREATE VIEW station AS SELECT randomblob(1e9) AS x")
    for wrong, said in (
        (tmp_path / "missing.run", "no such run file"),
        (tmp_path, "a folder"),
        (text, "not a run file .*`palpate import` reads other"),
        (other, "not a run of palpate"),
        (newer, "newer palpate.*update"),
        (trap, "tables are not those of a run"),
    ):
        for reader in (read_all, verify):
            with pytest.raises(RunFileError, match=said) as caught:
                reader(wrong)
            assert str(wrong) in str(caught.value)


def test_sizes_are_bounded(tmp_path: Path, path: Path) -> None:
    large = Path(shutil.copyfile(path, tmp_path / "large.run"))
    write(large, "UPDATE event SET readings = zeroblob(200000000) WHERE id = 100")
    with pytest.raises(RunFileError, match="too big"):
        read_all(large)
    assert not verify(large).ok
    with large.open("r+b") as file:
        file.truncate(100 * 1024**3)  # sparse
    with pytest.raises(RunFileError, match="larger than"):
        read_all(large)


@QUICK
@given(st.binary(max_size=3000), st.booleans())
def test_random_bytes_are_no_run(tmp_path: Path, content: bytes, led: bool) -> None:
    wrong = tmp_path / "random.run"
    wrong.write_bytes((b"SQLite format 3\0" if led else b"") + content)
    for reader in (read_all, verify):
        with pytest.raises(RunFileError):
            reader(wrong)


@QUICK
@given(st.data())
def test_flipped_bytes_are_found_or_harmless(tmp_path: Path, short: Path, data: Any) -> None:
    content = bytearray(short.read_bytes())
    where = st.one_of(st.integers(0, 200), st.integers(0, len(content) - 1))
    for at in data.draw(st.lists(where, min_size=1, max_size=8)):
        content[at] ^= data.draw(st.integers(1, 255))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content))) :]
    wrong = tmp_path / "flipped.run"
    wrong.write_bytes(content)
    try:
        sound = verify(wrong).ok
    except RunFileError:
        sound = False
    try:
        read_all(wrong)
    except RunFileError:
        assert not sound  # what cannot be read is not called sound
        return
    # What can be read in full is what was written.
    good, found = (list(open_run(p).events()) for p in (short, wrong))
    assert list(map(repr, good)) == list(map(repr, found))


def test_replaced_and_lost_rows_are_found(tmp_path: Path, path: Path) -> None:
    for n, (change, said) in enumerate(
        (
            ("DELETE FROM event WHERE id = 50", "event 50 is missing"),
            ("UPDATE event SET sha256 = zeroblob(32) WHERE id = 50", "checksum"),
            ("UPDATE event SET chain = zeroblob(32) WHERE id = 50", "does not follow"),
            ("UPDATE event SET body = replace(body, '1', '2') WHERE id = 50", "checksum"),
        )
    ):
        wrong = Path(shutil.copyfile(path, tmp_path / f"{n}.run"))
        write(wrong, change)
        with pytest.raises(RunFileError, match=said):
            read_all(wrong)
        assert any(said.split()[-1] in problem for problem in verify(wrong).problems)


def test_a_flipped_byte_that_makes_bytes_a_text_is_damage() -> None:
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.execute(f"CREATE TABLE event(id, {COLUMNS.removeprefix('id, ')}, chain)")
        row = (1, "samples", "{}", "text", b"", b"", bytes(32), bytes(32))
        connection.execute(f"INSERT INTO event VALUES ({', '.join('?' * len(row))})", row)
        connection.execute("PRAGMA user_version = 2")
        ((_, _, fault),) = judged_rows(connection)
    assert fault == "event 1 is damaged: its checksum is wrong"


def test_only_complete_stations_are_in_a_recording() -> None:
    channels = {"cell": (Channel("force", "N", "force"),)}
    time_s = np.array([0.1, 0.2])
    block = Block(time_s, time_s[:, None], time_s[:, None] > 1)
    events: list[Event] = [
        RunStarted(0.0, "", {"face_mm2": 100}, channels),
        StationStarted(0.0, 0, 1, 0.0, 0.0),
        Samples("cell", block, 0, 1),
        StationEnded(0.3, 0, 1, complete=False),
        StationStarted(0.3, 0, 2, 0.0, 0.0),
        PhaseEntered(0.35, Phase.HOLDING, 0),
        Samples("cell", Block(time_s + 0.3, time_s[:, None], time_s[:, None] > 1), 0, 2),
        StationEnded(0.6, 0, 2, complete=True),
        StationStarted(0.6, 1, 1, 0.0, 0.0),
        Samples("cell", Block(time_s + 0.6, time_s[:, None], time_s[:, None] > 1), 1, 1),
        RunEnded(0.9, Finish.ABORTED, ""),
    ]
    recording = record(events)
    assert recording.finish == "aborted"
    assert [s.index for s in recording.stations] == [0]
    assert recording.stations[0].time_s == pytest.approx([0.4, 0.5])
    assert recording.stations[0].hold_s == 0.35
