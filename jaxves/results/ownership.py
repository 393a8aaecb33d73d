"""Locks of result files: each file has one writer, and a writer notices if its file is removed or replaced.

A process that writes FILE holds a lock on `.FILE.lock` in the same folder. It is a lock of the operating system, which
ends with the process in any case. The lock file of a killed process does not block others. FILE itself cannot have the
lock, because a complete new file replaces it at the start and at the end of a run.
"""

import errno
import itertools
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py

try:
    import fcntl
except ImportError:  # Windows, where an open file cannot be removed or replaced
    fcntl = None
    import msvcrt

from .hdf5 import StoreError, named_errors, refuse_special

_PATIENCE = 0.5  # seconds to wait for the lock, because `writer_of` holds it for an instant
_BLOCK = 2**20
_BEYOND = 2**30  # on Windows this byte is locked, because locked bytes cannot be read
_NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)


class LostFile(StoreError):
    """The file was removed or replaced while it was written. The message names a copy with its content."""


def real(path: str | os.PathLike) -> Path:
    """Returns the file that is written for this path: the target if `path` is a symbolic link."""
    path = Path(path)
    return path.resolve() if path.is_symlink() else path


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Makes this run the only one that writes the file, in this process and in others.

    On a file system without locks it has no effect.

    Raises:
        StoreError: another run writes the file, or its folder cannot be written.
    """
    refuse_special(path)
    with named_errors("write", path):
        descriptor = _locked(path)
    try:
        yield
    finally:
        # The lock file is removed first. A process that has opened it then sees that it is no longer the lock.
        with suppress(PermissionError):  # Windows
            _lock_of(path).unlink(missing_ok=True)
        os.close(descriptor)


def refuse_written(path: str | os.PathLike) -> None:
    """Raises StoreError if a process writes the file, or if it is a folder or device. `writing` checks this again."""
    refuse_special(Path(path))
    if (who := writer_of(Path(path))) is not None:
        raise _taken(real(path), who)


def _taken(path: Path, who: str) -> StoreError:
    return StoreError(f"{path} is being written by another run ({who}): wait for it, stop it, or choose another file.")


def writer_of(path: Path) -> str | None:
    """Returns the process that writes the file, as "process 1234 on host", or None."""
    try:
        descriptor = os.open(_lock_of(real(path)), os.O_RDONLY)
    except OSError:
        return None
    try:
        return None if _got_lock(descriptor, shared=True) else _who(descriptor)
    except OSError:
        return None
    finally:
        os.close(descriptor)


def check_in_place(file: h5py.File, path: Path) -> None:
    """Checks that `path` is still the name of the open file.

    Raises:
        LostFile: it is not. The content of the open file was copied to an unused name in the same folder.
    """
    if fcntl is None or _is_at(descriptor := file.id.get_vfd_handle(), path):
        return
    file.flush()
    kept = _copied(descriptor, path)
    what = "replaced" if path.exists() else "removed"
    raise LostFile(
        f"{path} was {what} while it was written: {kept} holds what was computed. Resume it (resume=True, --resume)."
    )


def _lock_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


def _locked(path: Path) -> int:
    lock, end = _lock_of(path), time.monotonic() + _PATIENCE
    while True:
        descriptor, is_own = _opened_lock(lock)
        try:
            free = _got_lock(descriptor)
        except OSError as error:
            free = error.errno in _NO_LOCKS
            if not free:
                os.close(descriptor)
                raise
        if not free:
            who = _who(descriptor)
            os.close(descriptor)
            if time.monotonic() > end:
                raise _taken(path, who)
            time.sleep(0.05)
            continue
        if not is_own:
            lock.unlink(missing_ok=True)
        elif _is_at(descriptor, lock):
            os.ftruncate(descriptor, 0)
            os.lseek(descriptor, 0, os.SEEK_SET)
            os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
            return descriptor
        os.close(descriptor)  # its owner has just removed it


def _opened_lock(lock: Path) -> tuple[int, bool]:
    """Opens the lock file, which is created if necessary; returns whether it is writable, too.

    It is not writable if another user's process has left it.
    """
    try:
        return os.open(lock, os.O_RDWR | os.O_CREAT, 0o666), True
    except PermissionError:
        return os.open(lock, os.O_RDONLY), False


def _got_lock(descriptor: int, shared: bool = False) -> bool:
    """Takes the lock of an open file if it is free; closing the file releases it.

    Raises:
        OSError: the file system has no locks.
    """
    try:
        if fcntl is not None:
            fcntl.flock(descriptor, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        else:
            os.lseek(descriptor, _BEYOND, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
    except (BlockingIOError, PermissionError):
        return False
    return True


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _who(descriptor: int) -> str:
    os.lseek(descriptor, 0, os.SEEK_SET)
    return os.read(descriptor, 200).decode(errors="replace") or "just started"


def _copied(descriptor: int, path: Path) -> Path:
    """Copies an open file to a new file in the folder of `path`; returns its name."""
    names = (path.with_name(f"{path.stem}.lost{number or ''}{path.suffix}") for number in itertools.count())
    kept = next(name for name in names if not os.path.lexists(name))
    with open(kept, "xb") as copy:
        place = 0
        while block := os.pread(descriptor, _BLOCK, place):
            copy.write(block)
            place += len(block)
        copy.flush()
        os.fsync(copy.fileno())
    return kept
