"""Rooms import one way only, and the halves of the extension know of each other what they may.

A room is a folder of modules; a module that lies beside folders stands for itself.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LIBRARIES = ("torch", "safetensors", "OpenEXR", "PIL", "scipy")
"""What Blender's Python does not have."""
NOT_SHIPPED = ("tyro", "tqdm", "rich", "matplotlib", "scipy", "torch.utils.tensorboard")
"""What training has and the extension does not."""
PACKAGES = ("model_runtime", "training", "tvbrdf_addon")


def modules(package: str) -> dict[str, Path]:
    """The files of a package by the dotted names of their modules."""
    paths = sorted((ROOT / package).rglob("*.py"))
    return {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in paths}


MODULES = {name: path for package in PACKAGES for name, path in modules(package).items()}


def imported(name: str) -> Iterator[str]:
    """What the module imports, wherever in it, as absolute dotted names."""
    for node in ast.walk(ast.parse(MODULES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = name.split(".")[: -node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from (f"{base}.{each.name}" for each in node.names)


def module_of(what: str) -> str | None:
    """The module of ours in which `what` lies; None where it is somebody else's."""
    parts = what.split(".")
    for count in range(len(parts), 0, -1):
        name = ".".join(parts[:count])
        for module in (name, f"{name}.__init__"):
            if module in MODULES:
                return module
    return None


def room_of(module: str) -> str:
    folder = MODULES[module].parent
    beside_folders = any(each.is_dir() and list(each.glob("*.py")) for each in folder.iterdir())
    return module if beside_folders else module.rpartition(".")[0]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_rooms_import_each_other(package: str):
    reasons: dict[tuple[str, str], str] = {}
    rooms: dict[str, set[str]] = {}
    for name in modules(package):
        room = room_of(name)
        for what in imported(name):
            target = module_of(what)
            if target in MODULES and target.startswith(package) and room_of(target) != room:
                rooms.setdefault(room, set()).add(room_of(target))
                reasons[room, room_of(target)] = f"{name} imports {what}"
    try:
        TopologicalSorter(rooms).prepare()
    except CycleError as error:
        circle = error.args[1][::-1]
        pytest.fail("\n".join(reasons[pair] for pair in pairwise(circle)))


def users_of(package: str) -> dict[str, set[str]]:
    """Which packages the modules of `package` import, by the first part of the name."""
    return {name: {what.split(".")[0] for what in imported(name)} for name in modules(package)}


def test_the_runtime_knows_neither_the_add_on_nor_training():
    for name, packages in users_of("model_runtime").items():
        assert not packages & {"training", "tvbrdf_addon", "bpy"}, name


def test_the_runtime_takes_torch_from_one_place():
    for name, packages in users_of("model_runtime").items():
        assert "torch" not in packages or name == "model_runtime.backend.__init__", name


def test_training_does_not_know_the_add_on():
    for name, packages in users_of("training").items():
        assert not packages & {"tvbrdf_addon", "bpy"}, name


def test_the_add_on_takes_of_the_runtime_what_needs_no_library():
    names = {module_of(what) for name in modules("tvbrdf_addon") for what in imported(name)}
    taken = sorted(name for name in names if name and name.startswith("model_runtime"))
    assert taken
    code = (
        "import importlib, sys\n"
        f"for name in {LIBRARIES}: sys.modules[name] = None\n"
        "for name in sys.argv[1:]: importlib.import_module(name.removesuffix('.__init__'))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, *taken], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr


def test_nor_does_the_add_on_itself():
    for name, packages in users_of("tvbrdf_addon").items():
        assert not packages & {*LIBRARIES, "training"}, name


@pytest.mark.parametrize(
    ("package", "before"),
    [
        ("model_runtime", ("torch", "OpenEXR", "safetensors.torch", "PIL.Image")),
        ("tvbrdf.tvbrdf_addon", ("tests.conftest", "bpy")),
    ],
)
def test_what_ships_is_imported_where_there_is_no_posix(
    package: str, before: tuple[str, ...]
) -> None:
    command = [sys.executable, "-m", "tests.without_posix", package, *before, "numpy", "asyncio"]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) > 50


def test_what_learns_inside_blender_needs_what_the_worker_needs() -> None:
    code = (
        "import importlib, sys\n"
        f"for name in {NOT_SHIPPED}: sys.modules[name] = None\n"
        "for name in ('__main__', 'learn_command', 'learn'):\n"
        "    importlib.import_module(f'training.{name}')"
    )
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
