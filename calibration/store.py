"""The calibration file: values with units, covariance, residuals, date, device and raw data.

JSON, one calibration per file. NaN (a dead taxel's gain) is null. A file made for another
device is refused; an old one is used with a warning.
"""

from collections.abc import Mapping
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Self, get_type_hints

import numpy as np
from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
    model_validator,
)

from calibration.axes import AxesCalibration
from calibration.compliance import ComplianceCalibration
from calibration.errors import CalibrationError
from calibration.fit import Array, Fit
from calibration.force import ForceCalibration
from calibration.gravity import GravityCalibration
from calibration.heart import HeartCalibration
from calibration.latency import LatencyCalibration
from calibration.surface import SurfaceCalibration
from calibration.tare import TareCalibration
from calibration.taxels import TaxelCalibration
from calibration.tissue import TissueCalibration
from calibration.tool import ToolCalibration

Calibration = (
    ForceCalibration
    | TaxelCalibration
    | GravityCalibration
    | TareCalibration
    | ToolCalibration
    | AxesCalibration
    | SurfaceCalibration
    | LatencyCalibration
    | ComplianceCalibration
    | TissueCalibration
    | HeartCalibration
)
KINDS: dict[str, type[Calibration]] = {kind.KIND: kind for kind in Calibration.__args__}
VALID_DAYS = {"tare": 0.05, "surface": 1.0, "tissue": 1.0, "heart": 1.0}  # others: 90
MAX_FILE_BYTES = 50_000_000
ROUNDING = 1e-9  # of the estimates: residuals are no less, though a table of few digits may say so
# Lengths that must agree within a file have one letter; values without a shape are one.
SHAPES: dict[str, dict[str, str]] = {
    "force": {"sensitivity": "ca", "offset": "c", "temperature": "c"},
    "taxels": {"gain": "t", "offset": "t", "dead": "t", "ceiling": "t", "floor": "t", "bent": "t"},
    "gravity": {"centre_m": "3", "bias": "6", "gravity_m_s2": "3"},
    "tare": {"bias": "c", "drift": "c"},
    "tool": {"tip_m": "3", "pivot_m": "3"},
    "axes": {"matrix": "33", "shift_m": "3"},
    "surface": {"centre_m": "2", "coefficients": "k", "touches_m": "n3", "rejected_m": "m3"},
    "tissue": {"modulus_pa": "q", "relaxation_g": "p", "relaxation_tau_s": "p"},
    "heart": {"wave_mmhg": "n"},
}


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, ser_json_inf_nan="null")


class Quantity(_Table):
    """A number, a list (of lists) of numbers, or words; ``unit`` as printed."""

    value: Any
    unit: str


class Estimates(_Table):
    """The fit: ``covariance`` (p, p) of ``values`` (p,), in the order of ``names``."""

    names: tuple[str, ...]
    values: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...]
    residuals: tuple[float, ...]
    dof: int

    @model_validator(mode="after")
    def _one_of_each(self) -> Self:
        count = len(self.names)
        if len(self.values) != count or [len(r) for r in self.covariance] != [count] * count:
            raise ValueError(
                f"{count} names need as many values and a covariance of {count} x {count}"
            )
        return self


class Record(_Table):
    """One calibration file."""

    format: Literal[1] = 1
    kind: str
    device: str
    date_utc: AwareDatetime
    valid_days: float = Field(gt=0)
    values: dict[str, Quantity]
    estimates: Estimates
    residual_rms: float
    raw: dict[str, Any]
    note: str = ""


def record(
    result: Calibration,
    device: str,
    raw: Mapping[str, Array],
    *,
    valid_days: float | None = None,
    note: str = "",
    now: datetime | None = None,
) -> Record:
    """Make a calibration ready to be written.

    Parameters
    ----------
    result
        What `calibrate` gave.
    device
        The device's name as in the rig file.
    raw
        Every column that the calibration was computed from, by name: arrays (n,).
    valid_days
        After so many days the calibration counts as too old; None: never.
    note
        Anything a reader should know.
    now
        When it was made; by default now.

    Returns
    -------
    Record
        With the raw data, their check sum and the date.

    Examples
    --------
    >>> import numpy as np
    >>> import palpate
    >>> fitted = palpate.calibrate("force", "loads.csv")
    >>> table = np.genfromtxt("loads.csv", delimiter=",", names=True)
    >>> columns = {name: table[name] for name in table.dtype.names}
    >>> palpate.record(fitted, "cell", columns, note="weights of 2025").kind
    'force'
    """
    fit = result.fit
    return Record(
        kind=result.KIND,
        device=device,
        date_utc=now or datetime.now(UTC),
        valid_days=valid_days or VALID_DAYS.get(result.KIND, 90.0),
        values={
            name: Quantity(value=_plain(getattr(result, name)), unit=unit)
            for name, unit in result.UNITS.items()
        },
        estimates=Estimates(
            names=fit.names,
            values=tuple(fit.values.tolist()),
            covariance=tuple(map(tuple, fit.covariance.tolist())),
            residuals=tuple(fit.residuals.tolist()),
            dof=fit.dof,
        ),
        residual_rms=fit.rms,
        raw={name: _plain(np.asarray(column)) for name, column in raw.items()},
        note=note,
    )


