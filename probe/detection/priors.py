"""What is believed of tissue, pressures and rig before a scan is looked at; a file may say more."""

from os import PathLike
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError

from drivers import ConfigError
from drivers.core.files import FileRefused, parse_toml, path_of, read_file
from drivers.core.table import Table
from sim_backend.scene.explain import explain
from sim_backend.scene.scene_file import MAX_FILE_BYTES

Positive = Annotated[float, Field(gt=0)]


def _ascending(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise ValueError(f"the lower end comes first, below the upper one; got {list(ends)}")
    return ends


Range = Annotated[tuple[Positive, Positive], AfterValidator(_ascending)]


class Priors(Table):
    """Ranges, in which every value is as likely, and standard deviations. Of `tissue_kpa` every
    decade is."""

    tissue_kpa: Range = (2.0, 500.0)
    """Young's modulus of the tissue: fat to tight muscle (Wells & Liang 2011, table 1)."""
    diastolic_mmhg: Range = (60.0, 100.0)
    """As a cuff reads it; by default that of most adults (ESC/ESH 2018, table 3, from optimal to
    grade 2)."""
    pulse_pressure_mmhg: Range = (20.0, 62.0)
    """Systolic less diastolic, from the same table."""
    tilt_mm_per_m: Positive = 10.0
    bow_mm: Positive = 0.05
    waves_mm: Positive = 0.03
    height_mm: Positive = 0.05
    """How far a surface is tilted, bent, wavy and off its height from where the rig takes it to be:
    stages and jigs on a bench; a touch before each press leaves less."""
    repeatability_mm: Positive = 0.01
    zero_mn: Positive = 2.0
    """What a stage's depth differs by from press to press, and a sensor's zero is off by."""
    relaxation: Positive = 0.3
    """Share of each depth's force, in all presses alike: relaxing tissue presses back less at each
    step of the ramp (117 curves on meat lose 28 % in 0.8 s)."""


DEFAULT = Priors()


def priors_of(said: Priors | str | PathLike[str] | None) -> Priors:
    """Those of a TOML file, in which what is left out is as by default; `Priors` as they are.
    Raises `ConfigError`, which names the key."""
    if said is None or isinstance(said, Priors):
        return said or DEFAULT
    file = path_of(said, "Priors or the name of their file")
    try:
        return Priors.model_validate(parse_toml(read_file(file, MAX_FILE_BYTES)))
    except ValidationError as error:
        raise ConfigError("\n".join(f"{file}: {line}" for line in explain(error, Priors))) from None
    except FileRefused as error:
        raise ConfigError(f"{error}; not a file of priors") from None
    except ValueError as error:
        raise ConfigError(f"{file}: {error}") from None
