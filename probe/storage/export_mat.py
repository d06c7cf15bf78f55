"""A run as a MATLAB file (version 5): a struct for each device, one of stations, the configuration.

An array of taxels is time x row x column. ``phase`` counts from 1, into ``phase_names``.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from probe.core.contact_stress import tactile_or_none
from probe.core.errors import RunFileError
from probe.storage.distinct_names import distinct

if TYPE_CHECKING:
    import xarray as xr

    from probe.storage.run import Run

OURS = ("stations", "config", "started_utc", "simulated", "tactile", "finish")
LONGEST = 60
"""Letters of a name: MATLAB takes 63, and a number may be added."""


def write(run: "Run", path: Path, about: str) -> None:
    """Write the whole run, with what is said ``about`` it as JSON.

    Raises `RunFileError` for a device with more than MATLAB's version 5 holds.
    """
    from scipy.io import savemat
    from scipy.io.matlab import MatWriteError

    table = run.stations()
    names = distinct({device: identifier(device) for device in run.channels}, OURS)
    held: dict[str, Any] = {
        "config": about,
        "started_utc": run.started.started_utc,
        "finish": str(run.finish or ""),
        "simulated": np.array(run.simulated, dtype=object),
        "tactile": names.get(tactile_or_none(run.channels) or "", ""),
        "stations": {str(name): _column(table[name].to_numpy()) for name in table},
    }
    for device, name in names.items():
        held[name] = _struct(run.samples(device))
    try:
        savemat(path, held, do_compression=True, long_field_names=True, oned_as="column")
    except MatWriteError as error:
        raise RunFileError(
            f"{path.name}: {error}; export to hdf5, which MATLAB reads by h5read"
        ) from None


def identifier(name: str) -> str:
    """A name as MATLAB takes it: letters of ASCII, digits and _, a letter first."""
    plain = "".join(c if c.isascii() and c.isalnum() else "_" for c in name)[:LONGEST]
    return plain if plain[:1].isalpha() else f"x{plain}"


def _struct(data: "xr.Dataset") -> Mapping[str, Any]:
    variables = {str(name): variable for name, variable in data.variables.items()}
    fields = distinct({name: identifier(name) for name in variables}, ("phase_names", "units"))
    found: dict[str, Any] = {"units": {}}
    for name, variable in variables.items():
        if name == "phase":
            words, number = np.unique(variable.to_numpy().astype(str), return_inverse=True)
            found["phase_names"] = np.array(words, dtype=object)
            found[fields[name]] = number.astype(np.uint8) + 1
        else:
            found[fields[name]] = variable.to_numpy()
        if unit := variable.attrs.get("units"):
            found["units"][fields[name]] = str(unit)
    return found


def _column(values: Any) -> Any:
    """Words as a cell array."""
    return values.astype(object) if values.dtype.kind in "OUT" else values
