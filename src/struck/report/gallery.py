"""The gallery: bodies and a recording, computed, struck, drawn and put on pages that play."""

from __future__ import annotations

import html
import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib import resources
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from struck.analysis.analysis import BAND, analyze
from struck.analysis.discretisation import Solid
from struck.analysis.source_options import applicable
from struck.errors import counted, require_choice, rounded
from struck.excitation.excitation import Hold
from struck.excitation.pluck import Pluck
from struck.excitation.roughness import Profile, Roughness
from struck.excitation.scrape import Roll, Scrape
from struck.excitation.strike import Strike
from struck.files import model_file
from struck.files.atomic import make_folder, write_bytes
from struck.files.sound import Sound
from struck.model.arrays import checked
from struck.model.damping import InternalFriction, Rayleigh
from struck.model.html import document
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Progress, silent, table_of
from struck.recordings.fit import fit_recordings
from struck.report.charts import overview, spectrogram
from struck.report.charts import save as save_picture
from struck.report.figurine import bird, written
from struck.report.fit_page import report
from struck.report.model_page import Exhibit, page, page_of, section
from struck.report.obrien2002 import scene_sections
from struck.scene.body import Action
from struck.scene.render import render
from struck.shapes import (
    AnnularMembrane,
    Bar,
    CircularMembrane,
    CircularPlate,
    PolygonMembrane,
    RectangularMembrane,
    RectangularPlate,
    String,
)
from struck.shapes.shape import Shape
from struck.solids import Block, Tube
from struck.solids.revolution import Revolution, bell, bowl, wine_glass


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """One body of the gallery: computed, struck, drawn and saved."""

    name: str  # key of its title and text in `gallery.toml`
    body: Callable[[], Solid | Mesh | Shape]
    material: str | Material
    sounds: tuple[tuple[str, Action | Sequence[Action]], ...] = ()  # unless the table has them
    band: tuple[float, float] = BAND  # Hz
    wall: float | None = None  # of a hollow mesh, m
    damping: str = "own"
    spectrograms: bool = False  # whether each sound gets a separate picture

    @property
    def title(self) -> str:
        """Title over the body's page."""
        return table_of("struck.report", "gallery")[self.name]["title"]

    def exhibit(self, folder: Path, progress: Progress) -> Exhibit:
        """Compute the body into a folder, with its sounds and its picture."""

        def staged(stage: str, fraction: float) -> None:
            progress(f"{self.title}: {stage}", fraction)

        body = self.body()
        source = written(body, folder / f"{self.name}.obj") if isinstance(body, Mesh) else body
        model = analyze(
            source,
            self.material,
            band=self.band,
            wall=self.wall,
            damping=self.damping,
            progress=staged,
            **applicable(source, accuracy="preview", up="z"),
        )
        model_file.save(model, folder / f"{self.name}.struck")
        staged("sounds", 0.0)
        sounds = list(self._played(model, folder))
        staged("picture", 0.0)
        picture = overview(model, sounds[0][1], title=self.title)
        save_picture(picture, folder / f"{self.name}.png")
        return Exhibit(
            title=self.title,
            text=f"{table_of('struck.report', 'gallery')[self.name]['text']} {_origin(model)}",
            model=model,
            sounds=sounds,
            picture=picture,
            spectrograms=[spectrogram(sound) for _, sound in sounds] if self.spectrograms else (),
        )

    def _played(self, model: ModalModel, folder: Path) -> Iterator[tuple[str, Sound]]:
        sounds = table_of("struck.report", "gallery")[self.name].get("sounds", {})
        kinds = {"strike": Strike, "pluck": Pluck}
        read = [
            (caption, kinds[kind](**arguments))
            for caption, excitations in sounds.items()
            for kind, arguments in excitations.items()
        ]
        for number, (caption, actions) in enumerate(self.sounds or read, start=1):
            sound = render(model, actions, seconds=3.0)
            sound.save(folder / f"{self.name}_{number}.wav", encoding="int24")
            yield caption, sound


