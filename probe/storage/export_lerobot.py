"""A run as a dataset of lerobot (version 3.0), for learning from touch: a press is an episode.

Its format has one rate: that of the device that feels, rounded to a whole number of frames a
second. Others come into a frame as `probe.storage.frames.framed` says. An array of taxels is a
feature of its own (rows, columns); the stage's pose is the state, and the next frame's the action.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers.core.arrays import Array, Ints
from drivers.core.extras import require
from probe.core.contact_stress import tactile_device
from probe.core.errors import RunFileError
from probe.storage.distinct_names import distinct
from probe.storage.frames import frame_rate, frame_times, framed
from probe.storage.taxel_arrays import TAXELS

if TYPE_CHECKING:
    import pandas as pd

    from probe.storage.run import Run

VERSION = "v3.0"
FILE = "chunk-000/file-000.parquet"
TASK = "Press the probe into the tissue, hold it, and lift."
OWN = ("timestamp", "frame_index", "episode_index", "index", "task_index")
"""What every frame has beside its features, each a scalar."""
STATE = "observation.state"
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
Feature = dict[str, Any]
Frames = dict[str, Any]
"""By feature (n, ...): floats, and whole numbers of `OWN`."""


def write(run: "Run", folder: Path, about: str) -> None:
    """Write the whole run, with what is said ``about`` it as JSON in ``meta/palpate.json``.

    Raises `RunFileError` for a run without a complete press.
    """
    require("pyarrow", "export", "lerobot's dataset")
    table = run.stations()
    presses = table[table["complete"]]
    if not len(presses):
        raise RunFileError(f"{run.path}: no press is complete, so there is no episode")
    features, rate, episodes = _episodes(run, presses)
    lengths = [len(next(iter(frames.values()))) for frames in episodes]
    ends = np.cumsum(lengths)
    for number, (frames, length, end) in enumerate(zip(episodes, lengths, ends, strict=True)):
        frames["timestamp"] = np.arange(length) / rate
        frames["frame_index"] = np.arange(length)
        frames["episode_index"] = np.full(length, number)
        frames["index"] = np.arange(end - length, end)
        frames["task_index"] = np.zeros(length, int)
    whole = {name: np.concatenate([frames[name] for frames in episodes]) for name in features}
    for part in ("data/chunk-000", "meta/episodes/chunk-000"):
        (folder / part).mkdir(parents=True)
    _write_table(folder / "data" / FILE, whole, features)
    _write_episodes(folder / "meta/episodes" / FILE, presses, episodes, features, ends, lengths)
    _write_tasks(folder / "meta/tasks.parquet")
    stats = {name: _stats(whole[name]) for name in features}
    _write_json(folder / "meta/stats.json", stats)
    _write_json(folder / "meta/info.json", {
        "codebase_version": VERSION, "robot_type": None, "total_episodes": len(episodes),
        "total_frames": int(ends[-1]), "total_tasks": 1, "chunks_size": 1000,
        "data_files_size_in_mb": 100, "video_files_size_in_mb": 200, "fps": rate,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None, "features": features,
    })  # fmt: skip
    (folder / "meta/palpate.json").write_text(about + "\n", encoding="utf-8")


def _episodes(run: "Run", presses: "pd.DataFrame") -> tuple[dict[str, Feature], int, list[Frames]]:
    """The features, frames a second, and by feature the frames (n, ...) of each press."""
    data = {device: run.samples(device) for device in run.channels}
    lead = data[tactile_device(run.channels)]
    rate = frame_rate(lead["time_s"].to_numpy())
    names = _feature_names(run)
    features: dict[str, Feature] = {}
    episodes: list[Frames] = []
    for number, attempt in zip(presses["station"], presses["attempt"], strict=True):
        times = frame_times(_pressed(lead, number, attempt)["time_s"].to_numpy(), rate)
        frames: Frames = {}
        for device, samples in data.items():
            near = samples.sel(time_s=slice(times[0] - 1.0, times[-1] + 1.0))
            for name, (values, own) in _readings(near, names[device]).items():
                features[name] = own
                frames[name] = framed(near["time_s"].to_numpy(), values, times, rate)
        if STATE in frames:
            features["action"] = features[STATE]
            frames["action"] = np.concatenate([frames[STATE][1:], frames[STATE][-1:]])
        episodes.append(frames)
    features |= {
        name: {"dtype": "float32" if name == "timestamp" else "int64", "shape": [1], "names": None}
        for name in OWN
    }
    return features, rate, episodes


def _feature_names(run: "Run") -> dict[str, str]:
    """What the channels of each device are called: those of the stage are the state."""
    plain = {device: device.replace("/", "_").replace(".", "_") for device in run.channels}
    return {
        device: STATE if device == "stage" else f"observation.{name}"
        for device, name in distinct(plain, ("state", "tactile")).items()
    }


def _pressed(samples: Any, number: int, attempt: int) -> Any:
    mine = (samples["station"] == number) & (samples["attempt"] == attempt)
    return samples.isel(time_s=mine.to_numpy())


def _readings(samples: Any, name: str) -> Mapping[str, tuple[Array, Feature]]:
    """By feature the values (n, ...) and what it is: an array of taxels, and the other channels
    together."""
    found: dict[str, tuple[Array, Feature]] = {}
    if TAXELS in samples and samples[TAXELS].ndim == 3:
        values = samples[TAXELS].to_numpy()
        shape = list(values.shape[1:])
        own = f"observation.tactile.{name.rpartition('.')[2]}"
        found[own] = values, {"dtype": "float32", "shape": shape, "names": ["row", "column"]}
    channels = [
        (str(key), one) for key, one in samples.data_vars.items()
        if "role" in one.attrs and one.ndim == 1
    ]  # fmt: skip
    if channels:
        values = np.stack([one.to_numpy() for _, one in channels], axis=1)
        said = [f"{key}_{one.attrs['units']}".removesuffix("_") for key, one in channels]
        one = {"dtype": "float32", "shape": [len(said)], "names": said}
        found[name] = values if len(said) > 1 else values[:, 0], one
    return found


def _write_table(path: Path, whole: Frames, features: Mapping[str, Feature]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    columns = {name: _column(whole[name], feature) for name, feature in features.items()}
    with path.open("wb") as file:  # pyarrow takes no name that is not UTF-8
        parquet.write_table(pa.table(columns), file)


def _column(values: Array, feature: Feature) -> Any:
    """A scalar, a list of a fixed length, or a list of lists, as the format stores 1 or 2 axes."""
    import pyarrow as pa

    kind = pa.from_numpy_dtype(np.dtype(feature["dtype"]))
    if values.ndim == 2:
        kind = pa.list_(kind, values.shape[1])
    elif values.ndim == 3:
        kind = pa.list_(pa.list_(kind))
    return pa.array(values.tolist(), kind)


def _write_episodes(
    path: Path, presses: "pd.DataFrame", episodes: Sequence[Frames],
    features: Mapping[str, Feature], ends: Ints, lengths: Sequence[int],
) -> None:  # fmt: skip
    import pyarrow as pa
    from pyarrow import parquet

    rows = []
    places = presses.to_dict("records")
    for number, (frames, place) in enumerate(zip(episodes, places, strict=True)):
        row = {
            "episode_index": number, "tasks": [TASK], "length": lengths[number],
            "data/chunk_index": 0, "data/file_index": 0,
            "dataset_from_index": int(ends[number]) - lengths[number],
            "dataset_to_index": int(ends[number]),
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
        }  # fmt: skip
        for name in features:
            row |= {f"stats/{name}/{key}": one for key, one in _stats(frames[name]).items()}
        row |= {key: place[key] for key in ("station", "attempt", "x_mm", "y_mm")}
        rows.append(row)
    with path.open("wb") as file:
        parquet.write_table(pa.Table.from_pylist(rows), file)


def _write_tasks(path: Path) -> None:
    import pandas as pd

    with path.open("wb") as file:
        pd.DataFrame({"task_index": [0]}, index=pd.Index([TASK], name="task")).to_parquet(file)


def _stats(values: Array) -> dict[str, Any]:
    """Over the frames in which something was read; of a scalar a list of one."""
    import pandas as pd

    frames = pd.DataFrame(values.reshape(len(values), -1))
    found = {key: getattr(frames, key)() for key in ("min", "max", "mean")}
    found |= {"std": frames.std(ddof=0)}
    found |= {key: frames.quantile(q) for key, q in QUANTILES.items()}
    shape = values.shape[1:] or (1,)
    each = {key: column.to_numpy().reshape(shape).tolist() for key, column in found.items()}
    return each | {"count": [len(values)]}


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")
