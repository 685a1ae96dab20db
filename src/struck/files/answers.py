"""What the process that reads files may answer, and nothing else."""

from __future__ import annotations

from struck.files.blocks import Blocks
from struck.files.frames import Frame
from struck.files.parts import Part
from struck.files.source import FORMATS


def surface_of(frame: Frame) -> tuple[str, list[Part]]:
    """Return the format of a mesh file and its parts; their numbers are not judged.

    Raises
    ------
    KeyError, TypeError, ValueError
        When the message says something else.
    """
    names = _texts(frame, "names")
    shapes = [(array.dtype.kind, array.shape[1]) for array in frame.arrays]
    if shapes != [("f", 3), ("i", 3)] * len(names):
        raise ValueError("its arrays are no surfaces")
    pairs = zip(names, frame.arrays[::2], frame.arrays[1::2], strict=True)
    parts = [Part(name=name, points=points, faces=faces) for name, points, faces in pairs]
    kind = str(frame.content["kind"])
    if kind not in FORMATS:
        raise ValueError("its format is none")
    return kind, parts


def blocks_of(frame: Frame) -> Blocks:
    """Return the blocks of a volume mesh; their numbers are not judged.

    Raises
    ------
    KeyError, TypeError, ValueError
        When the message says something else.
    """
    kinds = _texts(frame, "kinds")
    if [array.dtype.kind for array in frame.arrays] != ["f", *"i" * len(kinds)]:
        raise ValueError("its arrays are no elements")
    nodes, *cells = frame.arrays
    return Blocks(nodes=nodes, cells=list(zip(kinds, cells, strict=True)))


def _texts(frame: Frame, name: str) -> list[str]:
    texts = frame.content[name]
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise TypeError(f"its {name} are no texts")
    return texts
