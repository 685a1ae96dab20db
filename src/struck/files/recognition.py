"""Recognition: the kind of a file by its content and its name, and the command that reads it.

Lists of readable endings come from the tables of the readers, so that a format which is read is
never called unknown.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from struck.errors import MeshError
from struck.files.atomic import is_file, open_ordinary
from struck.files.messages import FORMATS, PACKINGS, READERS
from struck.files.sound_formats import ENDINGS

MODELS = ("struck", "sofa")
SCENES = ("xml", "urdf", "mjcf")
SOUNDS = tuple(ending[1:] for ending in ENDINGS)
VOLUMES = tuple(ending[1:] for ending in READERS)
_FORMAT_NAMES = {"vtk": "VTK", "vtu": "VTU", "msh": "Gmsh", "inp": "Abaqus or CalculiX"}
_MESHES = ("surface", "volume")  # groups of files with a body in them
HEAD = 4096  # bytes from the beginning of a file, by which it is recognised
_CONTAINER = 16 * 2**20  # bytes of the longest header of a safetensors container

# What to do with a file of a group: the command that reads it, or how to come to one that is read.
_ADVICE: Mapping[str, str] = {
    "model": "struck info lists what it holds, and struck render lets it sound",
    "surface": "struck analyze makes a model of it",
    "volume": "struck analyze makes a model of it",
    "sound": "struck fit makes a model of recordings",
    "scene": "struck simulate lets its bodies move and sound",
    "table": "struck analyze-many and struck render --strikes read tables",
    "plan": "struck record and struck show read plans",
    "foreign scene": "open it in a 3D editor, as Blender, and export it as glb or obj",
    "foreign solid": "open it in a CAD program, as FreeCAD, and export it as stl or obj",
    "foreign elements": "write the volume mesh as inp, msh, vtk or vtu, as Gmsh does",
    "foreign sound": "convert it to WAV or FLAC, from which struck fit makes a model",
    "packed": "unpack it",
    "other": "give another file",
}
_NOUNS: Mapping[str, str] = {
    "model": "a model",
    "surface": "a mesh",
    "volume": "a volume mesh",
    "sound": "a sound",
    "scene": "a scene",
    "table": "a table",
    "plan": "a plan or settings",
    "foreign scene": "a scene of meshes",
    "foreign solid": "a CAD file",
    "foreign elements": "a volume mesh",
    "foreign sound": "a sound",
    "packed": "a packed file",
    "other": "a file",
}
# Names of formats by ending, in groups: first those that are not read.
_UNREAD_FORMATS: Mapping[str, Mapping[str, str]] = {
    "foreign scene": {
        "fbx": "FBX", "blend": "Blender", "dae": "COLLADA", "3ds": "3DS", "usd": "USD",
        "usda": "USD", "usdc": "USD", "usdz": "USD", "x3d": "X3D", "wrl": "VRML", "abc": "Alembic",
        "max": "3ds Max", "ma": "Maya", "mb": "Maya", "c4d": "Cinema 4D", "lwo": "LightWave",
        "skp": "SketchUp", "3mf": "3MF", "amf": "AMF", "vrm": "VRM", "unitypackage": "Unity",
        "uasset": "Unreal", "ztl": "ZBrush", "pcd": "PCD", "xyz": "XYZ", "las": "LAS",
    },
    "foreign solid": {
        "step": "STEP", "stp": "STEP", "iges": "IGES", "igs": "IGES", "brep": "BREP",
        "sldprt": "SolidWorks", "sldasm": "SolidWorks", "ipt": "Inventor", "iam": "Inventor",
        "catpart": "CATIA", "x_t": "Parasolid", "x_b": "Parasolid", "sat": "ACIS", "3dm": "Rhino",
        "f3d": "Fusion 360", "fcstd": "FreeCAD", "dwg": "DWG", "dxf": "DXF", "scad": "OpenSCAD",
        "jt": "JT", "prt": "NX or Creo", "ifc": "IFC",
    },
    "foreign elements": {
        "bdf": "Nastran", "nas": "Nastran", "op2": "Nastran", "unv": "UNV", "uff": "UFF",
        "med": "MED", "frd": "CalculiX result", "cdb": "Ansys", "rst": "Ansys result",
        "odb": "Abaqus result", "mph": "COMSOL", "mphtxt": "COMSOL", "exo": "Exodus",
        "e": "Exodus", "xdmf": "XDMF", "vtp": "VTP", "vtm": "VTM", "vtr": "VTR", "pvtu": "PVTU",
        "mesh": "Medit", "meshb": "Medit", "su2": "SU2", "k": "LS-DYNA", "fem": "OptiStruct",
        "feb": "FEBio",
    },
    "foreign sound": {
        "m4a": "M4A", "aac": "AAC", "mp4": "MP4", "mov": "MOV", "wma": "WMA", "webm": "WebM",
        "amr": "AMR", "3gp": "3GP",
    },
    "other": {
        "png": "PNG", "jpg": "JPEG", "jpeg": "JPEG", "svg": "SVG", "pdf": "PDF", "html": "HTML",
        "json": "JSON", "jsonl": "JSON", "txt": "text", "md": "Markdown", "py": "Python",
        "npz": "NumPy", "npy": "NumPy", "mat": "MATLAB", "pkl": "pickle", "pickle": "pickle",
        "h5": "HDF5", "hdf5": "HDF5", "parquet": "Parquet", "safetensors": "safetensors",
        "mtl": "material", "bin": "binary", "tar": "TAR", "rar": "RAR", "7z": "7z",
        "mid": "MIDI", "midi": "MIDI",
    },
}  # fmt: skip
# Then those that are, of which the readers' tables have the endings.
_READ_FORMATS: Mapping[str, Mapping[str, str]] = {
    "table": {"csv": "CSV", "tsv": "TSV"},
    "plan": {"toml": "TOML"},
    "scene": {name: name.upper() for name in SCENES},
    "sound": {name: name.upper() for name in (*SOUNDS, "opus", "au", "caf", "w64")},
    "volume": {**dict(zip(VOLUMES, VOLUMES, strict=True)), **_FORMAT_NAMES},
    "surface": {name: name.upper() for name in FORMATS} | {"gltf": "glTF"},
    "model": {"struck": "struck", "sofa": "SOFA"},
}
_NAMES: Mapping[str, tuple[str, str]] = {
    f".{ending}": (name, group)
    for table in (_UNREAD_FORMATS, _READ_FORMATS)
    for group, names in table.items()
    for ending, name in names.items()
}
# By the first bytes: the name of a format, and its group.
_SIGNATURES: tuple[tuple[bytes, str, str], ...] = (
    (rb"glTF", "GLB", "surface"),
    (rb"ply\s", "PLY", "surface"),
    (rb"(?:ST|C|N)*OFF\s", "OFF", "surface"),
    (rb"\s*solid\s.*\sfacet", "STL", "surface"),
    (rb"\s*\{.*\"asset\"\s*:.*\"version\"", "glTF", "surface"),
    (rb"# vtk DataFile", "VTK", "volume"),
    (rb"\s*(?:<\?xml[^>]*>\s*)?<VTKFile.*UnstructuredGrid", "VTU", "volume"),
    (rb"\s*\$MeshFormat", "Gmsh", "volume"),
    (rb"(?:\s|\*\*[^\n]*\n)*\*(?:HEADING|NODE)\b", "Abaqus or CalculiX", "volume"),
    (rb"RIFF....WAVE|RF64|riff", "WAV", "sound"),
    (rb"fLaC", "FLAC", "sound"),
    (rb"OggS", "OGG", "sound"),
    (rb"FORM....AIF", "AIFF", "sound"),
    (rb"ID3|\xff[\xfb\xf3\xf2]", "MP3", "sound"),
    (rb"....ftyp", "M4A or MP4", "foreign sound"),
    (rb"MThd", "MIDI", "other"),
    (rb"Kaydara FBX|; FBX ", "FBX", "foreign scene"),
    (rb"BLENDER", "Blender", "foreign scene"),
    (rb"PXR-USDC|#usda", "USD", "foreign scene"),
    (rb"\s*(?:<\?xml[^>]*>\s*)?<COLLADA", "COLLADA", "foreign scene"),
    (rb"\s*(?:<\?xml[^>]*>\s*)?(?:<!DOCTYPE[^>]*>\s*)?<X3D", "X3D", "foreign scene"),
    (rb"#VRML", "VRML", "foreign scene"),
    (rb"MM....\x02\x00\x0a\x00", "3DS", "foreign scene"),
    (rb"ISO-10303-21", "STEP", "foreign solid"),
    (rb"\s*(?:<\?xml[^>]*>\s*)?(?:<!--.*-->\s*)?<mujoco", "MJCF", "scene"),
    (rb"\s*(?:<\?xml[^>]*>\s*)?(?:<!--.*-->\s*)?<robot", "URDF", "scene"),
    (rb"\x89PNG", "PNG", "other"),
    (rb"\xff\xd8\xff", "JPEG", "other"),
    (rb"%PDF", "PDF", "other"),
    (rb"PK\x03\x04", "ZIP", "packed"),
    (rb"\x1f\x8b\x08", "gzip", "packed"),
    (rb"BZh[1-9]", "bzip2", "packed"),
    (rb"\xfd7zXZ\0", "xz", "packed"),
    (rb"\x93NUMPY", "NumPy", "other"),
    (rb"\x80[\x02-\x05]", "pickle", "other"),
    (rb"PAR1", "Parquet", "other"),
    (rb"\s*<!DOCTYPE html|\s*<html", "HTML", "other"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FileKind:
    """The kind of a file: the name of its format, and the group that it belongs to."""

    name: str  # "FBX"
    group: str  # a key of `_ADVICE`

    @property
    def is_read(self) -> bool:
        """Whether some part of struck reads it."""
        return self.group in _READ_FORMATS

    @property
    def ending(self) -> str:
        """The first ending of its files, as ".obj", or ""."""
        names = (key for key, value in _NAMES.items() if value == (self.name, self.group))
        return next(names, "")

    @property
    def advice(self) -> str:
        """The command that reads it, or how to make a file that is read."""
        return _ADVICE[self.group]

    def __str__(self) -> str:
        return f"{_NOUNS[self.group]} ({self.name})"


def kind_by_content(head: bytes) -> FileKind | None:
    """Return the kind of a file that begins with these bytes; None if they are of no format."""
    length = int.from_bytes(head[:8], "little")
    if len(head) > 8 and head[8:9] == b"{" and 2 <= length <= _CONTAINER:
        is_struck = b'"format":"struck"' in head.replace(b" ", b"")
        if is_struck:
            return FileKind(name="struck", group="model")
        return _kind_by_ending(".safetensors")
    for start, name, group in _SIGNATURES:
        if re.match(start, head, re.DOTALL | re.IGNORECASE if group == "volume" else re.DOTALL):
            return FileKind(name=name, group=group)
    return None


def kind_by_name(path: str | os.PathLike[str]) -> FileKind | None:
    """Return the kind that a file's ending promises, also of one that is packed."""
    path = Path(path)
    if path.suffix[1:].lower() in PACKINGS:
        inner = _kind_by_ending(Path(path.stem).suffix.lower())
        zip_kind = FileKind(name="ZIP", group="surface") if path.suffix == ".zip" else None
        return inner or zip_kind
    return _kind_by_ending(path.suffix.lower())


