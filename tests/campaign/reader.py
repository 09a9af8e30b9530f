"""A child that reads as the add-on does, without Blender: reports, times to come, lists of models.

It answers one JSON request a line: `{"report": FOLDER}`, `{"rates": FILE}` or `{"models": FOLDER}`,
with what the panel would say.  A wrong way out is a traceback, as it would be in Blender.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

import tests.conftest  # noqa: F401, it lets the extension be imported
from tvbrdf.model_runtime.model_files.weights import list_models
from tvbrdf.tvbrdf_addon.estimate import in_bytes, in_time
from tvbrdf.tvbrdf_addon.rates import Rates, Work
from tvbrdf.tvbrdf_addon.sentences import report_in


def _report(folder: Path) -> list[str]:
    report = report_in(folder)
    if report is None:
        return []
    return [*report.sentences, *report.warnings, report.change("affine"), str(report.size)]


def _rates(path: Path) -> list[str]:
    expected = Rates.load(path).of(Work(1 << 20, 36, "balanced", "affine"))
    return [in_time(expected.seconds), in_bytes(expected.bytes)]


def _models(folder: Path) -> list[str]:
    cards = list_models((folder,))
    # What Blender does with them: a menu needs text that is UTF-8.
    return [card.name for card in cards if f"{card.name}{card.title}{card.description}".encode()]


_READERS = {"report": _report, "rates": _rates, "models": _models}


def main() -> None:
    """Answer until stdin closes."""
    for line in sys.stdin:
        request: dict[str, Any] = json.loads(line)
        ((what, path),) = request.items()
        print(json.dumps({"said": _READERS[what](Path(os.fsdecode(path)))}), flush=True)


if __name__ == "__main__":
    main()