def save(one: Record, path: str | PathLike[str]) -> None:
    """Write a calibration file, whole or not at all.

    Parameters
    ----------
    one
        What `record` gave.
    path
        The file; a rig's `calibration` table names it.

    Raises
    ------
    CalibrationError
        The folder is not there.

    Examples
    --------
    >>> import palpate
    >>> fitted = palpate.calibrate("force", "loads.csv")
    >>> palpate.save(palpate.record(fitted, "cell", {}), "force-cell.json")
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise CalibrationError(f"{path}: there is no folder {path.parent}")
    draft = path.with_suffix(path.suffix + ".part")
    try:
        draft.write_text(one.model_dump_json(indent=1) + "\n", encoding="utf-8")
        draft.replace(path)
    except OSError as error:  # of a name that nobody gave
        error.filename = str(path)
        raise


def load(path: str | PathLike[str]) -> Record:
    """Read a calibration file. Raises `CalibrationError` naming file and key."""
    path = Path(path)
    if not path.is_file():
        raise CalibrationError(f"{path}: no such file")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise CalibrationError(f"{path}: larger than {MAX_FILE_BYTES} bytes; not a calibration")
    try:
        one = Record.model_validate_json(path.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        where = f"{path}: {key}" if key else str(path)
        raise CalibrationError(f"{where}: {first['msg']}; not a calibration file") from None
    if one.kind not in KINDS:
        raise CalibrationError(f"{path}: kind = {one.kind!r}: known are {', '.join(KINDS)}")
    return one


def restore(one: Record, source: str = "calibration") -> Calibration:
    """The calibration a record holds, ready to be applied. Raises `CalibrationError`."""
    kind, e = KINDS[one.kind], one.estimates
    added = [name for name in getattr(kind, "ADDED", ()) if name not in one.values]
    if missing := [name for name in kind.UNITS if name not in (*one.values, *added)]:
        raise CalibrationError(f"{source}: values lack {', '.join(missing)}")
    hints, shapes = get_type_hints(kind), SHAPES.get(one.kind, {})
    values: dict[str, Any] = {}
    lengths: dict[str, int] = {}
    for name in (name for name in kind.UNITS if name not in added):
        written = one.values[name].value
        try:
            if name in shapes:
                values[name] = _array(written, shapes[name], lengths)
            else:
                values[name] = TypeAdapter(hints[name]).validate_python(written)
            if one.kind != "taxels" and (
                name in shapes or hints[name] is float
            ):  # dead taxels are NaN
                np.asarray_chkfinite(values[name])
        except (ValueError, TypeError, OverflowError):
            shown = repr(written)
            shown = shown if len(shown) <= 60 else shown[:57] + "..."
            raise CalibrationError(
                f"{source}: values.{name} = {shown} cannot be one of a calibration of {one.kind}; "
                "calibrate again, or restore the file"
            ) from None
    for name in added:  # by a later version
        values[name] = np.full(lengths[shapes[name]], np.nan) if name in shapes else np.nan
    fit = Fit(e.names, np.array(e.values), np.array(e.covariance), np.array(e.residuals), e.dof)
    return kind(**values, fit=fit)


def use(
    path: str | PathLike[str], device: str, *, now: datetime | None = None
) -> tuple[Calibration, tuple[str, ...]]:
    """The calibration in ``path`` for ``device``, and warnings (stale).

    Raises `CalibrationError` when the file belongs to another device.
    """
    one = load(path)
    if one.device != device:
        raise CalibrationError(
            f"{path}: made for {one.device!r}, not for {device!r}; calibrate this device or give "
            "its own file"
        )
    days = ((now or datetime.now(UTC)) - one.date_utc).total_seconds() / 86400
    warnings = []
    if days > one.valid_days:
        warnings.append(
            f"{path}: {one.kind} calibration is {days:.1f} days old; it was meant to last "
            f"{one.valid_days:g} days: calibrate again"
        )
    if days < -1:
        warnings.append(f"{path}: dated {one.date_utc:%Y-%m-%d}, in the future: check the clock")
    return restore(one, str(path)), tuple(warnings)


def worse_than(one: Record, residuals: Array) -> str | None:
    """A warning if new ``residuals`` (n,) are larger than the calibration's allow.

    An F test of the variances at the 0.1 % level, for new readings at loads like the old ones:
    they also miss by the estimates' own errors. Residuals of several channels are judged together,
    so all their degrees of freedom count, not those of one.
    """
    from scipy.special import fdtri

    kept = len(one.estimates.residuals)
    dof = max(one.estimates.dof, kept - len(one.estimates.values))
    old = one.residual_rms**2 * kept / dof * (1 + (kept - dof) / kept)
    old = max(old, (ROUNDING * float(np.abs(one.estimates.values).max(initial=0.0))) ** 2, 1e-300)
    new = float(np.mean(np.square(residuals)))
    if new <= old * fdtri(len(residuals), dof, 0.999):
        return None
    return (
        f"{one.kind} calibration of {one.device}: readings now miss it by {np.sqrt(new):.3g} rms, "
        f"{np.sqrt(new / old):.1f} times what its residuals allow: calibrate again"
    )


def _plain(value: Any) -> Any:
    """JSON-able, NaN and infinity as None."""
    if isinstance(value, np.ndarray | tuple | list):
        return [
            _plain(part) for part in (value.tolist() if isinstance(value, np.ndarray) else value)
        ]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value


def _array(written: Any, shape: str, lengths: dict[str, int]) -> Array:
    """``written`` in the shape that letters and digits say. Raises `ValueError`, `TypeError`."""
    array = np.array(written, dtype=float)
    if array.size == 0 and len(shape) > 1:
        array = array.reshape(0, *(int(n) for n in shape[1:]))
    wanted = tuple(int(n) if n.isdigit() else n for n in shape)
    if array.ndim != len(wanted) or any(
        (lengths.setdefault(n, length) if isinstance(n, str) else n) != length
        for n, length in zip(wanted, array.shape, strict=True)
    ):
        raise ValueError(f"shape {array.shape}")
    return array
