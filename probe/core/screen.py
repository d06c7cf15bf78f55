"""Whether windows can open here, asked before anything moves.

Qt ends the process where its platform plug-in cannot be loaded, so that is tried in a process of
its own. ``python -m probe.core.screen`` says it by its exit status.
"""

import os
import subprocess
import sys
from importlib.util import find_spec

from drivers.core.extras import missing

LIBRARIES = (
    "libegl1 libgl1 libxkbcommon0 libdbus-1-3 libfontconfig1 libglib2.0-0 fonts-dejavu-core "
    "libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-randr0 "
    "libxcb-render-util0 libxcb-shape0 libxcb-xkb1"
)
"""Debian's packages with what Qt's wheels leave to the system."""
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
SLOW_S = 60.0
OPEN_ONE = "from PySide6.QtWidgets import QApplication; QApplication([])"
LOAD_XCB = (
    "import ctypes, PySide6.QtGui; ctypes.CDLL(PySide6.__path__[0] + '/Qt/lib/libQt6XcbQpa.so.6')"
)


def why_no_windows() -> str | None:
    """One line on why no window can open with the platform that Qt will use, or None."""
    for module in ("PySide6", "pyqtgraph"):
        if find_spec(module) is None:
            return str(missing("live", "a window", module))
    if sys.platform == "linux" and not any(os.environ.get(name) for name in SCREENS):
        return "no screen: DISPLAY and WAYLAND_DISPLAY are not set; run it on a desktop"
    said = _fails(OPEN_ONE)
    if said is None:
        return None
    if (lacking := missing_libraries()) is not None:
        return f"windows cannot open: {lacking}; apt install {LIBRARIES}"
    return f"windows cannot open on this screen: {said}"


def missing_libraries() -> str | None:
    """What keeps Qt from opening windows on any screen of this machine, or None.

    Also where there is no screen now: then the libraries of the X11 plug-in are loaded alone.
    """
    said = _fails(OPEN_ONE, {"QT_QPA_PLATFORM": "offscreen"})
    if said is None and sys.platform == "linux":
        said = _fails(LOAD_XCB)
    return said


def _fails(code: str, environment: dict[str, str] | None = None) -> str | None:
    """The last line that ``code`` said when it failed in a Python of its own, or None."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            timeout=SLOW_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {SLOW_S:g} s"
    if done.returncode == 0:
        return None
    lines = [line.strip() for line in done.stderr.splitlines() if line.strip()]
    telling = [line for line in lines if "could not" in line.lower() or "Error" in line]
    return (telling or lines or [f"exit status {done.returncode}"])[-1]


def main(arguments: list[str]) -> int:
    """The libraries' names with ``--libraries``; else 1 and one line if windows cannot open."""
    if "--libraries" in arguments:
        print(LIBRARIES)
        return 0
    said = missing_libraries()
    if said is not None:
        print(said, file=sys.stderr)
    return int(said is not None)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
