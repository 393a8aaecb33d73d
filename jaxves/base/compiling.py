"""Compiler options, and programs that are kept between processes.

Compiling takes longer than a short run. Two settings of XLA shorten it on CPUs. Measured for one vesicle with 64 nodes:

- The older code generator compiles in half the time, and its programs run as fast. jaxlib 0.10 is the last to have it.
- Without optimisations compiling takes half of that again, and programs take 1.7 times as long.
"""

import os
import tempfile
import warnings
from importlib.metadata import version
from pathlib import Path

import platformdirs

_OLDER_GENERATOR = {"xla_cpu_use_fusion_emitters": False} if version("jaxlib").startswith("0.10.") else {}
FOR_LONG_RUNS = _OLDER_GENERATOR
FOR_SHORT_RUNS = {"xla_backend_optimization_level": 0} | _OLDER_GENERATOR
_ROOM = 2**20  # bytes of free space that the folder needs


def options_for(platform: str, *, quickly: bool) -> dict[str, int]:
    """Returns the options for programs on a platform of JAX, compiled quickly or with all optimisations."""
    if platform != "cpu":
        return {}
    return FOR_SHORT_RUNS if quickly else FOR_LONG_RUNS


def flags(options: dict[str, int]) -> str:
    """Returns compiler options in the form of the environment variable XLA_FLAGS."""
    return " ".join(f"--{name}={value}".lower() for name, value in options.items())


def use_flags(options: dict[str, int] = FOR_LONG_RUNS) -> None:
    """Adds compiler options for this process to XLA_FLAGS, except those that are there. Call it before JAX starts."""
    given = os.environ.get("XLA_FLAGS", "")
    missing = {name: value for name, value in options.items() if name not in given}
    os.environ["XLA_FLAGS"] = f"{given} {flags(missing)}".strip()


def fast_start(folder: str | Path | None = None) -> Path | None:
    """Shortens the time to the first result of this process, and keeps compiled programs for later processes.

    Call it once, before the first computation. It sets options of XLA (`FOR_LONG_RUNS`), unless XLA_FLAGS has them, and
    the folder of JAX's compilation cache, unless JAX has one. The command line does the same by itself.

    Args:
        folder: keeps the programs. The default is `jaxves` in the user's cache folder, with one folder for each version
            of jaxlib, because their formats differ.

    Returns:
        The folder, or None if it cannot be written. Nothing is kept then. This is no error, because results do not
        depend on it.
    """
    import jax

    use_flags()
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")
    known = jax.config.jax_compilation_cache_dir
    if known is not None and folder is None:
        return Path(known)
    if folder is None:
        folder = platformdirs.user_cache_path("jaxves", appauthor=False) / f"jaxlib-{version('jaxlib')}"
    folder = Path(folder)
    if not _can_be_written(folder):
        return None
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    return folder


def _can_be_written(folder: Path) -> bool:
    """Returns whether a folder exists or can be made, and has room; False if the user's home is not known."""
    try:
        if folder.is_absolute():
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder) as file:
                file.write(bytes(_ROOM))
            return True
    except OSError:
        pass
    return False
