"""Builds the extension's zip with Blender's own builder, from this working tree and pinned wheels.

    python .ci/extension.py wheels --output build/wheels --python 3.11 --python 3.13
    python .ci/extension.py build --wheels build/wheels --output build

`wheels` collects the wheels that `requirements-runtime.txt` pins, one folder a Python version, and
asks no registry for what it has already.  torch is PyTorch's CPU build, taken from wherever pip
looks, and from `--torch-index` where pip finds it nowhere else.  The first Python is required; the
others are left out, with a warning, where a wheel does not exist for them.

`build` packs what belongs to the extension, and nothing else, into `tvbrdf-VERSION.zip`, validates
it and prints its path.  It does nothing while the zip is that of the same content.

Runs on the standard library and the Blender module of the environment that runs it.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import json
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PINS = ROOT / "requirements-runtime.txt"
PACKED = (
    "__init__.py",
    "blender_manifest.toml",
    "LICENSE",
    "LICENSES",
    "model_runtime",
    "tvbrdf_addon",
)
TORCH_INDEX = "https://download.pytorch.org/whl/cpu"

# Blender's name of the platform, and the tags that its wheels may carry.
PLATFORMS = {
    "linux-x86_64": ("linux-x64", ("manylinux_2_28_x86_64", "manylinux2014_x86_64")),
    "macosx-arm64": ("macos-arm64", ("macosx_11_0_arm64",)),
    "win-amd64": ("windows-x64", ("win_amd64",)),
}


def platform() -> tuple[str, tuple[str, ...]]:
    """Blender's name of this machine's platform, and the tags of wheels that run on it."""
    ours = sysconfig.get_platform()
    for name, known in PLATFORMS.items():
        system, machine = name.split("-")
        if ours.startswith(system) and ours.endswith(machine):
            return known
    raise SystemExit(f"No wheels are known for {ours}; build with WHEELS=none.")


def download(*, python: str, folder: Path, torch_index: str) -> str:
    """Fill `folder` with the pinned wheels for one Python version; what is wrong, if anything."""
    name, tags = platform()
    pins = PINS.read_text(encoding="utf-8").splitlines()
    if not name.startswith("macos"):  # elsewhere the plain build brings gigabytes of CUDA
        pins = [f"{pin}+cpu" if pin.startswith("torch==") else pin for pin in pins]
    folder.mkdir(parents=True)
    wanted = folder / "pins.txt"
    wanted.write_text("\n".join(pins), encoding="utf-8")
    command = [
        *(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--retries", "1"),
        *("--only-binary", ":all:", "--python-version", python, "--implementation", "cp"),
        *(argument for tag in tags for argument in ("--platform", tag)),
        *("--dest", str(folder), "--requirement", str(wanted)),
    ]
    error = ""
    for extra in ([], ["--extra-index-url", torch_index]):
        run = subprocess.run([*command, *extra], capture_output=True, text=True, check=False)
        if run.returncode == 0:
            wanted.unlink()
            return ""
        error = run.stderr
    return error


def collect_wheels(*, pythons: list[str], output: Path, torch_index: str) -> None:
    """Make `output/PYTHON` hold the pinned wheels of every Python that has them."""
    pinned = hashlib.sha256(PINS.read_bytes()).hexdigest()
    for python in pythons:
        folder, stamp = output / python, output / python / "pins.sha256"
        if stamp.is_file() and stamp.read_text() == pinned:
            continue
        shutil.rmtree(folder, ignore_errors=True)
        print(f"Collecting wheels for Python {python}", flush=True)
        error = download(python=python, folder=folder, torch_index=torch_index)
        if not error:
            stamp.write_text(pinned)
            continue
        shutil.rmtree(folder)
        if python == pythons[0]:
            raise SystemExit(f"{error}\nThe pinned wheels for Python {python} are not to be had.")
        print(f"Not to be had: Blenders with Python {python} will refuse the zip.")


def packed_files() -> Iterator[Path]:
    """The files of the working tree that belong into the zip, sorted."""
    for name in PACKED:
        path = ROOT / name
        found = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in found:
            if file.is_dir() or "__pycache__" in file.parts or file.name.startswith("."):
                continue
            yield file


def content_hash(wheels: list[Path]) -> str:
    """A hash over everything that goes into the zip."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for file in packed_files():
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0")
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    for wheel in wheels:  # their versions are in their names
        digest.update(f"{wheel.name} {wheel.stat().st_size}\n".encode())
    return digest.hexdigest()


