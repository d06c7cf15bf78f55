"""A sensor that samples while a test looks at it."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

from drivers import Sensor

AnySensor = TypeVar("AnySensor", bound=Sensor)


@contextmanager
def running(sensor: AnySensor) -> Iterator[AnySensor]:
    """Connected and started within, closed at the end."""
    try:
        sensor.connect()
        sensor.start()
        yield sensor
    finally:
        sensor.close()
