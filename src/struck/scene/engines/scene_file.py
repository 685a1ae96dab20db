"""Scene files, MJCF and URDF, as people have them, read into MuJoCo's specification of a model.

MuJoCo's own reader opens whatever path a file names, discards what is only seen, and looks for ROS
packages nowhere. So the text is first made independent of other files: files that it includes are
inserted, and each mesh is passed as bytes, if it lies in the given folder. The same holds for
models that a file attaches: they are read here, and joined by MuJoCo's own `attach`.

All this, and MuJoCo's reading of the result, first happens in the process that reads foreign files,
which may take too long, crash or swell. Its answer is text that needs no other file, with a limited
number of bodies, so that MuJoCo reads it again in a moment, and the bytes of its meshes.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote
from xml.etree import ElementTree as ET

import numpy as np

from struck.errors import (
    FileFormatError,
    MeshError,
    MissingDependencyError,
    SimulationError,
    nearest,
)
from struck.files.atomic import is_file, read_bytes, real, require_readable
from struck.files.guard import read_foreign
from struck.files.meshes import load_surface
from struck.files.messages import Answer, Frame, ReadingLimits
from struck.files.recognition import another_kind
from struck.processes.child_process import safe_children

if TYPE_CHECKING:
    import mujoco

    from struck.model.mesh import Mesh

_MAX_TEXT_BYTES = 2**25  # bytes of one file of text
_MAX_DEPTH = 20  # files that include or attach each other in a row
_MAX_NESTING = 400  # elements: a chain of as many links; MuJoCo and Python call themselves for each
# Bodies, and geoms: MuJoCo reads as many in about a second, in which Ctrl-C waits.
_MAX_ELEMENTS = 20_000
_SMALLER_SCENE = "take some bodies, copies or meshes out"
_MAX_FILES = 1000  # that one scene includes or attaches, each as often as it does
_ATTACHMENT_PREFIX = "|attached "  # begins the name of the frame in place of an <attach>
_MUJOCO_SUFFIXES = {".obj", ".stl", ".msh"}
_IMAGES = ("texture", "skin")  # neither moves nor sounds
_PACKAGE = re.compile(r"package://([^/]*)/(.*)", re.DOTALL)
_NAMES = re.compile(r"[^\w.-]+")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Attachment:
    """A frame of a scene to which a body of another model, or all of that model, is attached."""

    model: SceneFile
    name: str  # of the model
    body: str  # "": all of it
    prefix: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FlatAttachment:
    """An attachment by the number of its model."""

    model: int
    name: str
    body: str
    prefix: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _FlatModel:
    """A model as text that needs no other file, and what is attached to it."""

    text: str
    attachments: tuple[_FlatAttachment, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlatScene:
    """A scene without references to files: its models, the scene itself last, and their meshes."""

    models: Sequence[_FlatModel]
    assets: dict[str, bytes]
    foreign_paths: dict[str, Path]  # meshes in formats that MuJoCo does not read, by name
    notes: list[str]

    @classmethod
    def of(cls, frame: Frame) -> FlatScene:
        """Return the scene that an answer holds; ValueError beyond the bounds."""
        content = frame.content
        texts = [array.tobytes() for array in frame.arrays]
        counts = [content[name] for name in ("bodies", "geoms")]
        if max(counts) > _MAX_ELEMENTS or sum(map(len, texts)) > content["bytes"]:
            raise ValueError(f"it states {counts} bodies and geoms, {content['bytes']} bytes")
        models = [
            _FlatModel(
                text=text.decode(), attachments=tuple(_FlatAttachment(**part) for part in parts)
            )
            for text, parts in zip(texts, content["attachments"], strict=False)
        ]
        names = content["assets"]
        return cls(
            models=models,
            assets=dict(zip(names, texts[len(models) :], strict=True)),
            foreign_paths={name: Path(path) for name, path in content["foreign_paths"].items()},
            notes=content["notes"],
        )

    def answer(self, counts: Mapping[str, int]) -> Answer:
        """Return the scene as an answer of the process that reads files."""
        texts = [*(model.text.encode() for model in self.models), *self.assets.values()]
        content = {
            **counts,
            "bytes": sum(map(len, texts)),
            "attachments": [[asdict(part) for part in model.attachments] for model in self.models],
            "assets": list(self.assets),
            "foreign_paths": {name: str(path) for name, path in self.foreign_paths.items()},
            "notes": self.notes,
        }
        return content, [np.frombuffer(text, np.uint8)[None] for text in texts]

    def convert_meshes(self) -> FlatScene:
        """Return the scene with foreign meshes as STL; without visible parts that have none."""
        if not self.foreign_paths:
            return self
        assets, notes = dict(self.assets), list(self.notes)
        root = ET.fromstring(self.models[-1].text)  # noqa: S314 - written by us
        for name, path in self.foreign_paths.items():
            try:
                assets[name] = _stl(load_surface(path))
            except (MeshError, MissingDependencyError) as error:
                link_names = _drop_visible(root, name)
                if not link_names:
                    raise
                notes += [f"what is seen of {link!r} was left out ({error})" for link in link_names]
        last = replace(self.models[-1], text=ET.tostring(root, encoding="unicode"))
        models = [*self.models[:-1], last]
        return FlatScene(models=models, assets=assets, foreign_paths={}, notes=notes)

    def spec(self) -> mujoco.MjSpec:
        """Return MuJoCo's specification; SimulationError with MuJoCo's own words where it fails."""
        return self._spec(len(self.models) - 1)

    def _spec(self, number: int) -> mujoco.MjSpec:
        """Return the specification of a model and what is attached to it."""
        model = self.models[number]
        try:
            with gathered_warnings(self.notes):
                spec = mujoco_itself().MjSpec.from_string(model.text, assets=self.assets)
                self._attach(spec, model)
        except FileFormatError:
            raise
        except ValueError as error:
            raise SimulationError(f"MuJoCo cannot read the scene: {error}") from None
        if model.text.startswith("<robot"):
            _let_go(spec)
        return spec

    def _attach(self, spec: mujoco.MjSpec, model: _FlatModel) -> None:
        """Join the attached models to a specification, at the frames in place of <attach>."""
        for frame in [
            element for element in spec.frames if element.name.startswith(_ATTACHMENT_PREFIX)
        ]:
            # <replicate> ends the names of its copies, as it does those of their bodies.
            number, _, suffix = frame.name.removeprefix(_ATTACHMENT_PREFIX).partition("|")
            attachment = model.attachments[int(number)]
            child = self._spec(attachment.model)
            if not attachment.body:
                spec.attach(child, frame=frame, prefix=attachment.prefix, suffix=suffix)
                continue
            body = child.body(attachment.body)
            if body is None:
                names = [element.name for element in child.bodies if element.name != "world"]
                raise FileFormatError(
                    f"<attach> names body {attachment.body!r} of model {attachment.name!r}, which "
                    f"has {', '.join(map(repr, names)) or 'none'}: "
                    f"{nearest(attachment.body, names)}give one of these"
                )
            frame.attach_body(body, attachment.prefix, suffix)


def load_scene(
    path: str | os.PathLike[str], folder: str | os.PathLike[str] | None = None
) -> FlatScene:
    """Read a scene file and the files it names, all of them inside its folder.

    FileFormatError where one is missing, damaged or outside, or all are beyond the bounds;
    SimulationError where MuJoCo cannot read the scene.
    """
    home = real(Path(path).parent if folder is None else folder)
    if not real(path).is_relative_to(home):
        raise FileFormatError(f"{path} lies outside of {folder}: give a folder that holds it")
    require_readable(path)
    mujoco_itself()
    options = {"folder": str(home), "display_name": str(path)}
    try:
        scene = read_foreign("scene", path, FlatScene.of, advice=_SMALLER_SCENE, options=options)
    except FileFormatError as error:
        prefix = "" if str(path) in str(error) else f"{path}: "
        raise FileFormatError(f"{prefix}{error}") from None
    return scene.convert_meshes()


def answer(path: Path, limits: ReadingLimits, *, folder: str, display_name: str) -> Answer:
    """Return a scene without references to files as an answer, once MuJoCo has read it."""
    file = SceneFile.of(path, Path(folder), display_name)
    scene = file.flatten()
    size = sum(map(len, scene.assets.values()))
    if size > limits.size:
        raise FileFormatError(
            f"its meshes take up {size} bytes, and {limits.size} are read: {_SMALLER_SCENE}"
        )
    spec = scene.spec()
    counts = {"bodies": len(spec.bodies), "geoms": len(spec.geoms)}
    for name, count in counts.items():
        if count > _MAX_ELEMENTS:
            raise FileFormatError(
                f"it has {count} {name}, and {_MAX_ELEMENTS} are read: {_SMALLER_SCENE}"
            )
    return scene.answer(counts)


@dataclass(kw_only=True)
class SceneFile:
    """A scene file that needs no other file any more."""

    root: ET.Element
    folder: Path  # nothing outside it is read
    assets: dict[str, bytes] = field(default_factory=dict)  # shared with the models it attaches
    foreign_paths: dict[str, Path] = field(default_factory=dict)  # shared as well
    notes: list[str] = field(default_factory=list)  # on omitted parts
    attachments: list[_Attachment] = field(default_factory=list)
    attachment_count: int = (
        0  # number of models that are attached, those of the attached ones as well
    )
    files: list[Path] = field(default_factory=list)  # that were read, shared as well

    @classmethod
    def of(cls, path: Path, folder: Path, display_name: str) -> SceneFile:
        """Read a scene file and the files it includes; `display_name` is its name in errors."""
        scene = cls(root=_parsed(path, display_name), folder=folder)
        if scene.root.tag == "robot":
            scene._take_urdf(real(path).parent)
        elif scene.root.tag == "mujoco":
            scene._read_mjcf(real(path), ())
        else:
            raise FileFormatError(
                f"{display_name} begins with <{scene.root.tag}>: give a model of MuJoCo "
                "(<mujoco>) or a URDF (<robot>)"
            )
        return scene

    def flatten(self) -> FlatScene:
        """Return the scene as texts, each after those that are attached to it."""
        models: list[_FlatModel] = []
        self.add_flat(models)
        return FlatScene(
            models=models,
            assets=self.assets,
            foreign_paths=self.foreign_paths,
            notes=self.notes,
        )

    def add_flat(self, models: list[_FlatModel]) -> int:
        """Add the texts of this model and of those it attaches; return its number."""
        attachments = tuple(
            _FlatAttachment(
                model=attachment.model.add_flat(models),
                name=attachment.name,
                body=attachment.body,
                prefix=attachment.prefix,
            )
            for attachment in self.attachments
        )
        text = ET.tostring(self.root, encoding="unicode")
        models.append(_FlatModel(text=text, attachments=attachments))
        return len(models) - 1

    # MJCF.

    def _read_mjcf(self, path: Path, chain: tuple[Path, ...]) -> None:
        """Take over all files of a model; `chain` lists the files that attach it."""
        self._include(self.root, path.parent, ())
        self._take_models(path.parent, (*chain, path))
        self._take_mjcf(path.parent)

    def _take_models(self, home: Path, chain: tuple[Path, ...]) -> None:
        """Read the models that are attached, and put a frame in place of each <attach>."""
        models: dict[str, SceneFile] = {}
        for assets in self.root.iter("asset"):
            for element in assets.findall("model"):
                file = element.get("file", "")
                model = self._model(self._require_inside(home / file, file), file, chain)
                models[element.get("name") or model.root.get("model") or Path(file).stem] = model
                assets.remove(element)
        for element in self.root.iter("attach"):
            name = element.get("model", "")
            if name not in models:
                raise FileFormatError(
                    f"<attach> names model {name!r}, and there are "
                    f"{', '.join(map(repr, models)) or 'none'}: {nearest(name, models)}"
                    "name a <model> of <asset>"
                )
            attachment = _Attachment(
                model=models[name],
                name=name,
                body=element.get("body", ""),
                prefix=element.get("prefix", ""),
            )
            element.tag = "frame"
            element.attrib.clear()
            element.set("name", f"{_ATTACHMENT_PREFIX}{len(self.attachments)}|")
            self.attachments.append(attachment)
            self.attachment_count += 1 + attachment.model.attachment_count
            self._require_few_files()

    def _model(self, path: Path, file: str, chain: tuple[Path, ...]) -> SceneFile:
        """Return a model that this one attaches."""
        if path in chain or len(chain) == _MAX_DEPTH:
            raise FileFormatError(f"{path} attaches itself: take one of the two out")
        model = SceneFile(
            root=self._parsed(path),
            folder=self.folder,
            assets=self.assets,
            foreign_paths=self.foreign_paths,
            files=self.files,
        )
        if model.root.tag != "mujoco":
            raise FileFormatError(
                f"<model file={file!r}> begins with <{model.root.tag}>: give a model of MuJoCo "
                "(<mujoco>)"
            )
        model._read_mjcf(path, chain)
        self.notes += model.notes
        return model

    def _parsed(self, path: Path) -> ET.Element:
        """Return the content of a further file of the scene."""
        self.files.append(path)
        self._require_few_files()
        return _parsed(path)

    def _require_few_files(self) -> None:
        if max(len(self.files), self.attachment_count) > _MAX_FILES:
            raise FileFormatError(
                f"the scene includes or attaches more than {_MAX_FILES} files: write out what "
                "files include or attach again and again"
            )

    def _include(self, parent: ET.Element, home: Path, chain: tuple[Path, ...]) -> None:
        """Replace each <include> element by the contents of its file."""
        for number, child in reversed(list(enumerate(parent))):
            if child.tag != "include":
                self._include(child, home, chain)
                continue
            path = self._require_inside(home / child.get("file", ""), child.get("file", ""))
            if path in chain or len(chain) == _MAX_DEPTH:
                raise FileFormatError(f"{path} includes itself: take one of the two out")
            content = self._parsed(path)
            self._include(content, home, (*chain, path))
            parent[number : number + 1] = list(content)

    def _take_mjcf(self, home: Path) -> None:
        """Take meshes and height fields over as bytes, and leave pictures out."""
        compilers = list(self.root.iter("compiler"))
        assets = home / _find_last(compilers, "assetdir", "")
        meshes = home / _find_last(compilers, "meshdir", assets)
        strips = _find_last(compilers, "strippath", "false") == "true"
        for compiler in compilers:
            for name in ("assetdir", "meshdir", "texturedir", "strippath"):
                compiler.attrib.pop(name, None)
        self._drop_images()
        for element in self.root.iter():
            file = element.get("file")
            if file is None:
                continue
            if element.tag not in {"mesh", "hfield", "flexcomp"}:
                raise FileFormatError(
                    f"<{element.tag} file={file!r}> is not taken: <include> its content instead, "
                    "or name it as <model> of <asset>"
                )
            if "name" not in element.attrib and element.tag != "flexcomp":
                element.set("name", Path(file).stem)
            name = Path(file).name if strips else file
            element.set("file", self._asset(self._require_inside(meshes / name, file)))

    def _drop_images(self) -> None:
        for parent in list(self.root.iter()):
            for child in [element for element in parent if element.tag in (*_IMAGES, "layer")]:
                parent.remove(child)
            if parent.tag == "material":
                parent.attrib.pop("texture", None)

    # URDF.

    def _take_urdf(self, home: Path) -> None:
        """Read the meshes of a URDF; keep visual geometry, which is the sounding shape."""
        options = self.root.find("mujoco/compiler")
        meshes = "" if options is None else options.attrib.pop("meshdir", "")
        if options is None:
            section = self.root.find("mujoco")
            section = ET.SubElement(self.root, "mujoco") if section is None else section
            options = ET.SubElement(section, "compiler")
        options.attrib.update(strippath="false", discardvisual="false", fusestatic="false")
        for mesh in self.root.findall(".//link/*/geometry/mesh"):
            file = mesh.get("filename", "")
            mesh.set("filename", self._asset(self._locate_file(file, home / meshes)))
        for parent in self.root.iter("material"):
            for child in parent.findall("texture"):
                parent.remove(child)

    def _locate_file(self, file: str, home: Path) -> Path:
        """Return the path of a file that a URDF names by package, URL or relative path."""
        package = _PACKAGE.fullmatch(file)
        if package is None:
            local = unquote(file.removeprefix("file://"))
            return self._require_inside(home / local, file)
        name, relative_path = package.groups()
        candidates = [self.folder / name / relative_path, self.folder / relative_path]
        candidates += [
            up / relative_path for up in (home, *home.parents) if up.is_relative_to(self.folder)
        ]
        return self._require_inside(next(filter(is_file, candidates), candidates[0]), file)

    # Files.

    def _require_inside(self, path: Path, name: str) -> Path:
        """Return where a file really is, or refuse it."""
        place = real(path)
        if not place.is_relative_to(self.folder):
            raise FileFormatError(
                f"{name!r} lies outside of {self.folder}, and nothing else is read: give the "
                "folder that holds both with folder="
            )
        if not is_file(place):
            raise FileFormatError(
                f"{name!r} is not in {self.folder}: put it there, or name the folder that holds "
                "all files of the scene with folder="
            )
        return place

    def _asset(self, path: Path) -> str:
        """Keep a file's content, and return the name under which MuJoCo finds it."""
        kind = path.suffix.lower()
        suffix = kind if kind in _MUJOCO_SUFFIXES | {".png", ".bin", ".gmsh"} else ".stl"
        base = _NAMES.sub("_", path.relative_to(self.folder).with_suffix("").as_posix())
        name = f"{base}_{kind[1:]}{suffix}"
        if suffix != kind:
            self.foreign_paths[name] = path
        elif name not in self.assets:
            self.assets[name] = read_bytes(path)
        return name


