"""A worker that is lost, and an extension that is taken away, while Blender's real program runs.

Only the program leaves SIGPIPE at its default, has modal operators, a dispatcher of commands and
an end of its own.  The worker is `stub_worker.py`, beside this script.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import bpy
from windowed_steps import (
    DRAWN,
    EXCHANGE,
    EXTENSION,
    Steps,
    away_with_the_splash_screen,
    ended,
    go_through,
    key,
    outcome,
    redraw,
    session,
    show_panel,
    until,
)

QUIT = "--quit-in-a-run"
STUB = str(EXCHANGE / "stub_worker.py")
LEAVES = """
import json, sys
print(json.dumps({"type": "ready", "protocol": 1}), flush=True)
"""


def material() -> bpy.types.Material:
    return bpy.data.materials["Material"]


def build_scene() -> None:
    settings = material().tvbrdf
    settings.steps, settings.size, settings.onset = 4, 16, "none"
    bpy.context.scene.frame_end = 40
    bpy.ops.wm.save_as_mainfile(filepath=str(EXCHANGE / "lost.blend"))


def age(seconds: float = 0.1) -> str:
    """Age here and now; empty, or why it failed."""
    os.environ["TVBRDF_STUB_SECONDS"] = str(seconds)
    try:
        assert bpy.ops.tvbrdf.age_material(material="Material") == {"FINISHED"}
    except RuntimeError as error:
        return str(error)
    return ""


def with_worker(path: str) -> None:
    session().stop_worker()
    os.environ["TVBRDF_WORKER"] = path


def start(window: bpy.types.Window | None = None) -> Steps:
    """Begin a long run as the button does, and let it come to the worker."""
    with_worker(STUB)
    os.environ["TVBRDF_STUB_SECONDS"] = "60"
    material().tvbrdf.steps = 600
    with bpy.context.temp_override(window=window or bpy.context.window):
        begun = bpy.ops.tvbrdf.age_material("INVOKE_DEFAULT", material="Material")
    assert begun == {"RUNNING_MODAL"}, begun
    assert any("tvbrdf" in each.bl_idname.lower() for each in modal_operators())
    yield from until(lambda: session().current().fraction > 0.01)


def modal_operators() -> list[bpy.types.Operator]:
    windows = bpy.context.window_manager.windows
    return [each for window in windows for each in window.modal_operators]


def nothing_is_left() -> bool:
    return not list((EXCHANGE / "aged").glob(".*partial*"))


def loses_its_worker() -> Steps:
    assert signal.getsignal(signal.SIGPIPE) == signal.SIG_DFL, "nothing here would prove anything"
    assert age() == ""
    worker = session()._worker
    first = worker.pid
    os.kill(first, signal.SIGKILL)
    while worker.alive:
        time.sleep(0.01)
    assert age() == ""
    assert worker.pid != first
    yield DRAWN
    # Killed, then spoken to before anybody has looked.
    os.kill(worker.pid, signal.SIGKILL)
    age()
    # While more is written than a pipe holds.
    age()
    os.kill(worker.pid, signal.SIGSTOP)
    worker.send("info", {"ntm": "x" * (1 << 23)})
    os.kill(worker.pid, signal.SIGKILL)
    yield DRAWN
    (EXCHANGE / "leaves.py").write_text(LEAVES)
    with_worker(str(EXCHANGE / "leaves.py"))
    assert "The worker ended (0)" in age()
    with_worker(str(EXCHANGE / "missing.py"))
    assert "There is no worker at" in age()
    with_worker(STUB)
    assert age() == ""
    assert signal.getsignal(signal.SIGPIPE) == signal.SIG_DFL, "it is not ours to change"


def notices_a_worker_that_stands_still() -> Steps:
    yield from start()
    os.kill(session()._worker.pid, signal.SIGSTOP)
    stopped = time.monotonic()
    yield from until(ended, 30)
    assert 8 < time.monotonic() - stopped < 16
    assert "no sign of life for 10 seconds" in outcome()
    assert nothing_is_left()


def is_free_again(worker: object) -> Steps:
    """After whatever took the extension away in the middle of a run."""
    yield DRAWN
    assert not worker.alive
    assert ended()
    assert bpy.ops.tvbrdf.age_material.poll()
    assert not any("tvbrdf" in each.bl_idname.lower() for each in modal_operators())
    assert nothing_is_left()
    material().tvbrdf.steps = 4
    assert age() == ""
    bpy.ops.tvbrdf.revert(material="Material")
    yield DRAWN


def is_disabled_and_enabled() -> Steps:
    import addon_utils

    yield from start()
    worker = session()._worker
    addon_utils.disable(EXTENSION)
    addon_utils.enable(EXTENSION)
    yield from is_free_again(worker)


def is_reloaded() -> Steps:
    """Reload Scripts waits for modal operators to end; then what it loads works."""
    yield from start()
    worker = session()._worker
    with contextlib.suppress(RuntimeError):
        bpy.ops.script.reload()
    assert not ended()
    yield from key("Escape")
    yield from until(ended)
    bpy.ops.script.reload()
    yield from is_free_again(worker)


def is_updated() -> Steps:
    yield from start()
    worker = session()._worker
    bpy.ops.extensions.package_install_files(
        filepath=str(EXCHANGE / ".extension.zip"), repo="user_default", enable_on_install=True
    )
    yield from is_free_again(worker)


def loses_its_window() -> Steps:
    before = set(bpy.context.window_manager.windows)
    bpy.ops.wm.window_new()
    (second,) = set(bpy.context.window_manager.windows) - before
    yield DRAWN
    yield from start(second)
    worker = session()._worker
    with bpy.context.temp_override(window=second):
        bpy.ops.wm.window_close()
    yield from until(ended)
    assert "its window was closed" in outcome()
    session().stop_worker()
    yield from is_free_again(worker)


def loses_its_area() -> Steps:
    """Where the button was pressed there is another editor now."""
    yield from start()
    for area in bpy.context.window.screen.areas:
        area.ui_type = "TEXT_EDITOR"
    yield DRAWN
    assert not ended()
    yield from key("Escape")
    yield from until(ended)
    assert "Canceled" in outcome()
    yield from show_panel()


def draws_a_report_that_never_ends() -> Steps:
    material().tvbrdf.steps = 4
    assert age() == ""
    report = Path(bpy.path.abspath(material().tvbrdf.folder)) / "aged.json"
    for replace in (
        lambda: os.mkfifo(report),
        lambda: report.symlink_to("/dev/zero"),
        lambda: report.write_text("[" * 100_000),
        lambda: report.mkdir(),
    ):
        report.rmdir() if report.is_dir() else report.unlink()
        replace()
        drawn = time.monotonic()
        redraw()
        yield DRAWN
        assert time.monotonic() - drawn < 3 * DRAWN
    bpy.ops.tvbrdf.revert(material="Material")


def command(*words: str, seconds: float = 60) -> subprocess.Popen[str]:
    """`--command age_material` in a second Blender, which has no window."""
    path = f"import sys; sys.path.insert(0, {str(EXCHANGE / 'site-packages')!r})"
    blender = ["blender", "-b", str(EXCHANGE / "lost.blend"), "--python-expr", path]
    words = ("--ntm", "rust", "--frames", "1-40", "--steps", "600", *words)
    return subprocess.Popen(
        [*blender, "--command", "age_material", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TVBRDF_STUB_SECONDS": str(seconds)},
    )


def is_interrupted() -> Steps:
    for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        output, saved = EXCHANGE / f"output{code}", EXCHANGE / f"saved{code}.blend"
        run = command("--material", "Material", "--output", str(output), "--save-as", str(saved))
        while "modeling" not in run.stdout.readline().lower():
            assert run.poll() is None, run.stderr.read()
        run.send_signal(number)
        _, errors = run.communicate(timeout=30)
        assert run.returncode == code, (run.returncode, errors)
        assert "Canceled" in errors
        assert "Traceback" not in errors
        assert not saved.exists()
        assert list(output.iterdir()) == []
        yield DRAWN


def quits() -> Steps:
    """Quit while a run goes on, in a Blender of its own."""
    told = EXCHANGE / "worker.pid"
    start = str(EXCHANGE / "start.py")
    other = subprocess.run(
        ["blender", "--gpu-backend", "opengl", "--python", start, "--", QUIT],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert other.returncode == 0, other.stdout + other.stderr
    worker = int(told.read_text())
    yield DRAWN
    assert not Path(f"/proc/{worker}/cmdline").exists() or not (
        Path(f"/proc/{worker}/cmdline").read_bytes()
    )
    assert nothing_is_left()


def quit_in_a_run() -> Steps:
    bpy.ops.wm.open_mainfile(filepath=str(EXCHANGE / "lost.blend"))
    yield DRAWN
    yield from start()
    (EXCHANGE / "worker.pid").write_text(str(session()._worker.pid))
    bpy.ops.wm.quit_blender()
    yield 30.0


def everything() -> Steps:
    os.environ["TVBRDF_WORKER"] = STUB
    yield from away_with_the_splash_screen()
    build_scene()
    yield from show_panel()
    for each in (
        loses_its_worker,
        notices_a_worker_that_stands_still,
        is_disabled_and_enabled,
        is_reloaded,
        is_updated,
        loses_its_window,
        loses_its_area,
        draws_a_report_that_never_ends,
        is_interrupted,
        quits,
    ):
        print(each.__name__, flush=True)
        yield from each()


go_through(quit_in_a_run() if QUIT in sys.argv else everything(), "windowed worker")
