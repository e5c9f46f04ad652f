"""One writer to a run: a lock that the operating system takes back when its process ends, however it ends.

The number of a process says nothing on another machine or in another container; a lock on the shared disk does.
"""

import errno
import os
import socket
import sys
from contextlib import suppress
from pathlib import Path
from typing import IO

from verify.runs.atomic import WriteError, writing

#: what a disk answers that cannot lock: nothing is to be known there of other writers
NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)


class WriterLock:
    """Held from `take` to `release` by one writer; others are refused."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: IO[str] | None = None

    def take(self) -> None:
        """Raises WriteError where another writer is at work, with its machine and process."""
        with writing(self._path):
            self._path.parent.mkdir(parents=True, exist_ok=True)
            while self._file is None:
                file = self._path.open("a+", encoding="utf-8")
                try:
                    _lock(file)
                except BlockingIOError as held:
                    file.seek(0)
                    writer = file.read() or "another process"
                    file.close()
                    raise WriteError(
                        f"{self._path.with_suffix('')}: {writer} is writing this run now; "
                        "wait for it or choose another place with --out."
                    ) from held
                if _is_still_there(self._path, file):
                    self._file = file
                else:  # removed by the one before, between opening and locking
                    file.close()
            self._file.truncate(0)
            self._file.write(f"process {os.getpid()} on {socket.gethostname()}")
            self._file.flush()

    def release(self) -> None:
        """For the next writer."""
        if self._file is not None:
            with suppress(OSError):  # Windows removes no open file; an empty lock does no harm
                self._path.unlink()
            with suppress(OSError):
                self._file.close()
            self._file = None


def _is_still_there(path: Path, file: IO[str]) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def _lock(file: IO[str]) -> None:
    """Raises BlockingIOError where another holds it."""
    if sys.platform == "win32":
        import msvcrt

        file.seek(1 << 30)  # beyond the text, so that others can read it
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        except OSError as held:
            raise BlockingIOError from held
        return
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise
