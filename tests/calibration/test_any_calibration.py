"""Calibration files come from others: whatever is in one, it is used or refused with a reason."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration import fit_axes, fit_force, fit_surface, load, record, save, use
from calibration.errors import CalibrationError

RNG = np.random.default_rng(1)
POINTS = RNG.uniform(0, 0.05, (12, 3))
NOISE = 1e-6 * RNG.standard_normal((12, 3))
GOOD = {
    "force": fit_force(POINTS @ np.diag([100.0, 90.0, 110.0]) + NOISE, POINTS),
    "axes": fit_axes(POINTS, 1.01 * POINTS + NOISE),
    "surface": fit_surface(POINTS * [1, 1, 0] + NOISE),
}
ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=6,
)
ANY_FILE = settings(
    deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def written(folder: Path, kind: str) -> tuple[Path, dict[str, Any]]:
    path = folder / f"{kind}.json"
    now = datetime(2030, 1, 1, tzinfo=UTC)
    save(record(GOOD[kind], "cell", {"raw": POINTS[:, 0]}, now=now), path)
    return path, json.loads(path.read_text())


@pytest.mark.parametrize("kind", GOOD)
def test_what_was_written_is_read(tmp_path: Path, kind: str) -> None:
    path, _ = written(tmp_path, kind)
    found, _ = use(path, "cell")
    for name in found.UNITS:
        assert np.array_equal(getattr(found, name), getattr(GOOD[kind], name))


def test_a_name_may_be_text_as_everywhere_else(tmp_path: Path) -> None:
    name = str(tmp_path / "f.json")
    save(record(GOOD["force"], "cell", {}), name)
    assert load(name) == load(Path(name))
    assert use(name, "cell")[0].KIND == "force"


def test_a_file_that_is_no_json_is_named_with_one_colon(tmp_path: Path) -> None:
    file = tmp_path / "f.json"
    file.write_text("[stage]\n")
    with pytest.raises(CalibrationError, match=r"f\.json: Invalid JSON: expected .*; not a calib"):
        load(file)


@ANY_FILE
@given(st.binary(max_size=300))
def test_no_bytes_break_the_reader(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "any.json"
    path.write_bytes(content)
    with pytest.raises(CalibrationError, match=r"any\.json"):
        use(path, "cell")


@ANY_FILE
@given(st.sampled_from(list(GOOD)), st.data())
def test_nor_does_a_wrong_value(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    """One key of a good file replaced: refused by name, or every number of it is finite."""
    path, table = written(tmp_path, kind)
    places = [table, table["values"], table["estimates"], *table["values"].values()]
    place = data.draw(st.sampled_from(places))
    place[data.draw(st.sampled_from(list(place)))] = data.draw(ANYTHING)
    path.write_text(json.dumps(table))
    try:
        found, _ = use(path, "cell")
    except CalibrationError as error:
        assert path.name in str(error)
        return
    for name in found.UNITS:
        value = getattr(found, name)
        assert isinstance(value, str) or np.isfinite(value).all()


@pytest.mark.parametrize("covariance", [[], [[1.0], []], [[1.0, 2.0]]])
def test_a_covariance_of_another_shape_is_refused(tmp_path: Path, covariance: object) -> None:
    """Rows of unequal length were a mistake in palpate itself."""
    path, table = written(tmp_path, "force")
    table["estimates"]["covariance"] = covariance
    path.write_text(json.dumps(table))
    with pytest.raises(CalibrationError, match=r"estimates: .* covariance of"):
        use(path, "cell")


@pytest.mark.parametrize(
    ("name", "value"),
    [("offset", None), ("offset", [1.0]), ("sensitivity", [[1.0], [2.0, 3.0]]), ("linearity", "a")],
)
def test_a_wrong_value_is_named(tmp_path: Path, name: str, value: object) -> None:
    path, table = written(tmp_path, "force")
    table["values"][name]["value"] = value
    path.write_text(json.dumps(table))
    with pytest.raises(CalibrationError, match=rf"force\.json: values\.{name} = "):
        use(path, "cell")
