"""A picture that may fail without taking the others of its window."""

import logging
from collections.abc import Callable

from PySide6.QtWidgets import QStackedWidget, QWidget

from probe.gui.style import text

LOG = logging.getLogger(__name__)


class Picture(QStackedWidget):
    """Shows ``widget``, or in its place why ``name`` cannot be drawn."""

    def __init__(self, name: str, widget: QWidget) -> None:
        super().__init__()
        self._name, self._widget = name, widget
        self.why = text(look="empty", centred=True)
        self.addWidget(widget)
        self.addWidget(self.why)

    def draw(self, how: Callable[[], object]) -> None:
        """Draw by ``how``; what it raises is said here, and logged once."""
        try:
            how()
        except Exception as error:
            words = f"The {self._name} cannot be drawn: {type(error).__name__}: {error}"
            if words != self.why.text():
                LOG.warning(words, exc_info=True)
            self.why.setText(words)
            self.setCurrentWidget(self.why)
        else:
            self.setCurrentWidget(self._widget)
