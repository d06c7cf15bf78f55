"""What SQLite's write-ahead log (``RUN-wal``) has lost.

SQLite reads a log up to its first frame whose checksum is wrong and says nothing of those behind
it. After `kill -9` these frames are events that were committed: `unreadable_frames` counts them.
The format is that of https://www.sqlite.org/fileformat2.html#the_write_ahead_log.
"""

import struct
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HEADER, FRAME_HEADER = 32, 24
MAGIC = {0x377F0682: "<u4", 0x377F0683: ">u4"}  # and the byte order of the checksums
MAX_PAGE = 65536


def unreadable_frames(log: Path) -> int:
    """How many frames of the log's present generation SQLite does not read; 0 if all is well.

    Frames of a transaction that was never committed (a full disk, `kill -9` while it was written)
    may lie behind the last good one and count only with a commit among them. A log whose end was
    cut off does not show.
    """
    with log.open("rb") as file:
        head = file.read(HEADER)
        if not head.strip(b"\0"):
            return 0
        magic, _, page_size = struct.unpack(">3I", head[:12]) if len(head) == HEADER else (0, 0, 0)
        size = FRAME_HEADER + page_size
        if magic not in MAGIC or not 512 <= page_size <= MAX_PAGE or page_size.bit_count() != 1:
            return 1
        order = MAGIC[magic]
        total = _sum(head[:24], (0, 0), order)
        broken = 0 if total == struct.unpack(">2I", head[24:]) else 1
        salt, committed = head[16:24], False
        while frame := file.read(size):
            found = frame[8:16]
            if not broken and found == salt:
                total = _sum(frame[:8] + frame[FRAME_HEADER:], total, order)
                if len(frame) < size or total != struct.unpack(">2I", frame[16:24]):
                    broken = 1
            elif found == salt or found[:4] == salt[:4] or found[4:] == salt[4:]:
                broken += 1  # of this generation, behind a frame that is damaged or was skipped
            else:
                continue
            committed |= bool(broken) and len(frame) == size and frame[4:8] != bytes(4)
        return broken if committed else 0


def _sum(data: bytes, total: tuple[int, int], order: str) -> tuple[int, int]:
    """SQLite's checksum of words a, b, a, b …, mod 2^32: s += a + t, then t += b + s.

    As a sum: (s, t) after n pairs is A^n (s, t) + sum over k of A^(n-1-k) (a_k, a_k + b_k).
    """
    pairs = np.frombuffer(data[: len(data) // 8 * 8], order).astype(np.uint32).reshape(-1, 2)
    powers = _powers(len(pairs))
    added = np.stack([pairs[:, 0], pairs[:, 0] + pairs[:, 1]], axis=1)
    own = (powers[:-1][::-1] * added[:, None, :]).sum(axis=(0, 2), dtype=np.uint32)
    before = (powers[-1] * np.array(total, np.uint32)).sum(axis=1, dtype=np.uint32)
    s, t = (own + before).tolist()
    return s, t


@lru_cache(maxsize=4)
def _powers(n: int) -> NDArray[np.uint32]:
    """A = [[1, 1], [1, 2]] to the powers 0 to n (n + 1, 2, 2), mod 2^32."""
    powers = [np.eye(2, dtype=np.uint32)]
    for _ in range(n):
        powers.append(powers[-1] @ np.array([[1, 1], [1, 2]], np.uint32))
    return np.array(powers)
