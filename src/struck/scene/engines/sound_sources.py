"""Sound sources of a simulation: the material of each link, and the model of its sound."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from struck.analysis.analysis import Fixed, analyze
from struck.analysis.cached_steps import fingerprint
from struck.analysis.discretisation import Solid
from struck.analysis.source_options import applicable
from struck.errors import MaterialError, OptionError, StruckError, nearest
from struck.excitation.roughness import finish
from struck.files.atomic import real, require_readable
from struck.files.model_file import is_model
from struck.files.model_file import load as load_model
from struck.files.recognition import require_mesh
from struck.model.arrays import Array, checked, require_number
from struck.model.damping import Band
from struck.model.material import Material, require_damping
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Progress, silent
from struck.scene.body import Body, RigidBody
from struck.scene.engines.links import Link, MassProperties
from struck.scene.gathered_notes import QUOTED_FORM, list_names, with_plural
from struck.solids.resolution import level

if TYPE_CHECKING:
    from typing_extensions import TypeIs

# By patterns of the bodies' names, as in {"mug*": "ceramic"}; of several that fit the first counts.
Materials = str | Material | Mapping[str, str | Material]
ShapeSource = Solid | Mesh | str | os.PathLike[str]
Sounding = ModalModel | ShapeSource
T = TypeVar("T")
_ANALYSIS_OPTIONS = {"materials", "walls", "fixed"}  # options of bodies whose modes are computed


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class SoundOptions:
    """Materials and other options for bodies of a scene file, by patterns of their names."""

    materials: Materials | None = None  # else as the file's own materials are called
    models: Mapping[str, Sounding] = field(default_factory=dict)  # in place of the file's shape
    walls: Mapping[str, float] = field(default_factory=dict)  # m, of hollow bodies
    fixed: Mapping[str, Fixed] = field(default_factory=dict)  # where bodies are held
    roughness: Mapping[str, str] = field(default_factory=dict)
    mute: Sequence[str] = ()  # patterns of bodies that are only touched
    band: Band | None = None  # Hz or notes, of the modes of all bodies
    accuracy: str = "standard"
    damping: str = "own"
    cache: bool | str | os.PathLike[str] = True
    progress: Progress = silent

    def require_known(self, names: Sequence[str], welded: Mapping[str, str] | None = None) -> None:
        """Refuse patterns that fit no body, or only bodies whose finished models need no more.

        `welded` names the bodies of a file that are part of another one, with that one's name.
        """
        finished_names = [name for name in names if _is_finished(_chosen(self.models, name))]
        tables = {
            "materials": self.materials if isinstance(self.materials, Mapping) else {},
            "models": self.models,
            "walls": self.walls,
            "fixed": self.fixed,
            "roughness": self.roughness,
            "mute": dict.fromkeys(self.mute or ()),
        }
        for option, table in tables.items():
            for pattern in table or ():
                fitting = [name for name in names if fnmatchcase(name, pattern)]
                part = next(
                    (member for member in welded or () if fnmatchcase(member, pattern)), None
                )
                if not fitting and welded and part is not None:
                    raise OptionError(
                        f"{option} names {pattern!r}, and {part!r} is welded to {welded[part]!r}: "
                        "the two ring as one body, of one material; name that one, or give the "
                        "file a joint between them"
                    )
                if not fitting:
                    raise OptionError(
                        f"{option} names {pattern!r}: {nearest(pattern, names)}give one of "
                        f"{', '.join(names)}, or a pattern as 'mug*'"
                    )
                if option in _ANALYSIS_OPTIONS and set(fitting) <= set(finished_names):
                    raise OptionError(
                        f"{option} names {pattern!r}, whose modes a finished model gives: leave it "
                        "out, or give a mesh in models="
                    )

    def require_possible(self) -> None:
        """Refuse unknown materials, surfaces, accuracies and damping, and impossible walls."""
        level(self.accuracy)
        require_damping(self.damping)
        materials = self.materials if isinstance(self.materials, Mapping) else {"*": self.materials}
        for material in materials.values():
            if isinstance(material, str):
                Material.named(material)
        for surface in (self.roughness or {}).values():
            finish(surface)
        for pattern, wall in (self.walls or {}).items():
            require_number(f"wall of {pattern!r}", wall, 0.0, above=True, hint="it must exceed 0 m")


class SoundSources:
    """Models of the sound of links, each shape and material analyzed once."""

    def __init__(self, options: SoundOptions) -> None:
        self._options = options
        self._results: dict[tuple[str | int, ...], ModalModel | str] = {}
        self._materials: dict[str, Material | None] = {}
        self._finished_models: dict[str, ModalModel] = {}
        self._silent: dict[str, list[str]] = {}  # names of bodies by the reason
        self._remarks: list[str] = []

    @property
    def notes(self) -> list[str]:
        """Reasons for silent bodies, a line for each reason, and other remarks."""
        return [*self._remarks, *self._reasons()]

    def _reasons(self) -> Iterator[str]:
        for reason, names in self._silent.items():
            is_plural = len(names) > 1
            verb = "are" if is_plural else "is"
            text = with_plural(reason) if is_plural else reason
            yield f"{list_names(names, QUOTED_FORM)} {verb} silent: {text}"

    def prepare(self, links: Sequence[Link]) -> Mapping[str, Material | None]:
        """Check all options against the bodies, and return the material of each body.

        No mode is computed here; finished models are loaded.
        """
        options = self._options
        part_owners = {part: link.name for link in links for part in link.welded}
        options.require_known([link.name for link in links], part_owners)
        options.require_possible()
        for link in links:
            source = _chosen(options.models, link.name)
            material = self._material(link)
            if _is_finished(source) and not self._is_mute(link.name):
                model = source if isinstance(source, ModalModel) else load_model(source)
                self._finished_models[link.name], material = model, model.material
            elif isinstance(source, str | os.PathLike):
                require_readable(source)
                require_mesh(source)
            self._materials[link.name] = material
        return self._materials

    def bodies(
        self, links: Sequence[Link], masses: Sequence[MassProperties | None]
    ) -> dict[str, Body]:
        """Return a body for each link; `notes` gives the reason for each silent one."""
        options = self._options
        if not self._materials:
            self.prepare(links)
        bodies = {}
        for number, (link, mass) in enumerate(zip(links, masses, strict=True)):
            options.progress(f"computing the modes of {link.name}", number / len(links))
            material = self._materials[link.name]
            model, reason = self._model(link, material)
            if reason:
                self._silent.setdefault(reason, []).append(link.name)
            bodies[link.name] = Body(
                model=model or _make_rigid_body(link, material, mass),
                fixed=link.fixed,
                roughness=_chosen(options.roughness, link.name),
            )
        if not self._results:
            defaults = {option.name: option.default for option in fields(SoundOptions)}
            for name in ("accuracy", "damping", "band"):
                if (value := getattr(options, name)) != defaults[name]:
                    self._remarks.append(f"{name}={value!r} changes nothing: no body is analyzed")
        return bodies

    def _is_mute(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self._options.mute)

    def material(self, name: str) -> Material | None:
        """Return the material that the options give a body, or None."""
        materials = self._options.materials
        chosen = _chosen(materials, name) if isinstance(materials, Mapping) else materials
        if chosen is None or isinstance(chosen, Material):
            return chosen
        return self._find_material(chosen)

    def _material(self, link: Link) -> Material | None:
        """Return the material of a body by the options, or else by the file."""
        material = self.material(link.name)
        if material is not None or not link.material:
            return material
        try:
            return self._find_material(link.material)
        except MaterialError:
            return None

    def _find_material(self, name: str) -> Material:
        """Return a material with the requested damping, or its default if it has no such set."""
        material, damping = Material.named(name), self._options.damping
        with suppress(MaterialError):
            return Material.named(name, damping)
        note = f"{material.name} has no set {damping!r}: it rings with its default damping"
        self._remarks += [note] * (note not in self._remarks)
        return material

    def _model(self, link: Link, material: Material | None) -> tuple[ModalModel | None, str]:
        """Return the model of a link's sound, or None and the reason."""
        if self._is_mute(link.name):
            return None, "mute= says so"
        if link.name in self._finished_models:
            return self._finished_models[link.name], ""
        source = _chosen(self._options.models, link.name)
        shape = None if _is_finished(source) else source
        shape = shape or link.shape
        if shape is None:
            return None, f"{link.why_silent}; name a shape with models="
        if material is None:
            description = f" ({link.material!r} is none of struck's)" if link.material else ""
            return None, f"its material is not given{description}; name it with materials="
        result = self._analyze_shape(shape, material, link.name)
        return (None, result) if isinstance(result, str) else (result, "")

    def _analyze_shape(self, shape: ShapeSource, material: Material, name: str) -> ModalModel | str:
        """Return the modal model of a shape, or the message of the error it ended in."""
        options = self._options
        wall, support = _chosen(options.walls, name), _chosen(options.fixed, name)
        key = tuple(map(content_key, (shape, material, wall, support)))
        if key not in self._results:
            try:
                self._results[key] = analyze(
                    shape,
                    material,
                    wall=wall,
                    fixed=support,
                    band=options.band,
                    **applicable(shape, accuracy=options.accuracy),
                    cache=options.cache,
                    progress=options.progress,
                )
            except StruckError as error:
                self._results[key] = str(error)
        return self._results[key]


