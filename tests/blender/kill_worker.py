"""Kills the worker with signal 9 while it writes its result, then ages again.

python run_with_extension.py kill_worker.py FOLDER
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from pathlib import Path

import bpy
import small_scene

folder = Path(sys.argv[1])
material = small_scene.build(folder)
material.tvbrdf.size, material.tvbrdf.steps = 512, 36
killed: list[int] = []
ended = threading.Event()


def nodes() -> set[str]:
    return {node.name for node in material.node_tree.nodes}


def kill_when_writing() -> None:
    while not any(folder.rglob("*.exr*")):
        if ended.wait(0.005):
            return
    for pid in small_scene.workers():
        os.kill(pid, signal.SIGKILL)
        killed.append(pid)


before = nodes()
killer = threading.Thread(target=kill_when_writing)
killer.start()
try:
    outcome = bpy.ops.tvbrdf.age_material()
except RuntimeError as error:  # how an operator's error report reaches a script
    print("REPORT:", error)
    outcome = {"CANCELLED"}
ended.set()
killer.join()
assert killed, "there was no worker to kill"
assert outcome == {"CANCELLED"}
assert nodes() == before
assert not list(folder.rglob("*.exr*")), "a killed run has left textures"
assert not material.tvbrdf.original

material.tvbrdf.size, material.tvbrdf.steps = 64, small_scene.STEPS
assert bpy.ops.tvbrdf.age_material() == {"FINISHED"}
assert nodes() > before
