"""Blender's own program in a window, where there is one for tests (`windowed.py`).

`windowed_panel.py` looks at the panel, clicks in it and leaves screenshots, and
`windowed_worker.py` loses its worker in every way; both with `stub_worker.py` for a worker, as
that Blender's Python (3.13) has no torch.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.blender.windowed import HERE, ROOT, needs_window, run_in_window

STUB = ROOT / "tests" / "stub_worker.py"

pytestmark = [pytest.mark.slow, needs_window]


def test_panel_is_drawn_and_clicked(tmp_path: Path) -> None:
    run_in_window(HERE / "windowed_panel.py", tmp_path, STUB)
    starts = ("start_missing", "start_attribute", "start_new_image", "start_image")
    for shot in ("panel", "exact", "preview", "progress", "aged", *starts, "properties"):
        assert (tmp_path / f"{shot}.png").stat().st_size > 10_000


def test_the_program_survives_its_worker_and_its_extension(tmp_path: Path) -> None:
    run_in_window(HERE / "windowed_worker.py", tmp_path, STUB)


def test_a_newcomer_finds_the_way(tmp_path: Path) -> None:
    run_in_window(HERE / "windowed_newcomer.py", tmp_path, STUB, seconds=400)
    picking, aging = ("first", "copper", "doubt", "grid", "search"), ("progress", "aged")
    in_properties = ("properties", "drop_down", "row_progress", "row_aged")
    nothing = ("light", "no_material", "presets", "preferences")
    for shot in (*picking, *aging, *in_properties, "several", *nothing):
        assert (tmp_path / f"{shot}.png").stat().st_size > 10_000
