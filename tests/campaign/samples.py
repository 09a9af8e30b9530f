"""Honest inputs, made once for a campaign: what the trials damage, and what they must not."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from PIL import Image

from .programs import ROOT

__all__ = ("MODELS", "ModelFile", "Samples", "exr")

MODELS = ROOT / "model_runtime" / "models"
SIDE = 8


def exr(path: Path, **channels: np.ndarray) -> None:
    """Write float channels [H, W], as other programs do."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    planes = {name: np.ascontiguousarray(plane, np.float32) for name, plane in channels.items()}
    OpenEXR.File(header, planes).write(str(path))


@dataclass(frozen=True)
class ModelFile:
    """A model file or checkpoint in its parts, to put together again with one of them changed.

    `key` is the name of its card in the header: a checkpoint's is "record".
    """

    header: dict[str, Any]
    card: dict[str, Any]
    body: bytes
    key: str

    @classmethod
    def read(cls, path: Path, key: str = "card") -> ModelFile:
        content = path.read_bytes()
        (length,) = struct.unpack_from("<Q", content)
        header = json.loads(content[8 : 8 + length])
        return cls(header, json.loads(header["__metadata__"][key]), content[8 + length :], key)

    def content(self, *, card: str | None = None, header: bytes | None = None) -> bytes:
        """The file, with other JSON texts for its card or its whole header."""
        if header is None:
            text = json.dumps(self.card) if card is None else card
            header = json.dumps({**self.header, "__metadata__": {self.key: text}}).encode()
        header += b" " * (-len(header) % 8)
        return struct.pack("<Q", len(header)) + header + self.body


@dataclass(frozen=True)
class Samples:
    """Each is made in `folder` when it is first asked for; what programs make lies in `made`."""

    folder: Path
    made: Path

    @cached_property
    def textures(self) -> Path:
        """Color, roughness and metalness of 8 x 8 texels."""
        folder, rng = self._new("textures"), np.random.default_rng(0)
        for name, channels in (("Color", 3), ("Roughness", 1), ("Metalness", 1)):
            codes = (rng.random((SIDE, SIDE, channels)) * 255).astype(np.uint8)
            Image.fromarray(codes.squeeze()).save(folder / f"M_{name}.png")
        return folder

    @cached_property
    def torrance_sparrow(self) -> Path:
        """kd, ks and alpha of 8 x 8 texels."""
        folder = self._new("torrance-sparrow")
        self.write_torrance_sparrow(folder, "", 0)
        return folder

    @cached_property
    def sequence(self) -> Path:
        """Three frames to train on."""
        folder = self._new("sequence")
        for k in (1, 2, 3):
            self.write_torrance_sparrow(folder, f"_{k:04d}", k)
        return folder

    @cached_property
    def rgl(self) -> bytes:
        """A small isotropic `.bsdf`."""
        return _tensor_file(
            {
                "phi_i": np.zeros(1, "<f4"),
                "theta_i": np.linspace(0, np.pi / 2, 3, dtype="<f4"),
                "sigma": np.full((2, 8), 0.5, "<f4"),
                "ndf": np.full((2, 8), 0.3, "<f4"),
                "vndf": np.full((1, 3, 6, 5), 0.2, "<f4"),
                "luminance": np.ones((1, 3, 4, 4), "<f4"),
                "rgb": np.full((1, 3, 3, 4, 4), 0.2, "<f4"),
            }
        )

    @cached_property
    def merl(self) -> bytes:
        """A `.binary` of the least variety: its size is fixed."""
        values = np.full((3, 90, 90, 180), 300.0, "<f8")
        return np.array([90, 90, 180], "<i4").tobytes() + values.tobytes()

    @cached_property
    def model(self) -> ModelFile:
        return ModelFile.read(MODELS / "rust.safetensors")

    @cached_property
    def encoder(self) -> ModelFile:
        return ModelFile.read(MODELS / "encoder.safetensors")

    @cached_property
    def hidden_giant(self) -> bytes:
        """A small EXR file whose second part, which nobody needs, takes a gigabyte when read."""
        small = {name: np.full((SIDE, SIDE), 0.5, np.float32) for name in "RGB"}
        window = (np.zeros(2, np.int32), np.full(2, SIDE - 1, np.int32))
        header = {"type": OpenEXR.scanlineimage, "displayWindow": window}
        plane = np.zeros((4096, 4096), np.float32)
        parts = [
            OpenEXR.Part(dict(header), channels, name)
            for name, channels in (("rgb", small), ("z", {f"z{k}": plane for k in range(16)}))
        ]
        path = self.folder / "hidden.exr"
        OpenEXR.File(parts).write(str(path))
        return path.read_bytes()

    @property
    def earlier(self) -> Path:
        """A result of another model."""
        return self.made / "earlier"

    @property
    def trained(self) -> Path:
        """A folder with a trained model and its checkpoints."""
        return self.made / "trained"

    def write_torrance_sparrow(self, folder: Path, ending: str, seed: int) -> None:
        rng = np.random.default_rng(seed)
        for name in ("kd", "ks", "alpha"):
            planes = rng.random((3, SIDE, SIDE)) * 0.4 + 0.05 * (1 + seed)
            channels = (
                dict(zip("RGB", planes, strict=True)) if name != "alpha" else {"Y": planes[0]}
            )
            exr(folder / f"{name}{ending}.exr", **channels)

    def _new(self, name: str) -> Path:
        folder = self.folder / name
        folder.mkdir(parents=True)
        return folder


def _tensor_file(fields: dict[str, np.ndarray]) -> bytes:
    """Float arrays as the RGL database stores them."""
    table = sum(2 + len(name) + 2 + 1 + 8 + 8 * array.ndim for name, array in fields.items())
    header = b"tensor_file\0" + struct.pack("<BBI", 1, 0, len(fields))
    offset, data = len(header) + table, b""
    for name, array in fields.items():
        header += struct.pack("<H", len(name)) + name.encode()
        header += struct.pack("<HBQ", array.ndim, 10, offset + len(data))
        header += struct.pack(f"<{array.ndim}Q", *array.shape)
        data += array.tobytes()
    return header + data
