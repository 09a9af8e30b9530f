"""Imports every module of the packages named, on a Python that has lost what only POSIX has.

    python -m tests.without_posix PACKAGE MODULE_THAT_MAY_USE_POSIX ...

The modules that may use it, such as torch, are imported before it is taken away; so is the standard
library's own share of it, which differs by platform.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import signal
import subprocess  # noqa: F401  (before it goes: it looks for what the platform has)
import sys
from importlib.abc import MetaPathFinder

MODULES = ("fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty")
OF_OS = (
    *("fork", "forkpty", "getpgid", "getuid", "geteuid", "killpg", "mkfifo", "nice"),
    *("posix_spawn", "set_blocking", "setpgid", "setsid", "statvfs", "sysconf", "uname", "wait4"),
)
OF_SIGNAL = ("SIGHUP", "SIGKILL", "SIGPIPE", "SIGUSR1", "pthread_sigmask", "sigtimedwait", "alarm")


class Gone(MetaPathFinder):
    def find_spec(self, name: str, path: object, target: object = None) -> None:
        if name in MODULES:
            raise ModuleNotFoundError(f"{name} is of POSIX alone", name=name)


def main() -> None:
    package, *before = sys.argv[1:]
    for name in before:
        importlib.import_module(name)
    for name in MODULES:
        sys.modules.pop(name, None)
    for module, names in ((os, OF_OS), (signal, OF_SIGNAL)):
        for name in names:
            if hasattr(module, name):
                delattr(module, name)
    sys.meta_path.insert(0, Gone())
    found = importlib.import_module(package)
    names = [each.name for each in pkgutil.walk_packages(found.__path__, f"{package}.")]
    names = [name for name in names if not name.endswith("__main__")]
    for name in names:
        importlib.import_module(name)
    print(len(names))


if __name__ == "__main__":
    main()
