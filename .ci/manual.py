"""The manual that comes with the extension: one page, of what docs/ says to artists."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CHAPTERS = ("docs/tutorial.md", "docs/blender.md")
PICTURE = re.compile(r"!\[[^\]]*\]\(([^)]*)\)")
PAGE = "manual/manual.html"
ELSEWHERE = re.compile(r"(?<!!)\[([^\]]*)\]\((?!https?:)[^)]*\)")
"""Links to other pages of the repository, which do not come with the extension."""
STYLE = (
    "body { max-width: 46em; margin: 3em auto; padding: 0 1em; font: 17px/1.5 sans-serif; }"
    "img { max-width: 100%; } td, th { padding: 0.2em 0.8em; text-align: left; }"
)


def _text() -> str:
    return "\n\n".join((ROOT / each).read_text(encoding="utf-8") for each in CHAPTERS)


def sources() -> Iterator[Path]:
    """The files that it is made of."""
    yield from (ROOT / each for each in CHAPTERS)
    yield from (ROOT / "docs" / each for each in PICTURE.findall(_text()))


def write_manual(folder: Path) -> None:
    """Write the page, with its pictures beside it, into the extension at `folder`."""
    from markdown import markdown  # only here: wheels are collected before anything is installed

    page = folder / PAGE
    for picture in PICTURE.findall(_text()):
        copy = page.parent / picture
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / "docs" / picture, copy)
    body = markdown(
        ELSEWHERE.sub(r"\1", _text()), extensions=["tables", "sane_lists"], tab_length=3
    )
    head = f'<meta charset="utf-8"><title>Age Material</title><style>{STYLE}</style>'
    page.write_text(f"<!DOCTYPE html>{head}\n{body}\n", encoding="utf-8")
