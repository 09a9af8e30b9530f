"""What reports found, as JSON and as pages."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from model_runtime.errors import UsageError

__all__ = ("Result", "chosen", "image", "plain", "table", "write_report")


class Result:
    """A frozen dataclass that becomes a JSON object: `JSON` names its fields and properties, in
    order, each with the digits after the point that are kept (None: all of them).
    """

    JSON: ClassVar[tuple[tuple[str, int | None], ...]]

    def json(self) -> dict[str, Any]:
        """The object; NaN is null."""
        return {name: plain(getattr(self, name), digits) for name, digits in self.JSON}


def plain(value: Any, digits: int | None = None) -> Any:
    """JSON of results, mappings, sequences and numbers."""
    if isinstance(value, Result):
        return value.json()
    if isinstance(value, Mapping):
        return {name: plain(each, digits) for name, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(each, digits) for each in value]
    if isinstance(value, float) and math.isnan(value):
        return None
    return round(value, digits) if isinstance(value, float) and digits is not None else value


def chosen(kind: str, asked: Sequence[str] | None, known: Iterable[str]) -> tuple[str, ...]:
    """The names `asked` for, all that are `known` by default; UsageError for one that is not."""
    every = tuple(known)
    for name in asked or ():
        if name not in every:
            raise UsageError(f"There is no {kind} '{name}'.", f"Choose among {', '.join(every)}.")
    return tuple(asked or every)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    texts = ["| " + " | ".join(line) + " |" for line in lines]
    texts[1] = "|---" * len(head) + "|"
    return "\n".join(texts)


def image(file: str, text: str) -> str:
    """A picture in Markdown, with what it shows."""
    return f"![{text}]({file})"


def write_report(folder: Path, name: str, parts: Iterable[str], report: Result) -> None:
    """Write `name`.md, of paragraphs, and `name`.json to `folder`."""
    (folder / f"{name}.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    text = json.dumps(report.json(), indent=1)
    (folder / f"{name}.json").write_text(text, encoding="utf-8")
