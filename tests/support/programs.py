"""`palpate`, and Python, as programs of their own."""

import subprocess
import sys
from pathlib import Path
from typing import Any

PALPATE = (sys.executable, "-m", "probe.cli")


def begun(*words: str | Path, **how: Any) -> subprocess.Popen[str]:
    """`palpate`, with pipes for what it says."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*PALPATE, *map(str, words)], **pipes, **how)


def ended(*words: str | Path, **how: Any) -> subprocess.CompletedProcess[str]:
    """`palpate`, with all that it said."""
    return python("-m", "probe.cli", *words, **how)


def python(
    *words: str | Path, status: int | None = None, **how: Any
) -> subprocess.CompletedProcess[str]:
    """With all that it said; it is to end with ``status``."""
    how = {"capture_output": True, "text": True, "check": False, "timeout": 280} | how
    done = subprocess.run([sys.executable, *map(str, words)], **how)
    assert status in (None, done.returncode), (done.returncode, done.stdout, done.stderr)
    return done
