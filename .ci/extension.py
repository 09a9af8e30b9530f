"""Builds the extension's zip with Blender's own builder, from this working tree and pinned wheels.

    python .ci/extension.py wheels --platform linux-x64 --output build/wheels --python 3.11
    python .ci/extension.py build --platform linux-x64 --wheels build/wheels --output build
    python .ci/extension.py repository --output build/repository ZIP ...

`wheels` collects the wheels that `requirements-runtime.txt` pins for a platform, any from any, one
folder a Python version, and asks no registry for what it has already.  torch is PyTorch's CPU
build, taken from wherever pip looks, and from `--torch-index` where pip finds it nowhere else.  The
first Python is required; the others are left out, with a warning, where a wheel does not exist for
them.  With `--small` it collects the few that aging cannot do without, for all Pythons.

`build` packs what belongs to the extension, and a manual made of docs/ (manual.py), into
`tvbrdf-VERSION-PLATFORM.zip`, validates it and prints its path.  With `--small` that is
`tvbrdf-small-VERSION-PLATFORM.zip`, which brings no torch.  It does nothing while the zip is that
of the same content.

`repository` makes a folder that Blender takes for a repository of extensions once a web server
shows it: the zips, their `index.json` and a page to drag them from.

Runs on the standard library; `build` on Markdown and the environment's Blender module, too.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import json
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path

import manual

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
LEARNING = ("training", "training.__main__", "training.learn_command")
"""Modules of `training` that are packed with whatever of it the last imports, wherever in it."""
SMALL = ("OpenEXR", "pillow", "safetensors")
"""The pins that aging needs besides Blender's numpy; the others are torch, and what that needs."""
NO_TEXTURE = re.compile(r"PIL/_avif\.|.*/libavif")
"""Files of Pillow that read AVIF, which no texture is in: a third of it, and it does without."""
TORCH_INDEX = "https://download.pytorch.org/whl/cpu"

# Tags that wheels of a platform, by Blender's name, may carry; and its build of torch without CUDA,
# which the plain one brings gigabytes of on Linux alone.
TAGS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux2014_x86_64"),
    "macos-arm64": ("macosx_14_0_arm64",),
    "windows-x64": ("win_amd64",),
}
TORCH_BUILD = {"linux-x64": "+cpu"}


def here() -> str | None:
    """Blender's name of this machine's platform, or None where no wheels are known for it."""
    ours = sysconfig.get_platform()  # such as macosx-14.0-arm64
    known = {"linux-x86_64": "linux-x64", "win-amd64": "windows-x64"}
    if ours.startswith("macosx") and ours.endswith("arm64"):
        return "macos-arm64"
    return known.get(ours)


def pinned(*, small: bool) -> list[str]:
    """What a zip brings, as requirements."""
    pins = PINS.read_text(encoding="utf-8").splitlines()
    return [pin for pin in pins if not small or pin.partition("==")[0] in SMALL]