def _kind_by_ending(ending: str) -> FileKind | None:
    name, group = _NAMES.get(ending, ("", ""))
    return FileKind(name=name, group=group) if name else None


def _head_of(path: str | os.PathLike[str]) -> bytes:
    """Return the first bytes of an ordinary file; none of another, or of one that is not read."""
    with suppress(OSError, ValueError):
        if is_file(path):
            with open_ordinary(Path(path)) as file:
                return file.read(HEAD)
    return b""


def recognise(path: str | os.PathLike[str]) -> FileKind | None:
    """Return the kind of a file: by its content, or else by its ending."""
    kind, content_kind = kind_by_name(path), kind_by_content(_head_of(path))
    is_packed = content_kind is not None and content_kind.group == "packed"  # the ending says more
    return kind if kind is not None and (content_kind is None or is_packed) else content_kind


def list_readable(*, meshes: bool = False) -> str:
    """Return all endings of files that are read, or of `meshes` alone, in words."""
    surfaces = f"surfaces as {', '.join(FORMATS)}, also packed as {', '.join(PACKINGS)}"
    meshes_text = f"{surfaces}; volume meshes as {', '.join(VOLUMES)}"
    if meshes:
        return meshes_text
    return (
        f"models as {', '.join(MODELS)}; {meshes_text}; sounds as {', '.join(SOUNDS)}; scenes "
        f"(MJCF, URDF) as {', '.join(SCENES)}"
    )


