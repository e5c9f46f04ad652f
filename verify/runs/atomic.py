"""Writing files and folders so that a reader sees the old one or the new one, never half of one."""

import errno
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd

from cases.errors import UserError

#: a disk that takes no more
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


class WriteError(UserError):
    """A result could not be written; its text is one sentence with the path and a remedy."""

    exit_code = 2


def _sentence(error: OSError, path: Path) -> str:
    told = re.search(r"\[Errno (\d+)\]", str(error))  # shutil gathers those of many files in one error without number
    number = int(told[1]) if told and error.errno is None else error.errno
    if number in (errno.ENOSPC, errno.EDQUOT):
        return f"{path}: the disk is full; free some space or give another place."
    if number in (errno.EACCES, errno.EPERM, errno.EROFS):
        return f"{path}: no permission to write here; give another place."
    return f"{path}: could not be written ({error.strerror or error}); check it or give another place."


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the operating system's refusal to write ``path`` into one sentence.

    Raises
    ------
    WriteError : disk full, no permission, not a folder.
    """
    try:
        yield
    except OSError as error:
        raise WriteError(_sentence(error, path)) from error


def write_file(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a temporary file beside ``path``, then put it in its place in one step.

    The temporary file keeps the suffix, because writers such as pyvista choose the format by it.
    """
    temporary = path.with_name(f".writing-{path.name}")
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            write(temporary)
            _flush_to_disk(temporary)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write ``text`` as UTF-8 with plain line ends, in one step."""
    write_file(path, lambda temporary: temporary.write_text(text, encoding="utf-8", newline="\n"))


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table as CSV without its index, in one step."""
    write_text(path, table.to_csv(index=False, lineterminator="\n"))


def _flush_to_disk(path: Path) -> None:
    """Without this a power cut may leave the new name with empty contents."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def superseded(folder: Path) -> Path:
    """Where an older folder waits while the newer one takes its name."""
    return folder.with_name(folder.name + ".superseded")


def replace_folder(new: Path, folder: Path) -> None:
    """Give the complete folder ``new`` the name ``folder``; an older one there goes only afterwards.

    A folder that is not empty cannot be replaced in one step. A kill between the two renames leaves the
    older one under ``superseded(folder)``, from where `restore_folder` takes it back.
    """
    old = superseded(folder)
    with writing(folder):
        if folder.exists():
            shutil.rmtree(old, ignore_errors=True)
            os.replace(folder, old)
        try:
            os.replace(new, folder)
        except OSError:
            if old.exists():
                os.replace(old, folder)
            raise
        shutil.rmtree(old, ignore_errors=True)


def restore_folder(folder: Path) -> None:
    """Take back the older folder when a kill hit between the two renames of `replace_folder`."""
    old = superseded(folder)
    if old.exists() and not folder.exists():
        with writing(folder):
            os.replace(old, folder)
