"""A job of a batch: a body to be analyzed, its files' names and its key.

A job's key is the SHA-256 of its file's content, of its options and of the method's version:
jobs with the same key have the same model.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from struck.analysis.analysis import analyze
from struck.analysis.cached_steps import fingerprint, method
from struck.batch.strike_set import StrikeSet
from struck.errors import FileFormatError
from struck.files.atomic import is_file, open_ordinary, read_bytes
from struck.files.messages import ReadingLimits
from struck.model.material import Material

MODEL, FACTS = ".struck", ".facts.json"  # endings of a job's model, and of its facts
OPTIONS = {  # of `analyze`, with their defaults
    name: each.default
    for name, each in inspect.signature(analyze).parameters.items()
    if name not in {"body", "material", "cache", "progress"}
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyJob:
    """A body to be analyzed, and where its model goes."""

    file: str
    output: str  # of its files below the folder, with "/" between, without an ending
    material: Material | str
    options: Mapping[str, Any]  # of `analyze`
    strikes: StrikeSet | None = None
    cache: bool | str = True
    content: str = ""  # SHA-256 of the file
    key: str = ""

    def with_key(self) -> BodyJob:
        """Return the job with its key, once its file has been read; OSError where it cannot be."""
        damping, content = self.options.get("damping", "own"), self.content or content_of(self.file)
        material = Material.of(self.material, damping)
        strikes = None if self.strikes is None else (self.strikes.plain, self.output)
        options = {
            name: inspect.getsource(value) if inspect.isfunction(value) else value
            for name, value in sorted(self.options.items())
            if value is not OPTIONS[name] and name != "damping"
        }
        with suppress(KeyError, TypeError, ValueError):  # 20 is 20.0; errors are reported later
            options["band"] = tuple(map(float, options["band"]))
        key = fingerprint((method(), content, material, options, strikes))
        return replace(self, content=content, key=key)

    def for_part(self, name: str) -> BodyJob:
        """Return the job of one body of several."""
        output = "-".join((self.output, re.sub(r"[^\w.-]", "_", name)))
        return replace(self, output=output, options={**self.options, "part": name}).with_key()

    def path(self, folder: Path, ending: str = MODEL) -> Path:
        """Return the path of one of a job's output files."""
        return folder / f"{self.output}{ending}"


def content_of(file: str) -> str:
    """Return the SHA-256 of a mesh file and a glTF's buffers; OSError without it."""
    path, digest = Path(file), hashlib.sha256()
    for file_path in (path, *_companions(path)):
        with open_ordinary(file_path) as stream:
            size = os.fstat(stream.fileno()).st_size
            digest.update(size.to_bytes(8, "little"))
            if size <= ReadingLimits().size:  # no reader takes a larger one
                digest.update(hashlib.sha256(stream.read()).digest())
    return digest.hexdigest()


def _companions(path: Path) -> list[Path]:
    """Return the files that a glTF file names and that are there."""
    try:
        buffers = json.loads(read_bytes(path))["buffers"] if path.suffix.lower() == ".gltf" else ()
        paths = [path.with_name(str(buffer.get("uri"))) for buffer in buffers]
    except (FileFormatError, ValueError, LookupError, AttributeError, TypeError, RecursionError):
        return []
    return [companion for companion in paths if is_file(companion)]
