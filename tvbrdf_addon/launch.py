"""What it takes to start a worker: its command line.  Imports no bpy."""

from __future__ import annotations

import contextlib
import os
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from ..model_runtime.contract import (
    CACHE,
    CACHE_GIGABYTES,
    CACHE_GIGABYTES_OPTION,
    CACHE_OPTION,
    IDLE_MINUTES,
    IDLE_OPTION,
    SERVE,
)
from .errors import WorkerError

__all__ = ("ENVIRONMENT_VARIABLE", "Launch")

ENVIRONMENT_VARIABLE = "TVBRDF_WORKER"

# The worker's own Python code: no user site, no PYTHON* variables, our paths before all others.
BOOTSTRAP = """\
import runpy, sys
sys.path[:0] = {paths!r}
sys.argv[1:] = {arguments!r}
runpy.run_module({module!r}, run_name="__main__", alter_sys=True)
"""
SERVING, LEARNING = "model_runtime", "training"


@dataclass(frozen=True)
class Launch:
    """How a worker is started.

    `interpreter` is a Python chosen by the user, or a script that speaks the protocol (`.py`);
    empty means `TVBRDF_WORKER`, and without that Blender's own Python together with
    `site_packages`, where Blender has unpacked the extension's wheels.  It keeps results in the
    folder `cache`, or in that which `TVBRDF_CACHE` names.  `lesson` is what it is to learn, as
    arguments of `training`; without one it serves.
    """

    runtime: Path
    site_packages: tuple[Path, ...] = ()
    interpreter: str = ""
    idle_minutes: float = IDLE_MINUTES
    cache: Path | None = None
    cache_gigabytes: float = CACHE_GIGABYTES
    lesson: tuple[str, ...] = ()

    @property
    def has_torch(self) -> bool:
        """Whether PyTorch came with the extension; True where the user chose a Python, which may
        have it.
        """
        chosen = self.interpreter or os.environ.get(ENVIRONMENT_VARIABLE)
        return bool(chosen) or any((folder / "torch").is_dir() for folder in self.site_packages)

    @property
    def cache_folder(self) -> Path | None:
        """Where results are kept; None where none are."""
        chosen = os.environ.get(CACHE)
        return self.cache if chosen is None else Path(chosen).absolute() if chosen else None

    @property
    def torch_version(self) -> str:
        """That of the PyTorch that came with the extension; empty where none did."""
        folders = map(str, self.site_packages)
        found = metadata.distributions(name="torch", path=list(folders))
        return next((each.version for each in found), "")

    def command(self) -> list[str]:
        """The command line of the worker.

        Raises:
            WorkerError: the chosen interpreter is not there, or not given by its whole path.
        """
        module, arguments = SERVING, [SERVE, IDLE_OPTION, f"{self.idle_minutes:g}"]
        if (cache := self.cache_folder) is not None:
            arguments += [CACHE_OPTION, str(cache)]
            arguments += [CACHE_GIGABYTES_OPTION, f"{self.cache_gigabytes:g}"]
        if self.lesson:
            module, arguments = LEARNING, list(self.lesson)
        path = self._chosen()
        if path is None:
            paths = [str(self.runtime), *map(str, self.site_packages)]
            bootstrap = BOOTSTRAP.format(paths=paths, arguments=arguments, module=module)
            return [sys.executable, "-I", "-c", bootstrap]
        if path.suffix == ".py":
            return [sys.executable, str(path), *arguments]
        # A Python of the user's choice brings its own torch, which ours must not hide.
        bootstrap = BOOTSTRAP.format(paths=[str(self.runtime)], arguments=arguments, module=module)
        return [str(path), "-c", bootstrap]

    def _chosen(self) -> Path | None:
        """The interpreter or script of the user's choice; None where there is no choice."""
        if self.interpreter:
            chosen, whose = self.interpreter, "Worker Python in the extension's preferences"
        elif ENVIRONMENT_VARIABLE in os.environ:
            chosen, whose = os.environ[ENVIRONMENT_VARIABLE], f"the variable {ENVIRONMENT_VARIABLE}"
        else:
            return None
        if not chosen:
            return None
        path = Path(chosen)
        with contextlib.suppress(RuntimeError):  # the ~ of a user who is not known here
            path = path.expanduser()
        # Blender's // means beside the .blend, whoever made it and put what beside it.
        if chosen.startswith("//") or not path.is_absolute():
            raise WorkerError(
                f"{chosen} is not the whole path of a worker.",
                f"Give the whole path in {whose}, so that no file beside a .blend is run; in "
                f"the file browser, switch Relative Path off.",
            )
        try:
            exists = path.is_file()
        except OSError:  # a name too long, a folder that may not be searched
            exists = False
        if not exists:
            raise WorkerError(f"There is no worker at {path}.", f"Choose another {whose}.")
        return path
