"""Scene files, MJCF and URDF, as people have them, read into MuJoCo's specification of a model.

MuJoCo's own reader opens whatever path a file names, discards what is only seen, and looks for ROS
packages nowhere. So the text is first made independent of other files: files that it includes are
inserted, and each mesh is passed as bytes, if it lies in the given folder. The same holds for
models that a file attaches: they are read here, and joined by MuJoCo's own `attach`.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote
from xml.etree import ElementTree as ET

from struck.errors import (
    FileFormatError,
    MeshError,
    MissingDependencyError,
    SimulationError,
    nearest,
)
from struck.files.atomic import is_file, read_bytes, real
from struck.files.meshes import load_surface
from struck.files.recognition import another_kind
from struck.processes.child_process import safe_children

if TYPE_CHECKING:
    import mujoco

    from struck.model.mesh import Mesh

_MAX_TEXT_BYTES = 2**25  # bytes of one file of text
_MAX_DEPTH = 20  # files that include or attach each other in a row
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


@dataclass(kw_only=True)
class SceneFile:
    """A scene file that needs no other file any more."""

    root: ET.Element
    folder: Path  # nothing outside it is read
    assets: dict[str, bytes] = field(default_factory=dict)  # shared with the models it attaches
    notes: list[str] = field(default_factory=list)  # on omitted parts
    attachments: list[_Attachment] = field(default_factory=list)
    attachment_count: int = (
        0  # number of models that are attached, those of the attached ones as well
    )
    files: list[Path] = field(default_factory=list)  # that were read, shared as well

    @classmethod
    def of(cls, path: str | os.PathLike[str], folder: str | os.PathLike[str] | None) -> SceneFile:
        """Read a scene file and the files it includes, all of them inside its folder."""
        place = Path(path)
        home = real(place.parent if folder is None else folder)
        if not real(place).is_relative_to(home):
            raise FileFormatError(f"{path} lies outside of {folder}: give a folder that holds it")
        scene = cls(root=_parsed(place), folder=home)
        if scene.root.tag == "robot":
            scene._take_urdf(real(place).parent)
        elif scene.root.tag == "mujoco":
            scene._read_mjcf(real(place), ())
        else:
            raise FileFormatError(
                f"{path} begins with <{scene.root.tag}>: give a model of MuJoCo (<mujoco>) or a "
                "URDF (<robot>)"
            )
        return scene

    @property
    def is_robot(self) -> bool:
        """Whether the file is a URDF, not an MJCF."""
        return self.root.tag == "robot"

    def spec(self) -> mujoco.MjSpec:
        """Return MuJoCo's specification; SimulationError with MuJoCo's own words where it fails."""
        mujoco = mujoco_itself()
        text = ET.tostring(self.root, encoding="unicode")
        try:
            spec = mujoco.MjSpec.from_string(text, assets=self.assets)
            self._attach(spec)
        except FileFormatError:
            raise
        except ValueError as error:
            raise SimulationError(f"MuJoCo cannot read the scene: {error}") from None
        if self.is_robot:
            self._let_go(spec)
        return spec

    def _attach(self, spec: mujoco.MjSpec) -> None:
        """Join the attached models to a specification, at the frames in place of <attach>."""
        for frame in [
            element for element in spec.frames if element.name.startswith(_ATTACHMENT_PREFIX)
        ]:
            # <replicate> ends the names of its copies, as it does those of their bodies.
            number, _, suffix = frame.name.removeprefix(_ATTACHMENT_PREFIX).partition("|")
            attachment = self.attachments[int(number)]
            child = attachment.model.spec()
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
            root=self._parsed(path), folder=self.folder, assets=self.assets, files=self.files
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
        for link in self.root.iter("link"):
            for part in list(link):
                mesh = part.find("geometry/mesh")
                if mesh is not None:
                    self._take_urdf_mesh(link, part, mesh, home / meshes)
        for parent in self.root.iter("material"):
            for child in parent.findall("texture"):
                parent.remove(child)

    def _take_urdf_mesh(
        self, link: ET.Element, part: ET.Element, mesh: ET.Element, home: Path
    ) -> None:
        file = mesh.get("filename", "")
        try:
            mesh.set("filename", self._asset(self._locate_file(file, home)))
        except (MeshError, MissingDependencyError) as error:
            if part.tag != "visual":
                raise
            link.remove(part)
            name = link.get("name", "")
            self.notes.append(f"what is seen of {name!r} was left out ({error})")

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

    def _let_go(self, spec: mujoco.MjSpec) -> None:
        """Let a robot's first link move, unless it is called the world, as others read URDF."""
        first = spec.worldbody.first_body()
        if first is not None and first.name != "world" and not list(first.joints):
            first.add_freejoint()

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
        if name not in self.assets:
            is_unchanged = suffix == kind
            self.assets[name] = read_bytes(path) if is_unchanged else _stl(load_surface(path))
        return name


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


def _parsed(path: Path) -> ET.Element:
    data = read_bytes(path, most=_MAX_TEXT_BYTES)
    if b"\0" in data:
        problem = another_kind(path, "scene") or "is no text"
        raise FileFormatError(f"{path} {problem}; give a scene in MJCF or URDF, as scene.xml")
    if any(marker in data for marker in (b"<!ENTITY", b"<!DOCTYPE")):
        raise FileFormatError(f"{path} declares entities, which are not taken: write them out")
    try:
        return ET.fromstring(data)  # noqa: S314 - without entities
    except (ET.ParseError, ValueError, LookupError) as error:
        problem = another_kind(path, "scene") or f"is no XML ({error})"
        raise FileFormatError(
            f"{path} {problem}; give a scene in MJCF or URDF, as scene.xml"
        ) from None


def _find_last(elements: list[ET.Element], name: str, default: str | Path) -> str | Path:
    """Return the last value of an attribute that several elements may set."""
    return next((e.attrib[name] for e in reversed(elements) if name in e.attrib), default)


def _stl(surface: Mesh) -> bytes:
    """Return a surface as binary STL."""
    import numpy as np

    corners = surface.points[surface.faces].astype("<f4")
    rows = np.zeros(len(corners), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("o", "<u2")])
    rows["corners"], rows["normal"] = corners, surface.face_normals
    return bytes(80) + len(rows).to_bytes(4, "little") + rows.tobytes()
