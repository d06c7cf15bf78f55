"""The page of all files says what their docstrings say."""

import subprocess
import sys

from paths import ROOT


def test_the_page_is_that_of_the_files() -> None:
    page = ROOT / "docs" / "reference" / "files.md"
    printed = subprocess.run(
        [sys.executable, ROOT / "docs" / "files.py", "--print"],
        capture_output=True, text=True, encoding="utf-8", check=True,
    ).stdout  # fmt: skip
    assert page.read_text(encoding="utf-8") == printed, "run: python docs/files.py"
