"""The pictures of `docs/tutorial.md`, made anew in a real Blender with a window.

    python tutorial.py FOLDER

Prints what the newcomer's clicks and seconds came to (`tests/blender/windowed_tutorial.py`), and
that viewports show the right age when they are first looked into (`windowed_first_visit.py`).
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.blender.windowed import HERE, run_in_window  # noqa: E402

Box = tuple[int, int, int, int]

SIDE = (1323, 334, 1600, 700)
PARTS: dict[str, Box] = {
    "start": SIDE,
    "progress": SIDE,
    "aged": (400, 30, 1600, 980),
    "more": (1310, 200, 1600, 560),
    "models": (175, 200, 1600, 680),
}
"""What of a screen of 1600 x 1000 is shown: left, top, right, bottom."""

CUBE = (400, 220, 980, 800)
AGES = 3
SMALL = 1080  # px a side at most
QUALITY = 86
MOST = 150_000  # bytes


def part(screen: Path, box: Box) -> Image.Image:
    return Image.open(screen).convert("RGB").crop(box)


def ages(screens: Path) -> Image.Image:
    """The cube at all ages, side by side."""
    side = SMALL // AGES
    row = Image.new("RGB", (side * AGES, side))
    for number in range(AGES):
        cube = part(screens / f"age_{number}.png", CUBE).resize(
            (side, side), Image.Resampling.LANCZOS
        )
        row.paste(cube, (number * side, 0))
    return row


def save(picture: Image.Image, path: Path) -> None:
    picture.thumbnail((SMALL, SMALL), Image.Resampling.LANCZOS)
    picture.save(path, quality=QUALITY, optimize=True)
    size = path.stat().st_size
    assert size <= MOST, f"{path} has {size} bytes"
    print(f"{path}: {size / 1000:.0f} kB")


def _go(screens: Path) -> None:
    """The newcomer's clicks; prints what they took."""
    said = run_in_window(HERE / "windowed_tutorial.py", screens, seconds=900, worker=True)
    print("\n".join(line for line in said.splitlines() if " s  " in line), flush=True)


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        screens = Path(place)
        print("Aging:")
        _go(screens)
        print("The same clicks, without aging:")
        (screens / "nothing_ages").touch()
        _go(screens)
        for name, box in PARTS.items():
            save(part(screens / f"{name}.png", box), folder / f"{name}.jpg")
        save(ages(screens), folder / "ages.jpg")
        first_visit = HERE / "windowed_first_visit.py"
        said = run_in_window(first_visit, screens, screen="900x700", worker=True)
        print("\n".join(line for line in said.splitlines() if "right at" in line))


if __name__ == "__main__":
    main()
