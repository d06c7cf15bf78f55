"""What turns raw numbers into true ones.

Each ``fit_*`` is a pure function on arrays that returns a small frozen result; its methods apply
it. `fit` has the least squares and the intervals that they share. `record`/`save`/`use` keep it in
a file. Degenerate data raise `CalibrationError`.

Every command reads rigs, and rigs name calibrations; so the parts of SciPy that take as long to
import as a scan to store (interpolate, optimize, signal) are imported inside the fits.
"""

from calibration.axes import AxesCalibration, fit_axes
from calibration.compliance import ComplianceCalibration, fit_compliance
from calibration.errors import CalibrationError
from calibration.fit import Fit
from calibration.force import ForceCalibration, fit_force, hysteresis
from calibration.gravity import GravityCalibration, fit_gravity
from calibration.heart import HeartCalibration, fit_heart
from calibration.latency import LatencyCalibration, fit_latency
from calibration.store import Calibration, Record, load, record, restore, save, use, worse_than
from calibration.surface import SurfaceCalibration, fit_surface
from calibration.tare import TareCalibration, fit_tare
from calibration.taxels import TaxelCalibration, fit_taxels
from calibration.tissue import TissueCalibration, fit_tissue
from calibration.tool import ToolCalibration, fit_tool

__all__ = [
    "AxesCalibration",
    "Calibration",
    "CalibrationError",
    "ComplianceCalibration",
    "Fit",
    "ForceCalibration",
    "GravityCalibration",
    "HeartCalibration",
    "LatencyCalibration",
    "Record",
    "SurfaceCalibration",
    "TareCalibration",
    "TaxelCalibration",
    "TissueCalibration",
    "ToolCalibration",
    "fit_axes",
    "fit_compliance",
    "fit_force",
    "fit_gravity",
    "fit_heart",
    "fit_latency",
    "fit_surface",
    "fit_tare",
    "fit_taxels",
    "fit_tissue",
    "fit_tool",
    "hysteresis",
    "load",
    "record",
    "restore",
    "save",
    "use",
    "worse_than",
]