def download(
    *, platform: str, python: str, folder: Path, torch_index: str, small: bool = False
) -> str:
    """Fill `folder` with the pinned wheels for one Python version; what is wrong, if anything."""
    build = TORCH_BUILD.get(platform, "")
    pins = [pin + build if pin.startswith("torch==") else pin for pin in pinned(small=small)]
    folder.mkdir(parents=True)
    wanted = folder / "pins.txt"
    wanted.write_text("\n".join(pins), encoding="utf-8")
    command = [
        *(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--retries", "1"),
        *("--only-binary", ":all:", "--python-version", python, "--implementation", "cp"),
        *(argument for tag in TAGS[platform] for argument in ("--platform", tag)),
        *("--dest", str(folder), "--requirement", str(wanted)),
    ]
    error = ""
    for extra in ([],) if small else ([], ["--extra-index-url", torch_index]):
        run = subprocess.run([*command, *extra], capture_output=True, text=True, check=False)
        if run.returncode == 0:
            wanted.unlink()
            return ""
        error = run.stderr
    return error


def wheels_of(folder: Path, platform: str, *, small: bool) -> Path:
    """Where in a folder of wheels those of a platform are, a folder a Python."""
    return folder / "small" / platform if small else folder / platform


def collect_wheels(
    *, platform: str, pythons: list[str], output: Path, torch_index: str, small: bool
) -> None:
    """Make the folders `wheels_of` hold the pinned wheels of every Python that has them."""
    pins = hashlib.sha256(PINS.read_bytes()).hexdigest()
    for python in pythons:
        folder = wheels_of(output, platform, small=small) / python
        stamp = folder / "pins.sha256"
        if stamp.is_file() and stamp.read_text() == pins:
            continue
        shutil.rmtree(folder, ignore_errors=True)
        print(f"Collecting wheels for {platform}, Python {python}", flush=True)
        error = download(
            platform=platform, python=python, folder=folder, torch_index=torch_index, small=small
        )
        if not error:
            stamp.write_text(pins)
            continue
        shutil.rmtree(folder)
        if small or python == pythons[0]:
            raise SystemExit(
                f"{error}\nThe pinned wheels for {platform}, Python {python}, are not to be had."
            )
        print(f"Not to be had: Blenders with Python {python} on {platform} will refuse the zip.")


def packed_files() -> Iterator[Path]:
    """The files of the working tree that belong into the zip, sorted."""
    for name in PACKED:
        path = ROOT / name
        found = sorted(path.rglob("*")) if path.is_dir() else [path]
        for file in found:
            if file.is_dir() or "__pycache__" in file.parts or file.name.startswith("."):
                continue
            yield file
    yield from learning_files()


def learning_files() -> list[Path]:
    """What learns from a material, and nothing else of `training`; sorted."""
    waiting = [LEARNING[-1]]
    found = dict.fromkeys(LEARNING)
    while waiting:
        for name in imported(waiting.pop()):
            if name not in found and module_file(name):
                found[name] = None
                waiting.append(name)
    return sorted(file for name in found if (file := module_file(name)))


def module_file(name: str) -> Path | None:
    """The file of a module or a package of this tree; None where it is neither."""
    path = ROOT.joinpath(*name.split("."))
    files = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in files if file.is_file()), None)


def imported(module: str) -> Iterator[str]:
    """What a module of `training` may import of it: modules, packages, and names in these."""
    if (file := module_file(module)) is None:
        return
    package = module.split(".") if file.name == "__init__.py" else module.split(".")[:-1]
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            above = package[: len(package) - node.level + 1]
            base = [*above, *(node.module or "").split(".")] if node.module else above
            for end in range(1, len(base) + 1):
                yield ".".join(base[:end])
            yield from (".".join((*base, each.name)) for each in node.names)


def content_hash(wheels: list[Path]) -> str:
    """A hash over everything that goes into the zip."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for file in (*packed_files(), Path(manual.__file__), *manual.sources()):
        digest.update(str(file.relative_to(ROOT)).encode() + b"\0")
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    for wheel in wheels:  # their versions are in their names
        digest.update(f"{wheel.name} {wheel.stat().st_size}\n".encode())
    return digest.hexdigest()


def pack_wheel(wheel: Path, target: Path) -> None:
    """Copy a wheel, without what no zip needs."""
    if not wheel.name.startswith("pillow-"):
        shutil.copyfile(wheel, target)
        return
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(target, "w") as new:
        for entry in old.infolist():
            if NO_TEXTURE.match(entry.filename):
                continue
            content = old.read(entry)
            if entry.filename.endswith(".dist-info/RECORD"):
                lines = content.decode().splitlines(keepends=True)
                content = "".join(line for line in lines if not NO_TEXTURE.match(line)).encode()
            new.writestr(entry, content)


def stage(folder: Path, platform: str, wheels: list[Path]) -> None:
    """Copy the extension into `folder`, wheels and a manifest that lists them included."""
    for file in packed_files():
        target = folder / file.relative_to(ROOT)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, target)
    manual.write_manual(folder)
    if not wheels:
        return
    (folder / "wheels").mkdir()
    for wheel in wheels:
        pack_wheel(wheel, folder / "wheels" / wheel.name)
    added = {
        "platforms": [platform],
        "wheels": [f"./wheels/{wheel.name}" for wheel in wheels],
    }
    manifest = folder / "blender_manifest.toml"
    text = manifest.read_text(encoding="utf-8")
    lines = [f"{key} = {json.dumps(value, indent=2)}" for key, value in added.items()]
    head, table, tail = text.partition("[permissions]")
    manifest.write_text("\n".join([head, *lines, "", table + tail]), encoding="utf-8")


def blender_ext(*command: str) -> None:
    """Run Blender's own command line for extensions, of the environment that runs this script."""
    found = sorted(
        Path(sysconfig.get_path("purelib")).glob(
            "bpy/*/scripts/addons_core/bl_pkg/cli/blender_ext.py"
        )
    )
    if not found:
        raise SystemExit(f"{sys.executable} has no Blender module (bpy) to build with.")
    run = subprocess.run(
        [sys.executable, str(found[-1]), *command], capture_output=True, text=True, check=False
    )
    if run.returncode != 0:
        raise SystemExit(f"blender_ext {command[0]}:\n{run.stdout}{run.stderr}")


