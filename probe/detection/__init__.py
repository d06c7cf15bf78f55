"""Detection: what lies beneath a scan, real or simulated."""

from probe.detection.compare import compare
from probe.detection.finding import Comparison, Finding, ObjectFinding, StationFinding
from probe.detection.scan import detect
from probe.detection.unlike_empty import Unlike, unlike_empty

__all__ = [
    "Comparison",
    "Finding",
    "ObjectFinding",
    "StationFinding",
    "Unlike",
    "compare",
    "detect",
    "unlike_empty",
]
