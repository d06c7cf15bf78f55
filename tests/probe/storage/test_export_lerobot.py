"""A run as lerobot's dataset v3.0: its files, their schema, and how rates come together."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from jsonschema import Draft202012Validator
from pyarrow import parquet

from drivers import Block, Channel
from drivers.core.array_layout import taxel_names
from probe.core.errors import RunFileError
from probe.core.events import Finish, RunEnded, RunStarted, Samples, StationEnded, StationStarted
from probe.storage.export import export
from probe.storage.writer import create_store

WHOLE = {"type": "integer", "minimum": 0}
INFO = Draft202012Validator({
    "type": "object",
    "properties": {
        "codebase_version": {"const": "v3.0"},
        "robot_type": {"type": ["string", "null"]},
        **dict.fromkeys(("total_episodes", "total_frames", "total_tasks", "fps"), WHOLE),
        **dict.fromkeys(("chunks_size", "data_files_size_in_mb", "video_files_size_in_mb"), WHOLE),
        "splits": {"type": "object", "additionalProperties": {"pattern": r"^\d+:\d+$"}},
        "data_path": {"const": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"},
        "video_path": {"type": ["string", "null"]},
        "features": {
            "type": "object",
            "propertyNames": {"not": {"pattern": "/"}},
            "required": ["timestamp", "frame_index", "episode_index", "index", "task_index"],
            "additionalProperties": {
                "type": "object",
                "properties": {
                    "dtype": {"enum": ["float32", "int64"]},
                    "shape": {"type": "array", "minItems": 1, "items": {**WHOLE, "minimum": 1}},
                    "names": {"type": ["array", "null"]},
                },
                "required": ["dtype", "shape", "names"],
            },
        },
    },
    "additionalProperties": False,
})  # fmt: skip
INFO_KEYS = INFO.schema["properties"]
"""As huggingface/lerobot describes version 3.0 in docs/source/lerobot-dataset-v3.mdx, and reads it
in src/lerobot/datasets."""

DEAD, LATE = 5, 8
"""Taxels, counted row by row."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An array at 50 Hz, a load cell at 500, a stage at 10: two presses are whole, one is not.

    A calibration has taken out the taxel `DEAD`; the taxel `LATE` is missing in the first press.
    """
    taxels = [Channel(name, "Pa", "taxel") for name in taxel_names(4, 7)]
    taxels[DEAD] = replace(taxels[DEAD], role="other")
    channels = {
        "skin": tuple(taxels),
        "cell": (Channel("force", "N", "force"),),
        "stage": tuple(Channel(axis, "m") for axis in "xyz"),
    }
    path = tmp_path_factory.mktemp("runs")
    with create_store(path / "a.run") as store:
        plan = {"stations": [[n, 5.0 * n, None] for n in range(3)], "columns": ["index"]}
        store(RunStarted(0.0, "2026-01-02T03:04:05+00:00", {"face_mm2": 25.0, "plan": plan},
                         channels))  # fmt: skip
        for n in range(3):
            store(StationStarted(2.0 * n, n, 1, 5e-3 * n, math.nan))
            for device, rate in (("skin", 50), ("cell", 500), ("stage", 10)):
                time_s = 2.0 * n + np.arange(1, rate + 1) / rate
                values = np.repeat(time_s[:, None], len(channels[device]), axis=1)
                if device == "cell":  # to and fro, which a mean over a frame takes out
                    values += np.where(np.arange(rate) % 2, 1.0, -1.0)[:, None]
                if device == "skin" and n == 0:
                    values[:, LATE] = math.nan
                store(Samples(device, Block(time_s, values, np.zeros(values.shape, bool)), n, 1))
            store(StationEnded(2.0 * n + 1.5, n, 1, complete=n < 2))
        store(RunEnded(6.0, Finish.COMPLETED, ""))
    (made,) = export(path / "a.run", "lerobot", path)
    (again,) = export(path / "a.run", "lerobot", path)
    assert made == again == path / "a-lerobot"
    return made


def read(folder: Path) -> tuple[dict[str, Any], pa.Table]:
    info = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
    return info, parquet.read_table(folder / info["data_path"].format(chunk_index=0, file_index=0))


def test_what_it_says_of_itself_is_as_published(folder: Path) -> None:
    info, table = read(folder)
    INFO.validate(info)
    assert info.keys() == INFO_KEYS.keys()
    assert info["total_frames"] == len(table) == 100
    assert (info["total_episodes"], info["fps"], info["splits"]) == (2, 50, {"train": "0:2"})
    assert sorted(info["features"]) == sorted(table.column_names)
    assert info["features"]["observation.tactile.skin"]["shape"] == [4, 7]


def test_columns_are_stored_as_their_features_say(folder: Path) -> None:
    """Of one number a scalar, of a row a list of its length, of a table lists of lists."""
    info, table = read(folder)
    for name, feature in info["features"].items():
        number = pa.from_numpy_dtype(feature["dtype"])
        shape, stored = feature["shape"], table.schema.field(name).type
        if shape == [1]:
            assert stored == number
        elif len(shape) == 1:
            assert stored == pa.list_(number, shape[0])
            assert len(feature["names"]) == shape[0]
        else:
            assert stored == pa.list_(pa.list_(number))
            first = table[name][0].as_py()
            assert [len(first), len(first[0])] == shape
        assert table[name].null_count == 0


def test_frames_count_up_and_are_a_period_apart(folder: Path) -> None:
    info, table = read(folder)
    frames = table.to_pandas()
    assert frames["index"].tolist() == list(range(100))
    assert (frames["task_index"] == 0).all()
    for number, own in frames.groupby("episode_index"):
        assert own["frame_index"].tolist() == list(range(50)), number
        np.testing.assert_allclose(own["timestamp"], own["frame_index"] / info["fps"], atol=1e-4)


def test_other_rates_come_into_a_frame_as_stated(folder: Path) -> None:
    """The readings are their times: a faster device's mean, a slower one's nearest."""
    _, table = read(folder)
    frames = table.to_pandas()
    for number, start_s in ((0, 0.0), (1, 2.0)):
        own = frames[frames["episode_index"] == number]
        time_s = start_s + 0.02 + own["timestamp"].to_numpy()
        force, x = own["observation.cell"], np.stack(list(own["observation.state"]))[:, 0]
        taxel = np.array([frame[3][6] for frame in own["observation.tactile.skin"]])
        np.testing.assert_allclose(taxel, time_s, atol=1e-6)
        np.testing.assert_allclose(force[1:-1], time_s[1:-1], atol=1.1e-3)
        assert np.abs(x - time_s)[5:].max() < 0.05 + 1e-6
        assert len(np.unique(x)) == 10
        action = np.stack(list(own["action"]))
        np.testing.assert_array_equal(action[:-1, 0], x[1:])


def test_episodes_tasks_and_statistics_are_there(folder: Path) -> None:
    info, table = read(folder)
    episodes = pd.read_parquet(folder / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["length"].tolist() == [50, 50]
    assert episodes["dataset_from_index"].tolist() == [0, 50]
    assert episodes["dataset_to_index"].tolist() == [50, 100]
    assert (episodes[["data/chunk_index", "data/file_index"]] == 0).all(axis=None)
    assert episodes["station"].tolist() == [1, 2]
    tasks = pd.read_parquet(folder / "meta/tasks.parquet")
    assert tasks["task_index"].tolist() == [0]
    assert list(episodes["tasks"][0]) == [tasks.iloc[0].name]
    stats = json.loads((folder / "meta/stats.json").read_text(encoding="utf-8"))
    assert stats.keys() == info["features"].keys()
    taxels = np.array(table["observation.tactile.skin"].to_pylist())
    for key in ("min", "max", "mean", "std"):
        found = np.array(stats["observation.tactile.skin"][key])[2:]
        np.testing.assert_allclose(found, getattr(taxels, key)(axis=0)[2:], rtol=1e-5)
    assert stats["timestamp"]["max"] == [0.98]
    assert stats["timestamp"]["count"] == [100]
    first = np.array([list(row) for row in episodes["stats/observation.tactile.skin/max"][0]])
    np.testing.assert_allclose(first, taxels[:50].max(axis=0), rtol=1e-6)


def test_what_was_not_read_is_not_zero(folder: Path) -> None:
    """NaN is in its frames, and in statistics only where no frame has a reading."""
    info, table = read(folder)
    taxels = np.array(table["observation.tactile.skin"].to_pylist()).reshape(2, 50, -1)
    assert set(np.flatnonzero(np.isnan(taxels[0]).all(axis=0))) == {DEAD, LATE}
    assert set(np.flatnonzero(np.isnan(taxels).any(axis=(0, 1)))) == {DEAD, LATE}
    assert np.isfinite(taxels[1, :, LATE]).all()
    stats = json.loads((folder / "meta/stats.json").read_text(encoding="utf-8"))
    for key in ("min", "mean", "std", "q50"):
        found = np.ravel(stats["observation.tactile.skin"][key])
        assert np.flatnonzero(np.isnan(found)).tolist() == [DEAD], key
    assert info["features"]["observation.skin"]["names"] == [f"{taxel_names(4, 7)[DEAD]}_Pa"]


def test_a_run_without_a_whole_press_has_no_episode(tmp_path: Path) -> None:
    with create_store(tmp_path / "a.run") as store:
        plan = {"stations": [[0, 5.0, None]], "columns": ["index"]}
        cell = {"cell": (Channel("force", "N", "force"),)}
        store(RunStarted(0.0, "2026-01-02T03:04:05+00:00", {"plan": plan}, cell))
    with pytest.raises(RunFileError, match="no press is complete"):
        export(tmp_path / "a.run", "lerobot", tmp_path)