def _is_finished(source: Sounding | None) -> TypeIs[ModalModel | str | os.PathLike[str]]:
    """Return whether the entry of `models` for a body is a model, or a model's file."""
    if isinstance(source, str | os.PathLike):
        return is_model(source)
    return isinstance(source, ModalModel)


def content_key(value: object) -> str | int:
    """Return a key that is equal for equal values: a fingerprint of the content.

    The key of a file is its path; that of a function, or of another package's object, its identity.
    """
    if isinstance(value, str | os.PathLike):
        return str(real(value))
    try:
        return fingerprint(value)
    except TypeError:  # its content is unknown
        return id(value)


def _make_rigid_body(
    link: Link, material: Material | None, mass: MassProperties | None
) -> RigidBody:
    """Return the surface and mass of a link that makes no sound."""
    shape = link.shape
    if isinstance(shape, Solid):
        shape = shape.volume_mesh("preview").surface()[0]
    if mass is None or link.fixed:
        return RigidBody(geometry=shape, material=material, plane=link.plane)
    return RigidBody(
        geometry=shape, material=material, mass=mass.mass, centre=mass.centre, inertia=mass.inertia
    )


def _chosen(table: Mapping[str, T] | None, name: str) -> T | None:
    """Return the value of the first pattern that a name fits."""
    return next((v for pattern, v in (table or {}).items() if fnmatchcase(name, pattern)), None)


def model_mass(model: ModalModel) -> MassProperties | None:
    """Return the mass properties of a model, where it knows them."""
    if model.mass is None or model.centre is None or model.inertia is None:
        return None
    centre: Array = np.asarray(model.centre)
    return MassProperties(mass=model.mass, centre=centre, inertia=np.asarray(model.inertia))