def _let_go(spec: mujoco.MjSpec) -> None:
    """Let a robot's first link move, unless it is called the world, as others read URDF."""
    first = spec.worldbody.first_body()
    if first is not None and first.name != "world" and not list(first.joints):
        first.add_freejoint()


def _drop_visible(root: ET.Element, name: str) -> list[str]:
    """Remove what is only seen of a mesh; return its links, none where it also collides."""
    parts = [
        (link, part)
        for link in root.iter("link")
        for part in link
        if any(mesh.get("filename") == name for mesh in part.findall("geometry/mesh"))
    ]
    if not all(part.tag == "visual" for _, part in parts):
        return []
    for link, part in parts:
        link.remove(part)
    return [link.get("name", "") for link, _ in parts]


def mujoco_itself():  # noqa: ANN201 - a module
    """Return MuJoCo; MissingDependencyError without it."""
    try:
        with safe_children():  # glfw, which it imports, asks its library's version of another one
            import mujoco
    except ImportError:
        raise MissingDependencyError(
            'simulations run in MuJoCo: pip install "struck[sim]"'
        ) from None
    return mujoco


@contextmanager
def gathered_warnings(notes: list[str]) -> Iterator[None]:
    """Add the warnings of MuJoCo to notes, each once; it would write them to a file right here."""
    mujoco, messages = mujoco_itself(), list[str]()
    old_handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(messages.append)
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always")
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(old_handler)
            messages += [str(record.message) for record in records]
            texts = [f"MuJoCo warns: {' '.join(message.split())}" for message in messages]
            notes += [text for text in dict.fromkeys(texts) if text not in notes]


