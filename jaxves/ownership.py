"""Each result file has one writer, and a writer notices when its file is taken away.

A process that writes FILE holds a lock on `.FILE.lock` beside it. The lock is one of the operating system, so it ends
with the process, however that ends; a lock file that a killed process has left does not block anyone. FILE itself
cannot carry the lock, because a complete new file replaces it at the start and at the end of a run.
"""

import errno
import fcntl
import itertools
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from .hdf5 import StoreError, named_errors

_PATIENCE = 0.5  # seconds; `writer_of` holds the lock for an instant
_BLOCK = 2**20
_NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)


class LostFile(StoreError):
    """The file was removed or replaced while it was written; the message names the copy that holds what it had."""


def real(path: str | os.PathLike) -> Path:
    """The file that is written for this path: where `path` is a symbolic link, the file it points to."""
    path = Path(path)
    return path.resolve() if path.is_symlink() else path


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Makes this the only process, and the only run in this process, that writes the file.

    On a file system without locks nothing is excluded.

    Raises:
        StoreError: another run writes the file, or its folder cannot be written.
    """
    with named_errors("write", path):
        descriptor = _locked(path)
    try:
        yield
    finally:
        # The name goes first: whoever has opened the file meanwhile sees that it is no longer the lock.
        _lock_of(path).unlink(missing_ok=True)
        os.close(descriptor)


def writer_of(path: Path) -> str | None:
    """Which process writes the file, as "process 1234 on host"; None if none does."""
    try:
        descriptor = os.open(_lock_of(real(path)), os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _who(descriptor)
    except OSError:
        return None
    finally:
        os.close(descriptor)
    return None


def check_in_place(file: h5py.File, path: Path) -> None:
    """Makes sure that `path` is still the name of the open file.

    Raises:
        LostFile: it is not. The content of the open file has been copied to a free name beside it.
    """
    descriptor = file.id.get_vfd_handle()
    if _is_at(descriptor, path):
        return
    file.flush()
    kept = _copied(descriptor, path)
    what = "replaced" if path.exists() else "removed"
    raise LostFile(f"{path} was {what} while it was written: {kept} holds what was computed, --resume continues it.")


def _lock_of(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


def _locked(path: Path) -> int:
    lock, end = _lock_of(path), time.monotonic() + _PATIENCE
    while True:
        descriptor = os.open(lock, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            who = _who(descriptor)
            os.close(descriptor)
            if time.monotonic() > end:
                raise StoreError(
                    f"{path} is being written by another run ({who}): wait for it, stop it, or choose another --out."
                ) from None
            time.sleep(0.05)
            continue
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                os.close(descriptor)
                raise
        if _is_at(descriptor, lock):
            os.ftruncate(descriptor, 0)
            os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}".encode())
            return descriptor
        os.close(descriptor)  # its holder removed it just now


def _is_at(descriptor: int, path: Path) -> bool:
    try:
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    except FileNotFoundError:
        return False


def _who(descriptor: int) -> str:
    return os.pread(descriptor, 200, 0).decode(errors="replace") or "just started"


def _copied(descriptor: int, path: Path) -> Path:
    """The name of a new file beside `path` with all bytes of an open one."""
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
