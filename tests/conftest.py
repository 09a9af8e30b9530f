"""What every test may ask for.

`data_folder`: the measured and synthetic data (`TVBRDF_DATA`, by default `../shared/data`).  A test
that asks for it is skipped, by name, where the folder is absent; where `TVBRDF_DATA` is set and
wrong, it fails.

Importing: `import model_runtime` and `import training` work everywhere.  The add-on is relative to
the extension's root (`from ..model_runtime import maps`), so its tests import it through the
extension, as Blender does: `from tvbrdf.tvbrdf_addon.material.binding import bind`.  The package
`tvbrdf` is this working tree, whatever its folder is called.

`one_thread`: torch on one thread, for tests of many small steps, which a second only slows down.

`paint`, `steel`: folders with maps of painted steel (64 px) and with one uniform texel of steel.

`signals_as_before`: for tests of commands that set handlers of signals in this process.

`rusting`: a folder with a short, small rust sequence to train a model on.

`worker`: the stub worker, as Blender would start it; `script(code)`: one made of a few lines.

Properties are tried on the same examples every time in CI, and on new ones elsewhere.

Fixtures that need Blender are described in `tests/blender/conftest.py`.
"""

from __future__ import annotations

import importlib.abc
import importlib.util
import os
import signal
import sys
import textwrap
from collections.abc import Callable, Iterator
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import hypothesis
import pytest

if TYPE_CHECKING:
    from tvbrdf.tvbrdf_addon.worker import Worker

ROOT = Path(__file__).resolve().parents[1]
EXIT_STATUS = pytest.StashKey[int]()


hypothesis.settings.register_profile("ci", derandomize=True, deadline=None)
if os.environ.get("CI"):
    hypothesis.settings.load_profile("ci")


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


@pytest.fixture
def one_thread() -> Iterator[None]:
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("age ü")


@pytest.fixture(scope="session")
def paint(place: Path) -> Path:
    from tests.aging import write_painted_steel

    return write_painted_steel(place / "paint", 64)


@pytest.fixture(scope="session")
def steel(place: Path) -> Path:
    from tests.aging import write_torrance_sparrow

    return write_torrance_sparrow(place / "steel")


@pytest.fixture(scope="session")
def rusting(place: Path) -> Path:
    from training.data import weathering

    folder = place / "rusting"
    weathering.write("rust", folder, size=24, frames=6)
    return folder


@pytest.fixture
def signals_as_before() -> Iterator[None]:
    """The command ignores signals at its end, as its process has none left to heed."""
    before = {number: signal.getsignal(number) for number in signal.valid_signals()}
    yield
    for number, handler in before.items():
        if signal.getsignal(number) is not handler:
            signal.signal(number, handler)


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch) -> Iterator[Worker]:
    from tvbrdf.tvbrdf_addon.worker import Launch, Worker

    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0.1")
    stub = Path(__file__).with_name("stub_worker.py")
    worker = Worker(Launch(runtime=ROOT, interpreter=str(stub)))
    yield worker
    worker.stop()


@pytest.fixture
def script(tmp_path: Path) -> Iterator[Callable[[str], Worker]]:
    from tvbrdf.tvbrdf_addon.worker import Launch, Worker

    workers = []

    def make(code: str) -> Worker:
        path = tmp_path / "worker.py"
        path.write_text(textwrap.dedent(code))
        workers.append(Worker(Launch(runtime=ROOT, interpreter=str(path))))
        return workers[-1]

    yield make
    for worker in workers:
        worker.stop()
