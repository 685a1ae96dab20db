"""What one foreign file may cost."""

from __future__ import annotations

from dataclasses import dataclass

# What a reading process exits with when its memory does not suffice: an answer would need some.
OUT_OF_MEMORY = 77


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Bounds within which a mesh file is read.

    Parameters
    ----------
    size : int
        Bytes of a file with all that belongs to it, packed or not.
    memory : int
        Address space of the process that reads, with its interpreter, bytes; held where the
        system can (Linux, not Windows).
    seconds : float
        Wall time for one file, s.
    vertices, faces, parts : int
        How many of them a file may hold; faces are triangles.
    """

    size: int = 256 * 2**20
    memory: int = 2 * 2**30
    seconds: float = 10.0
    vertices: int = 15_000_000
    faces: int = 5_000_000
    parts: int = 10_000

    @property
    def answer(self) -> int:
        """Bytes that all vertices and faces take up together."""
        return 24 * (self.vertices + self.faces)
