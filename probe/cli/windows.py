"""Whether windows can open here; asked before a scan with ``--live`` moves anything."""

import os
import sys

from drivers import ConfigError

LIBRARIES = "libegl1 libgl1 libxkbcommon0 libdbus-1-3 libfontconfig1 libglib2.0-0 libxcb-cursor0"
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")


def need_windows() -> None:
    """Raises `ConfigError` without a screen (Qt would abort the process) or without Qt."""
    if sys.platform == "linux" and not any(os.environ.get(name) for name in SCREENS):
        raise ConfigError("no screen: DISPLAY and WAYLAND_DISPLAY are not set; run it on a desktop")
    try:
        from PySide6 import QtWidgets as _QtWidgets  # noqa: F401 - can it be loaded?
    except ImportError as error:
        raise ConfigError(f"Qt does not start: {error}; apt install {LIBRARIES}") from None
