"""What worker processes share."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from threading import Thread
from types import ModuleType


def leave_with_parent() -> None:
    """End this worker when its parent is killed: a pool's workers would wait for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()


@contextmanager
def without_main() -> Iterator[None]:
    """Workers that are started inside do not run the caller's script again.

    A spawned worker imports the script it comes from, since what it shall do may be defined there.
    Ours is not: a script that calls us would only be run again in each worker, from its first line.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