def _origin(model: ModalModel) -> str:
    """Return by which way the modes of a body were found, and by which damping they decay."""
    method = "finite elements" if getattr(model.gains, "formula", None) is None else "a formula"
    damping = None if model.material is None else model.material.damping
    losses = "its own losses alone, as if nothing held it"
    if isinstance(damping, Rayleigh):
        losses = 'damping "as heard", tuned by ear, with its support and the air in it'
    if not len(model.decays):
        return f"By {method}: it has no mode that is heard, and sounds by its recoil alone."
    longest = float(np.log(1000) / model.decays.min())
    return (
        f"Modes by {method}; {losses}: the slowest takes {rounded(longest, 2)} s to fall by 60 dB."
    )


# A recorded drum, and the model of it.

NAME, TITLE = "tabla", "A recorded tabla"


def recording(folder: Path, progress: Progress) -> str:
    """Fit the recording, save it as recorded and half and twice as large, return its page."""

    def staged(stage: str, fraction: float) -> None:
        progress(f"{TITLE}: {stage}", fraction)

    with resources.as_file(resources.files("struck.report") / f"{NAME}.wav") as path:
        made = fit_recordings(path, residual=True, progress=staged)
    model_file.save(made.model, folder / f"{NAME}.struck")
    for name, size in (("half", 0.5), ("recorded", 1.0), ("twice", 2.0)):
        model = made.model if size == 1 else made.model.scaled(size)
        # In other sizes the recorded attack no longer meets the modes: a push that takes time does.
        blow = Strike(impulse=1.0, duration=0.0 if size == 1 else 5e-4 * size, time=0.01)
        render(model, blow).save(folder / f"{NAME}_{name}.wav")
    return report(made)


# Bodies that finite elements compute.

SOLIDS_INTRODUCTION = (
    "Each body below is a shape and a material, nothing else: its modes of vibration were "
    "computed by finite elements, and the sounds are those modes under a touch. The pages of the "
    "string, bar, membranes and plates show bodies whose modes have a formula instead; the tabla "
    "was recorded."
)

_FROM, _TO = (-0.1, -0.06, 0.0015), (0.11, 0.05, 0.0015)
_FROM_ROUGH_TO_SMOOTH = ("sandpaper p80", "rough wood", "wood", "steel", "glass")
_SANDPAPER = Profile.named("sandpaper")


def _scrape(roughness: str | Roughness | Profile, speed: float = 0.15) -> Scrape:
    return Scrape(
        path=(_FROM, _TO),
        speed=speed,
        load=2.0,
        roughness=roughness,
        radius=0.5e-3,
        repeat="once" if speed < 0.2 else "back",
        seconds=3.0,
    )


def _ring(name: str, length: float) -> Profile:
    """Return a finish read along a circle of some length, m: it repeats after each round."""
    phases = 2 * np.pi * np.arange(1 << 13) / (1 << 13)
    circle = np.stack([np.cos(phases), np.sin(phases), 0 * phases], axis=1) * length / (2 * np.pi)
    return Profile(heights=Roughness.named(name).layers().at(circle), pitch=length / (1 << 13))


def _blow(time: float = 0.0) -> Strike:
    return Strike(at=_FROM, striker="wood", speed=1.0, time=time)


def _thrown(blows: int, first: float, restitution: float) -> Sequence[Strike]:
    """Return the strikes of a ball that bounces: `first` s between two blows, less each time."""
    gaps = first * restitution ** np.arange(blows)
    times, places = np.cumsum(gaps) - first, ("top", "+x", "bottom", "-y")
    return [
        Strike(at=places[n % 4], striker="steel", speed=float(gaps[n]), time=float(times[n]))
        for n in range(blows)
    ]


