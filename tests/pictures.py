"""Pictures written by their specifications, not by the libraries that read them."""

from __future__ import annotations

import struct
import zlib

import numpy as np


def png(pixels: np.ndarray) -> bytes:
    """A PNG of [H, W, C] uint16, written by the specification, rows filtered in turn by 0, 1, 2."""
    height, width, channels = pixels.shape
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    step, rows, before = 2 * channels, b"", np.zeros(2 * channels * width, np.uint8)
    for y in range(height):
        row = np.frombuffer(pixels[y].astype(">u2").tobytes(), np.uint8)
        left = np.concatenate((np.zeros(step, np.uint8), row[:-step]))
        rows += bytes([y % 3]) + (row, row - left, row - before)[y % 3].tobytes()
        before = row

    def chunk(name: bytes, data: bytes) -> bytes:
        checked = name + data
        return struct.pack(">I", len(data)) + checked + struct.pack(">I", zlib.crc32(checked))

    header = struct.pack(">IIBBBBB", width, height, 16, kind, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def tiff(pixels: np.ndarray, *, deflate: bool) -> bytes:
    """A little-endian TIFF of [H, W, 3] uint16 in one strip, written by the specification."""
    height, width, _ = pixels.shape
    data = pixels.astype("<u2").tobytes()
    data = zlib.compress(data) if deflate else data
    entries = [
        (256, 4, 1, width),
        (257, 4, 1, height),
        (258, 3, 3, 8),
        (259, 3, 1, 8 if deflate else 1),
        (262, 3, 1, 2),
        (273, 4, 1, 14),
        (277, 3, 1, 3),
        (278, 4, 1, height),
        (279, 4, 1, len(data)),
    ]
    table = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    body = struct.pack("<3H", 16, 16, 16) + data
    return (
        struct.pack("<2sHI", b"II", 42, 8 + len(body))
        + body
        + struct.pack("<H", len(entries))
        + table
        + b"\0\0\0\0"
    )


def interlaced(codes: np.ndarray) -> bytes:
    """An Adam7 PNG of [H, W] uint8, by the specification: seven passes, each coarser before."""
    rows = b""
    for y, x, down, right in (
        *((0, 0, 8, 8), (0, 4, 8, 8), (4, 0, 8, 4), (0, 2, 4, 4), (2, 0, 4, 2)),
        *((0, 1, 2, 2), (1, 0, 2, 1)),
    ):
        part = codes[y::down, x::right]
        if part.size:
            rows += b"".join(b"\0" + row.tobytes() for row in part)

    def chunk(name: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    header = struct.pack(">IIBBBBB", codes.shape[1], codes.shape[0], 8, 0, 0, 0, 1)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(rows))
        + chunk(b"IEND", b"")
    )


def attribute(name: str, kind: str, value: bytes) -> bytes:
    return b"%s\0%s\0" % (name.encode(), kind.encode()) + struct.pack("<i", len(value)) + value


def tiled_exr(levels: list[np.ndarray]) -> bytes:
    """An EXR of one channel Y with a tile a level, written by the specification."""
    height, width = levels[0].shape
    box = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"Y\0" + struct.pack("<iB3xii", 1, 0, 1, 1) + b"\0"
    head = struct.pack("<ii", 20000630, 2 | 0x200)
    head += attribute("channels", "chlist", channel)
    head += attribute("compression", "compression", b"\0")
    head += attribute("dataWindow", "box2i", box) + attribute("displayWindow", "box2i", box)
    head += attribute("lineOrder", "lineOrder", b"\0")
    head += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", bytes(8))
    head += attribute("screenWindowWidth", "float", struct.pack("<f", 1))
    head += attribute("tiles", "tiledesc", struct.pack("<IIB", width, height, len(levels) > 1))
    head += b"\0"
    table, body = b"", b""
    for k, level in enumerate(levels):
        table += struct.pack("<Q", len(head) + 8 * len(levels) + len(body))
        data = level.astype("<f2").tobytes()
        body += struct.pack("<5i", 0, 0, k, k, len(data)) + data
    return head + table + body
