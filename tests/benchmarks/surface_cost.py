"""What growing on a surface adds to a run in Blender, and what a wall of many objects takes.

    python -m tests.benchmarks.surface_cost [--faces 50000] [--objects 200] [--size 1024]

Ages an unwrapped object of so many faces everywhere at once, then by its surface, then again with
the maps that were kept, and once more where it is to start elsewhere; and so many objects of one
material, each unwrapped to the same square. Prints seconds of each run, how long processors were
busy with it, seconds of the surface's maps and of the worker, and the memory of both processes.
Needs Blender as a module.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np

import tests.conftest  # noqa: F401  (finds the extension in the working tree)
import tvbrdf
from tvbrdf.tvbrdf_addon import session
from tvbrdf.tvbrdf_addon.material.surface_maps import maps


def material_of(size: int) -> bpy.types.Material:
    material = bpy.data.materials.new("Steel")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    settings = material.tvbrdf
    settings.ntm, settings.use_camera_size, settings.size = "rust", False, size
    return material


def start(folder: Path, size: int) -> bpy.types.Material:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    material = material_of(size)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    return material


def ball(faces: int, material: bpy.types.Material) -> None:
    """A dented sphere of about so many faces, unwrapped to islands."""
    rings = round(np.sqrt(faces / 2))
    bpy.ops.mesh.primitive_uv_sphere_add(segments=2 * rings, ring_count=rings)
    mesh = bpy.context.object.data
    place = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", place)
    place = place.reshape(-1, 3)
    place *= 1 + 0.08 * np.sin(9 * place).prod(1, keepdims=True)
    mesh.vertices.foreach_set("co", place.ravel())
    mesh.materials.append(material)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.004)
    bpy.ops.object.mode_set(mode="OBJECT")


def wall(count: int, material: bpy.types.Material) -> None:
    """Blocks side by side and on top of each other, whose meshes are their own."""
    columns = int(np.ceil(np.sqrt(2 * count)))
    for number in range(count):
        row, column = divmod(number, columns)
        place = (column * 0.62 + 0.31 * (row % 2), 0, row * 0.32)
        bpy.ops.mesh.primitive_cube_add(size=1, location=place, scale=(0.6, 0.3, 0.3))
        bpy.context.object.data.materials.append(material)


def busy() -> float:
    """Seconds of a processor that this process and the worker have used, where the system tells."""
    worker = session._worker
    stat = Path(f"/proc/{worker.pid if worker is not None else 0}/stat")
    ticks = stat.read_text().rpartition(")")[2].split()[11:13] if stat.exists() else ()
    return time.process_time() + sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


def run(material: bpy.types.Material) -> tuple[float, float]:
    """Ages it; prints and returns the seconds that it took, and that processors were busy."""
    spent = []
    write = maps.write_surface

    def timed(*arguments, **settings):
        started = time.perf_counter()
        try:
            return write(*arguments, **settings)
        finally:
            spent.append(time.perf_counter() - started)

    maps.write_surface = timed
    started, used = time.perf_counter(), busy()
    try:
        result = session.age_and_wait(material, bpy.context.scene)
    finally:
        maps.write_surface = write
    took, used = time.perf_counter() - started, busy() - used
    worker = json.dumps(result.aged["seconds"])
    own = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
    print(
        f"  {took:.1f} s ({used:.1f} s busy), of it {sum(spent):.1f} s for maps; worker {worker}; "
        f"peak memory of the worker {result.aged['peak_rss_mb']:.0f} MB, of Blender {own} MB",
        *result.warnings,
        sep="\n    ",
        flush=True,
    )
    return took, used


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--faces", type=int, default=50_000)
    parser.add_argument("--objects", type=int, default=200)
    parser.add_argument("--size", type=int, default=1024)
    arguments = parser.parse_args()
    tvbrdf.register()
    with tempfile.TemporaryDirectory() as folder:
        material = start(Path(folder), 64)
        ball(32, material)
        session.age_and_wait(material, bpy.context.scene)  # starts the worker
        material = start(Path(folder), arguments.size)
        ball(arguments.faces, material)
        material.tvbrdf.onset = "none"
        print(f"{arguments.faces} faces, everywhere at once")
        without = run(material)
        material.tvbrdf.onset = "auto"
        for what in ("by the surface", "again, its maps kept", "again, with other places"):
            print(f"{arguments.faces} faces, {what}")
            if what.endswith("places"):
                material.tvbrdf.use_own_exposure = True
                material.tvbrdf.exposure.edges -= 0.2
            took, used = (a - b for a, b in zip(run(material), without, strict=True))
            print(f"  added: {took:.1f} s ({used:.1f} s busy)")
        material = start(Path(folder), arguments.size)
        wall(arguments.objects, material)
        for what in ("", ", its maps kept"):
            print(f"A wall of {arguments.objects} objects{what}")
            run(material)
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