def _parsed(path: Path, display_name: str = "") -> ET.Element:
    """Return the content of a file of XML; `display_name` is its name in errors."""
    data, name = read_bytes(path, most=_MAX_TEXT_BYTES), display_name or path
    if b"\0" in data:
        problem = another_kind(path, "scene") or "is no text"
        raise FileFormatError(f"{name} {problem}; give a scene in MJCF or URDF, as scene.xml")
    if any(marker in data for marker in (b"<!ENTITY", b"<!DOCTYPE")):
        raise FileFormatError(f"{name} declares entities, which are not taken: write them out")
    try:
        root = ET.fromstring(data)  # noqa: S314 - without entities
    except (ET.ParseError, ValueError, LookupError) as error:
        problem = another_kind(path, "scene") or f"is no XML ({error})"
        raise FileFormatError(
            f"{name} {problem}; give a scene in MJCF or URDF, as scene.xml"
        ) from None
    level, depth = [root], 0
    while level:
        level, depth = [child for element in level for child in element], depth + 1
    if depth > _MAX_NESTING:
        raise FileFormatError(
            f"{name} has elements {depth} deep in each other, and {_MAX_NESTING} are read: attach "
            "parts to the world and connect them by equalities"
        )
    return root


def _find_last(elements: list[ET.Element], name: str, default: str | Path) -> str | Path:
    """Return the last value of an attribute that several elements may set."""
    return next((e.attrib[name] for e in reversed(elements) if name in e.attrib), default)


def _stl(surface: Mesh) -> bytes:
    """Return a surface as binary STL."""
    corners = surface.points[surface.faces].astype("<f4")
    rows = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("o", "<u2")])
    rows["corners"], rows["normal"] = corners, surface.face_normals
    return bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes()