def build(*, platform: str, wheels_folder: Path | None, output: Path, small: bool = False) -> Path:
    """Build and validate the zip in `output`, unless it is there already; its path."""
    wheels: list[Path] = []
    if wheels_folder is not None:
        found = wheels_of(wheels_folder, platform, small=small).glob("*/*.whl")
        wheels = sorted({wheel.name: wheel for wheel in found}.values())
        if not wheels:
            raise SystemExit(f"{wheels_folder} has no wheels for {platform}; run `make wheels`.")
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    suffix = platform.replace("-", "_") if wheels else "nowheels"  # as Blender's builder does
    name = "tvbrdf-small" if small else "tvbrdf"
    target = output / f"{name}-{version}-{suffix}.zip"
    stamp = target.with_suffix(".sha256")
    output.mkdir(parents=True, exist_ok=True)
    digest = content_hash(wheels)
    if target.is_file() and stamp.is_file() and stamp.read_text() == digest:
        return target
    with tempfile.TemporaryDirectory(dir=output) as scratch:
        source, built = Path(scratch) / "source", Path(scratch) / target.name
        stage(source, platform, wheels)
        blender_ext("build", "--source-dir", str(source), "--output-filepath", str(built))
        blender_ext("validate", str(built))
        built.replace(target)  # whole or not at all, should two build at once
        stamp.write_text(digest)
    return target


def make_repository(*, zips: list[Path], output: Path) -> None:
    """Make `output` hold these zips and what Blender asks a repository for, and nothing else."""
    with tempfile.TemporaryDirectory(dir=output.parent) as scratch:
        made = Path(scratch) / "repository"
        made.mkdir()
        for each in zips:
            shutil.copyfile(each, made / each.name)
        blender_ext("server-generate", "--repo-dir", str(made), "--html")
        shutil.rmtree(output, ignore_errors=True)
        made.replace(output)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    collecting, building = commands.add_parser("wheels"), commands.add_parser("build")
    for command in (collecting, building):
        command.add_argument("--platform", choices=sorted(TAGS), default=here())
        command.add_argument("--output", type=Path, required=True)
        command.add_argument("--small", action="store_true", help="without torch")
    collecting.add_argument("--python", action="append", required=True)
    collecting.add_argument("--torch-index", default=TORCH_INDEX)
    building.add_argument("--wheels", required=True, help="a folder, or none")
    listing = commands.add_parser("repository")
    listing.add_argument("--output", type=Path, required=True)
    listing.add_argument("zips", type=Path, nargs="+", metavar="ZIP")
    arguments = parser.parse_args()
    if arguments.command == "repository":
        make_repository(zips=arguments.zips, output=arguments.output.resolve())
        return
    if arguments.platform is None:
        raise SystemExit("No wheels are known for this machine; name a --platform.")
    if arguments.command == "wheels":
        collect_wheels(
            platform=arguments.platform,
            pythons=arguments.python,
            output=arguments.output.resolve(),
            torch_index=arguments.torch_index,
            small=arguments.small,
        )
        return
    wheels = None if arguments.wheels == "none" else Path(arguments.wheels).resolve()
    zip_file = build(
        platform=arguments.platform,
        wheels_folder=wheels,
        output=arguments.output.resolve(),
        small=arguments.small,
    )
    print(zip_file)
    print(f"{zip_file.name}: {zip_file.stat().st_size / 1e6:.1f} MB", file=sys.stderr)


if __name__ == "__main__":
    main()