def _half_circle(radius: float) -> Sequence[tuple[float, float]]:
    """Return the profile (r, z) of a ball, from pole to pole."""
    angles = np.linspace(0, np.pi, 33)
    return [(round(radius * np.sin(a), 9), round(-radius * np.cos(a), 9)) for a in angles]


SOLIDS = (
    Piece(
        name="chime",
        body=lambda: Tube(length=0.505, radius=0.0125, wall=0.001),
        material="aluminium",
        damping="heard",
    ),
    Piece(name="bowl", body=bowl, material="bronze"),
    Piece(name="bell", body=bell, material="bronze"),
    Piece(name="glass", body=wine_glass, material="glass"),
    Piece(name="bird", body=bird, material="ceramic", damping="heard", wall=0.004),
    Piece(
        name="die",
        body=lambda: Block(size=(0.012, 0.012, 0.012)),
        material="steel",
        sounds=(
            ("steel, 0.5 m/s", Strike(at="top", striker="steel", speed=0.5)),
            ("wood, 0.5 m/s", Strike(at="top", striker="wood", speed=0.5)),
            ("thrown: blows that come faster and weaker", _thrown(12, 0.5, 0.8)),
        ),
    ),
    Piece(
        name="marble",
        body=lambda: Revolution(profile=_half_circle(0.008)),
        material="glass",
        sounds=(
            ("steel, 0.5 m/s", Strike(at="top", striker="steel", speed=0.5)),
            ("dropped: blows that come faster and weaker", _thrown(20, 0.6, 0.85)),
        ),
    ),
    Piece(
        name="plate",
        body=lambda: Block(size=(0.3, 0.2, 0.003)),
        material="steel",
        damping="heard",
        sounds=(
            ("struck with wood", _blow()),
            ("scraped: sandpaper", _scrape("sandpaper")),
            ("scraped: wood", _scrape("wood")),
            ("scraped: concrete", _scrape("concrete")),
            (
                "a marble rolls over it",
                Roll(path=(_FROM, _TO), radius=0.012, speed=0.15, mass=0.02),
            ),
            ("struck free, then held", [_blow(), _blow(1.5), Hold(at=_TO, grip=30.0, time=1.5)]),
        ),
        spectrograms=True,
    ),
    Piece(
        name="surfaces",
        body=lambda: Block(size=(0.3, 0.2, 0.008)),
        material="oak",
        damping="heard",
        sounds=(
            ("a profile of ground steel, 51 mm over and over", _scrape(_ring("steel", 0.051), 0.3)),
            ("ground steel", _scrape("steel", 0.3)),
            ("a profile of sandpaper, 267 mm over and over", _scrape(_SANDPAPER, 0.3)),
            ("sandpaper P120", _scrape("sandpaper", 0.3)),
            *((f"{name}, 0.15 m/s", _scrape(name)) for name in _FROM_ROUGH_TO_SMOOTH),
            ("planed wood, 0.6 m/s", _scrape("wood", 0.6)),
            ("a marble rolls", Roll(path=(_FROM, _TO), radius=0.012, speed=0.15, mass=0.02)),
            (
                "a marble with a flat spot rolls",
                Roll(path=(_FROM, _TO), radius=0.012, speed=0.3, mass=0.02, flat=3e-6),
            ),
        ),
        spectrograms=True,
    ),
)

SHAPES_INTRODUCTION = (
    "The sounds of physical shapes (van den Doel & Pai 1998): the modes of this body have a "
    "formula. Listen how the timbre changes with the place that is struck."
)
# Bodies in closed form: the six of 1998, section 6, and their kin.
SKIN = Material(
    name="polyester film",
    density=1390.0,
    youngs_modulus=4.5e9,
    poisson_ratio=0.38,
    damping=InternalFriction(loss_tangent=0.006),
)
WIRE = Material(
    name="music wire",
    density=7850.0,
    youngs_modulus=2.1e11,
    poisson_ratio=0.29,
    damping=InternalFriction(loss_tangent=4e-4, external=0.5),
)


