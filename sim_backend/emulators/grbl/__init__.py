"""An emulated GRBL board: `machine` moves the phantom's tip, `board` speaks GRBL 1.1."""

from sim_backend.emulators.grbl.board import BANNER, GrblBoard, emulate
from sim_backend.emulators.grbl.machine import ORIGIN_MM, SETTINGS

__all__ = ["BANNER", "ORIGIN_MM", "SETTINGS", "GrblBoard", "emulate"]
