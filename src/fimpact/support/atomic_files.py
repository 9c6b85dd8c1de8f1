"""Files that are written whole or not at all, in folders that are gone afterwards, even of a process that was killed.

Whoever fills such a folder holds a lock on it, which ends with the process; the next clears what nobody holds.
"""

import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp

try:
    import fcntl
except ImportError:  # Windows: nothing is locked there, and nothing of others cleared
    fcntl = None  # type: ignore[assignment]

PREFIX = ".draft-"


@contextmanager
def draft_folder(parent: Path, prefix: str = PREFIX) -> Iterator[Path]:
    """Make an empty folder in `parent`, removed at the end; what killed processes left of this `prefix` is cleared.

    Raises:
        OSError: nothing can be written in `parent`.
    """
    clear_left(parent, prefix)
    folder, lock = _locked(parent, prefix)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        _release(lock)


def clear_left(parent: Path, prefix: str = PREFIX) -> None:
    """Remove the draft folders in `parent` that no process holds."""
    for left in [path for path in parent.iterdir() if path.name.startswith(prefix)]:
        lock = _lock(left)
        if lock is not None:
            shutil.rmtree(left, ignore_errors=True)
            _release(lock)


def _locked(parent: Path, prefix: str) -> tuple[Path, int | None]:
    while True:
        folder = Path(mkdtemp(prefix=prefix, dir=parent))
        lock = _lock(folder)
        if folder.is_dir():  # else another process took it for left behind, before it was locked
            return folder, lock
        _release(lock)


def _lock(folder: Path) -> int | None:
    """A lock on a folder, None where another process holds it or the file system has none."""
    if fcntl is None or folder.is_symlink() or not folder.is_dir():
        return None
    handle = None
    try:
        handle = os.open(folder, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return handle
    except OSError:
        _release(handle)
        return None


def _release(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """A draft that takes the place of `path` in one step once it is complete.

    A run killed while it writes leaves no half file, and two that write the same file do not mix.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with draft_folder(path.parent) as folder:
        draft = folder / path.name
        yield draft
        draft.replace(path)


def write_text(text: str, path: str | Path) -> None:
    """Write `text` with one newline at its end."""
    with replacing(path) as draft:
        draft.write_text(text.rstrip("\n") + "\n", encoding="utf-8")


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder and those above it; those that were made are gone again if what is done in it fails."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):  # not empty: what is in it belongs to somebody
                path.rmdir()
        raise


def check_apart(out: Path, files: Iterable[Path]) -> None:
    """Whether what is written to `out`, a file or a folder, replaces none of `files`, which are read.

    Raises:
        ValueError: it would.
    """
    for file in files:
        if file.resolve().is_relative_to(out.resolve()) or (out.exists() and file.exists() and out.samefile(file)):
            raise ValueError(f"{file} is read, and what is written to {out} would replace it; choose another place")
