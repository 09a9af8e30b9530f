"""Whether `age` still writes what it wrote at another revision, to the bit.

    python -m tests.benchmarks.same_maps --against REVISION [--size 256] [--frames 36]

Ages twelve texture sets with three models at draft and balanced, and three measured BRDFs,
with the code of REVISION and with that of the working tree, and compares every file.  It needs the
data (`TVBRDF_DATA`).  Exit code 0 only where all are the same.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODELS = ("rust", "patina", "char")
QUALITIES = ("draft", "balanced")

# Runs in either tree: what it imports is the promise that both keep.
_AGE_ALL = """
import json, sys
from pathlib import Path
from model_runtime.age import AgeRequest, age

class Silent:
    def progress(self, stage, fraction): pass
    def warning(self, message): pass
    def cancelled(self): return False

for job in json.load(sys.stdin):
    age(AgeRequest(**{**job, "input": Path(job["input"]), "output": Path(job["output"])}), Silent())
"""


def jobs(data: Path, size: int, frames: int) -> dict[str, dict[str, object]]:
    """What to age, by a name that says what it is: fields of `AgeRequest`, without the output."""
    found: dict[str, dict[str, object]] = {}
    for folder in sorted(path for path in (data / "pbr").iterdir() if path.is_dir()):
        for ntm in MODELS:
            for quality in QUALITIES:
                found[f"{folder.name} {ntm} {quality}"] = {
                    "input": str(folder),
                    "ntm": ntm,
                    "quality": quality,
                    "size": size,
                    "frames": frames,
                }
    measured = sorted((data / "bsdf").glob("*.bsdf"))
    for file, ntm in zip((*measured, measured[0]), MODELS, strict=True):
        found[f"{file.stem} {ntm}"] = {"input": str(file), "ntm": ntm, "frames": frames}
    return found


def digests(tree: Path, wanted: dict[str, dict[str, object]], folder: Path) -> dict[str, str]:
    """SHA-256 of every EXR that the code in `tree` writes, by job and file name."""
    places = {name: folder / str(number) for number, name in enumerate(wanted)}
    lines = [job | {"output": str(places[name])} for name, job in wanted.items()]
    subprocess.run(
        [sys.executable, "-c", _AGE_ALL],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": str(tree)},
        input=json.dumps(lines).encode(),
        check=True,
    )
    return {
        f"{name} {path.name}": hashlib.sha256(path.read_bytes()).hexdigest()
        for name, place in places.items()
        for path in sorted(place.glob("*.exr"))
    }


@contextlib.contextmanager
def checkout(revision: str, folder: Path) -> Iterator[Path]:
    """The files of a revision, for as long as the context lasts."""
    git = ["git", "-C", str(ROOT), "worktree"]
    subprocess.run([*git, "add", "--quiet", "--detach", str(folder), revision], check=True)
    try:
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--against", required=True, metavar="REVISION")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--frames", type=int, default=36)
    options = parser.parse_args()
    data = Path(os.environ.get("TVBRDF_DATA") or ROOT.parent / "shared" / "data").resolve()
    if not (data / "README.md").is_file():
        parser.error(f"the data is not at {data}; set TVBRDF_DATA")
    wanted = jobs(data, options.size, options.frames)
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        with checkout(options.against, place / "before") as before:
            old = digests(before, wanted, place / "old")
        new = digests(ROOT, wanted, place / "new")
    other = sorted(name for name in old.keys() | new.keys() if old.get(name) != new.get(name))
    print(f"{len(wanted)} runs, {len(old)} files: {len(other)} differ")
    for name in other[:20]:
        print(f"  {name}")
    return 1 if other or not old else 0


if __name__ == "__main__":
    sys.exit(main())