# A drum has tens of thousands of modes up to 20 kHz; its blows wake some hundreds.
_DRUM = (20.0, 2500.0)


def _blows(**places: tuple[float, ...]) -> tuple[tuple[str, Strike], ...]:
    """Return blows with wood at places, which are named by their captions."""
    return tuple(
        (name.replace("_", " "), Strike(at=at, striker="wood", speed=1.0))
        for name, at in places.items()
    )


SHAPES = (
    Piece(
        name="string",
        body=lambda: String(length=0.65, radius=4e-4, tension=80.7, stiff=True),
        material=WIRE,
    ),
    Piece(
        name="bar",
        body=lambda: Bar(length=0.30, width=0.03, thickness=0.005, ends="clamped"),
        material="steel",
        damping="heard",
        sounds=_blows(near_the_end=(0.02,), at_a_quarter=(0.075,), at_the_middle=(0.15,)),
    ),
    Piece(
        name="rectangular_membrane",
        body=lambda: RectangularMembrane(length=0.5, width=0.4, thickness=2.5e-4, tension=3000.0),
        material=SKIN,
        band=_DRUM,
        sounds=_blows(
            near_the_corner=(0.05, 0.04), near_an_edge=(0.05, 0.16), near_the_middle=(0.25, 0.16)
        ),
    ),
    Piece(
        name="circular_membrane",
        body=lambda: CircularMembrane(radius=0.165, thickness=2.5e-4, tension=3000.0),
        material=SKIN,
        band=_DRUM,
        sounds=_blows(near_the_rim=(0.15, 0.0), halfway=(0.08, 0.0), at_the_middle=(0.0, 0.0)),
    ),
    Piece(
        name="annular_membrane",
        body=lambda: AnnularMembrane(radius=0.165, hole=0.05, thickness=2.5e-4, tension=3000.0),
        material=SKIN,
        band=_DRUM,
        sounds=_blows(near_the_rim=(0.155, 0.0), halfway=(0.107, 0.0)),
    ),
    Piece(
        name="circular_plate",
        body=lambda: CircularPlate(radius=0.12, thickness=0.002, edge="clamped"),
        material="steel",
        damping="heard",
        sounds=_blows(near_the_rim=(0.105, 0.0), halfway=(0.06, 0.0), at_the_middle=(0.0, 0.0)),
    ),
    Piece(
        name="rectangular_plate",
        body=lambda: RectangularPlate(length=0.3, width=0.2, thickness=0.004, edges="free"),
        material="glass",
        damping="heard",
        sounds=_blows(
            at_the_corner=(0.29, 0.19),
            at_the_middle_of_an_edge=(0.15, 0.19),
            at_the_middle=(0.15, 0.1),
        ),
    ),
    Piece(
        name="l_membrane",
        body=lambda: PolygonMembrane.l_shape(side=0.2, thickness=2.5e-4, tension=3000.0),
        material=SKIN,
        band=(20.0, 1200.0),  # each of its modes takes a while
        sounds=_blows(
            near_the_inward_corner=(0.21, 0.19),
            in_the_end_of_an_arm=(0.36, 0.1),
            in_the_square_between=(0.1, 0.1),
        ),
    ),
)


SCENES_TITLE = "Scenes that sound"
SCENES_INTRODUCTION = (
    "The five scenes of O'Brien, Shen and Gatchalian (2002), with the constants of their Table 1: "
    "rigid bodies are simulated, and every contact excites both. Listen with headphones."
)


# The pages.

_TITLE = "struck: a gallery"
_SCENES = "scenes"
LIST = "list.txt"  # of the files that were made


