"""What worker processes share."""

import os
from multiprocessing import parent_process
from threading import Thread


def leave_with_parent() -> None:
    """End this worker when its parent is killed: a pool's workers would wait for ever."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()
