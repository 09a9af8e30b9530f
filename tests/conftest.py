"""What every test may ask for.

`data_folder`: the measured and synthetic data (`TVBRDF_DATA`, by default `../shared/data`).  A test
that asks for it is skipped, by name, where the folder is absent; where `TVBRDF_DATA` is set and
wrong, it fails.

Importing: `import model_runtime` and `import training` work everywhere.  The add-on is relative to
the extension's root (`from ..model_runtime import package`), so its tests import it through the
extension, as Blender does: `from tvbrdf.tvbrdf_addon.material import bind`.  The package `tvbrdf`
is this working tree, whatever its folder is called.

Fixtures that need Blender are described in `tests/blender/conftest.py`.
"""

from __future__ import annotations

import importlib.abc
import importlib.util
import os
import sys
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
EXIT_STATUS = pytest.StashKey[int]()


class _ExtensionFinder(importlib.abc.MetaPathFinder):
    """Finds the package `tvbrdf` in the working tree."""

    def find_spec(
        self, fullname: str, path: object, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "tvbrdf":
            return None
        return importlib.util.spec_from_file_location(
            fullname, ROOT / "__init__.py", submodule_search_locations=[str(ROOT)]
        )


sys.meta_path.append(_ExtensionFinder())


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    session.config.stash[EXIT_STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Leave at once where Blender is in this process: it has much to say, and pytest the last word.

    Blender's shutdown reports every block it did not free, after pytest's closing line.
    """
    if "bpy" in sys.modules and EXIT_STATUS in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[EXIT_STATUS])


@pytest.fixture(scope="session")
def data_folder(request: pytest.FixtureRequest) -> Path:
    """Folder with the data sets that `data/README.md` describes."""
    named = os.environ.get("TVBRDF_DATA")
    folder = Path(named) if named else ROOT.parent / "shared" / "data"
    if not (folder / "README.md").is_file():
        if named:
            pytest.fail(f"TVBRDF_DATA is {named}, which holds no data (no README.md in it).")
        pytest.skip(f"the data is not at {folder}; set TVBRDF_DATA")
    return folder
