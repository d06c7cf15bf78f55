"""Detection: what lies beneath a scan, real or simulated."""

from probe.detect.compare import compare
from probe.detect.finding import Comparison, Finding, ObjectFinding, StationFinding
from probe.detect.scan import detect

__all__ = ["Comparison", "Finding", "ObjectFinding", "StationFinding", "compare", "detect"]
