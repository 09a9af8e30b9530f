"""Kills the worker with signal 9 while it computes, then ages again.

python run_with_extension.py kill_worker.py FOLDER
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import bpy
import small_scene

folder = Path(sys.argv[1])
material = small_scene.build(folder)
killed: list[int] = []


def nodes() -> set[str]:
    return {node.name for node in material.node_tree.nodes}


def kill_when_computing() -> None:
    while not killed:
        for pid in small_scene.workers():
            if small_scene.mapped_torch(pid):
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
        time.sleep(0.01)


before = nodes()
threading.Thread(target=kill_when_computing, daemon=True).start()
try:
    outcome = bpy.ops.tvbrdf.age_material()
except RuntimeError as error:  # how an operator's error report reaches a script
    print("REPORT:", error)
    outcome = {"CANCELLED"}
assert killed, "there was no worker to kill"
assert outcome == {"CANCELLED"}
assert nodes() == before
assert not list(folder.rglob("*.exr")), "a killed run has left textures"
assert not material.tvbrdf.original

time.sleep(0.2)
assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
assert nodes() > before