def another_kind(path: str | os.PathLike[str], group: str, *, advice: str = "") -> str:
    """Return why a file is not of a group, and what to do with it; "" where it may be."""
    kind = recognise(path)
    if kind is None or kind.group == group:
        return ""
    contrast = f" and not {_NOUNS[group]}" if kind.is_read else ", which struck does not read"
    return f"is {kind}{contrast}: {advice}{kind.advice}"


def explain_not_model(path: str | os.PathLike[str]) -> str:
    """Return why a file is no model, and what to do with it; "" for a damaged model."""
    kind, ending = recognise(path), Path(path).suffix.lower()
    if kind is None:
        name = f"ends in {ending!r}" if ending else "has no ending"
        return f"{name}, and its content is of no kind that is read: struck reads {list_readable()}"
    content_kind = kind_by_content(_head_of(path))
    if kind.group == "model" and content_kind is not None and content_kind.group == "packed":
        return f"is packed ({content_kind.name}), and models are read unpacked alone: unpack it"
    if kind.name == "safetensors" and ending == ".struck":
        return ""
    content_ending = kind.name.lower()
    advice = (
        f"end its name in .{content_ending}; "
        if content_ending in {*SOUNDS, *FORMATS} - {ending[1:]} and ending[1:] not in PACKINGS
        else ""
    )
    reason = another_kind(path, "model", advice=advice)
    return f"{reason}; struck reads {list_readable()}" if reason else ""


def require_mesh(path: str | os.PathLike[str]) -> None:
    """Refuse a file where a mesh belongs, if its content or its ending is of another kind."""
    kind = recognise(path)
    if kind is None or kind.group not in _MESHES or kind != kind_by_name(path):
        raise MeshError(f"{path}: {explain_not_surface(Path(path).name, kind)}")


def explain_not_surface(name: str, kind: FileKind | None = None) -> str:
    """Return why a file of that name is no surface, and all formats of meshes.

    Its kind is the one that its name promises, unless its content has shown another one.
    """
    kind, ending = kind or kind_by_name(name), Path(name).suffix
    if kind is not None and kind.group in _MESHES and kind != kind_by_name(name):
        return f"its content is {kind.name}: end its name in {kind.ending}"
    if kind is None:
        reason = (
            f"its extension {ending!r} names no mesh format" if ending else "it has no extension"
        )
        return f"{reason}: use one of {list_readable(meshes=True)}"
    if kind.group == "volume":
        return f"it is {kind}, and those are read unpacked alone: unpack it"
    contrast = " and not a mesh" if kind.is_read else ", which struck does not read"
    return f"it is {kind}{contrast}: {kind.advice}; meshes are read: {list_readable(meshes=True)}"