def stage(folder: Path, wheels: list[Path]) -> None:
    """Copy the extension into `folder`, wheels and a manifest that lists them included."""
    for file in packed_files():
        target = folder / file.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    if not wheels:
        return
    (folder / "wheels").mkdir()
    for wheel in wheels:
        (folder / "wheels" / wheel.name).symlink_to(wheel)
    added = {
        "platforms": [platform()[0]],
        "wheels": [f"./wheels/{wheel.name}" for wheel in wheels],
    }
    manifest = folder / "blender_manifest.toml"
    text = manifest.read_text(encoding="utf-8")
    lines = [f"{key} = {json.dumps(value, indent=2)}" for key, value in added.items()]
    head, table, tail = text.partition("[permissions]")
    manifest.write_text("\n".join([head, *lines, "", table + tail]), encoding="utf-8")


def blender_builder() -> Path:
    """Blender's own command line for extensions, in the environment that runs this script."""
    found = sorted(
        Path(sysconfig.get_path("purelib")).glob(
            "bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"
        )
    )
    if not found:
        raise SystemExit(f"{sys.executable} has no Blender module (bpy) to build with.")
    return found[-1]


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """One build at a time."""
    with path.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def build(*, wheels_folder: Path | None, output: Path) -> Path:
    """Build and validate the zip in `output`, unless it is there already; its path."""
    wheels = (
        sorted({w.name: w for w in wheels_folder.glob("*/*.whl")}.values())
        if (wheels_folder)
        else []
    )
    if wheels_folder and not wheels:
        raise SystemExit(f"{wheels_folder} holds no wheels; run `make wheels` first.")
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    suffix = "" if wheels else "-nowheels"
    target = output / f"tvbrdf-{version}{suffix}.zip"
    stamp = target.with_suffix(".sha256")
    output.mkdir(parents=True, exist_ok=True)
    with locked(target.with_suffix(".lock")):
        digest = content_hash(wheels)
        if target.is_file() and stamp.is_file() and stamp.read_text() == digest:
            return target
        with tempfile.TemporaryDirectory(dir=output) as scratch:
            source, built = Path(scratch) / "source", Path(scratch) / target.name
            stage(source, wheels)
            builder = [sys.executable, str(blender_builder())]
            for command in (
                ["build", "--source-dir", str(source), "--output-filepath", str(built)],
                ["validate", str(built)],
            ):
                run = subprocess.run([*builder, *command], capture_output=True, text=True)
                if run.returncode != 0:
                    raise SystemExit(f"blender_ext {command[0]}:\n{run.stdout}{run.stderr}")
            built.replace(target)
            stamp.write_text(digest)
    return target


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    collecting = commands.add_parser("wheels")
    collecting.add_argument("--output", type=Path, required=True)
    collecting.add_argument("--python", action="append", required=True)
    collecting.add_argument("--torch-index", default=TORCH_INDEX)
    building = commands.add_parser("build")
    building.add_argument("--wheels", required=True, help="a folder, or none")
    building.add_argument("--output", type=Path, required=True)
    arguments = parser.parse_args()
    if arguments.command == "wheels":
        collect_wheels(
            pythons=arguments.python,
            output=arguments.output.resolve(),
            torch_index=arguments.torch_index,
        )
        return
    wheels = None if arguments.wheels == "none" else Path(arguments.wheels).resolve()
    zip_file = build(wheels_folder=wheels, output=arguments.output.resolve())
    print(zip_file)
    print(f"{zip_file.name}: {zip_file.stat().st_size / 1e6:.1f} MB", file=sys.stderr)


if __name__ == "__main__":
    main()