@checked
def gallery(folder: Path, progress: Progress = silent, pieces: Sequence[str] | None = None) -> Path:
    """Compute models, sounds, pictures and pages into a folder.

    The first page is there from the start and is written again after each entry, so that a stop in
    between leaves a page with the finished entries.

    Parameters
    ----------
    folder : path
        Folder to make, and to write into.
    progress : callable
        Called with each stage's name and the fraction done. Default: silent.
    pieces : sequence of str, optional
        Names of the bodies to compute, with "tabla" for the recording and "scenes" for the rigid
        bodies of 2002. Default: all.

    Returns
    -------
    Path
        The first page.

    Raises
    ------
    FileFormatError
        When the folder cannot be made.
    OptionError
        On an unknown piece.
    """
    names = [*(piece.name for piece in (*SHAPES, *SOLIDS)), NAME, _SCENES]
    for piece in pieces or ():
        require_choice("pieces", piece, names)
    chosen = names if pieces is None else pieces
    make_folder(folder, parents=True)
    index = _Index(folder=folder)
    index.write()
    makers = [_pages_of_shapes(folder, progress, chosen)]
    makers += [_page_of_recording(folder, progress)] if NAME in chosen else []
    makers += [_page_of_scenes(folder, progress)] if _SCENES in chosen else []
    for name, title in itertools.chain.from_iterable(makers):
        index.links[name] = title
        index.write()
    for piece in (piece for piece in SOLIDS if piece.name in chosen):
        index.sections.append(section(piece.exhibit(folder, progress)))
        index.write()
    index.finished = True
    return index.write()


@dataclass(kw_only=True)
class _Index:
    """First page of the gallery, which is written again whenever an entry is made."""

    folder: Path
    links: dict[str, str] = field(default_factory=dict)  # titles by the pages' names
    sections: list[str] = field(default_factory=list)
    finished: bool = False

    def write(self) -> Path:
        """Write the page and the list of files as far as they are made; return the page."""
        entries = counted(len(self.links) + len(self.sections), "entry")
        state = f"{entries} made so far: reload this page for more, or run `struck demo` again."
        introduction = SOLIDS_INTRODUCTION if self.finished else f"{state} {SOLIDS_INTRODUCTION}"
        text = page_of(_TITLE, introduction, self.sections, self.links)
        path = _written(self.folder / "index.html", text)
        made = sorted(path.name for path in self.folder.iterdir() if path.name != LIST)
        _written(self.folder / LIST, "\n".join(made) + "\n")
        return path


def _pages_of_shapes(
    folder: Path, progress: Progress, chosen: Sequence[str]
) -> Iterator[tuple[str, str]]:
    """Write a page for each closed form among the chosen; yield its name and title."""
    back = {"index.html": _TITLE}
    for piece in (piece for piece in SHAPES if piece.name in chosen):
        exhibit = piece.exhibit(folder, progress)
        text = page(f"struck: {piece.title}", SHAPES_INTRODUCTION, [exhibit], back)
        _written(folder / f"{piece.name}.html", text)
        yield f"{piece.name}.html", piece.title


def _page_of_recording(folder: Path, progress: Progress) -> Iterator[tuple[str, str]]:
    """Write the page of the recorded drum; yield its name and title."""
    _written(folder / f"{NAME}.html", recording(folder, progress))
    yield f"{NAME}.html", TITLE


def _page_of_scenes(folder: Path, progress: Progress) -> Iterator[tuple[str, str]]:
    """Write the page of the scenes of 2002 again after each, if MuJoCo is installed."""
    if find_spec("mujoco") is None:
        return
    head = f'<p>{html.escape(SCENES_INTRODUCTION)}</p><nav><a href="index.html">{_TITLE}</a></nav>'
    made = ""
    for part in scene_sections(folder, progress):
        made += f"{part}\n"
        _written(folder / "scenes.html", document(f"struck: {SCENES_TITLE}", head + made))
        yield "scenes.html", SCENES_TITLE


def _written(path: Path, text: str) -> Path:
    write_bytes(path, text.encode())
    return path
