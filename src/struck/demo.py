"""The demo: a gallery of bodies, computed, struck, drawn and put on one page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from struck.analysis import Solid, analyze
from struck.atomic import write_bytes
from struck.bird import bird, written
from struck.errors import FileFormatError
from struck.excitation.hold import Hold
from struck.excitation.roll import Roll
from struck.excitation.scrape import Scrape
from struck.excitation.strike import Strike
from struck.files import model_file
from struck.mesh import Mesh
from struck.model import ModalModel
from struck.pictures import overview, spectrogram
from struck.pictures import save as save_picture
from struck.progress import Progress, silent
from struck.rendering import Action, render
from struck.report import Exhibit, page
from struck.solids import Block, Tube
from struck.solids.profiles import bell, bowl, wine_glass
from struck.sound import Sound

_INTRODUCTION = (
    "Each body below is a shape and a material, nothing else: its modes of vibration were "
    "computed by finite elements, and the sounds are those modes under a touch."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """One body of the gallery.

    Parameters
    ----------
    name, title, text : str
    body : callable
        Makes the body.
    material : str
    sounds : sequence of (caption, what happens)
    wall : float or None
        m, of a hollow mesh.
    damping : str
    spectrograms : bool
        Whether each sound gets a picture of its own.
    """

    name: str
    title: str
    text: str
    body: Callable[[], Solid | Mesh]
    material: str
    sounds: tuple[tuple[str, Action | Sequence[Action]], ...]
    wall: float | None = None
    damping: str = "own"
    spectrograms: bool = False


def gallery(folder: Path, progress: Progress = silent) -> Path:
    """Compute the gallery: models, sounds, pictures and the page that plays them.

    Parameters
    ----------
    folder : Path
        Made where it is missing.
    progress : callable
        Told the stage and the fraction of it that is done.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    FileFormatError
        When the folder cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(f"{folder} cannot be made ({error.strerror}): name another") from None
    exhibits = [_exhibit(piece, folder, progress) for piece in PIECES]
    target = folder / "index.html"
    write_bytes(target, page("struck: a gallery", _INTRODUCTION, exhibits).encode())
    return target


def _exhibit(piece: Piece, folder: Path, progress: Progress) -> Exhibit:
    def staged(stage: str, fraction: float) -> None:
        progress(f"{piece.title}: {stage}", fraction)

    body = piece.body()
    source = written(body, folder / f"{piece.name}.obj") if isinstance(body, Mesh) else body
    model = analyze(
        source,
        piece.material,
        up="z" if isinstance(body, Mesh) else None,
        wall=piece.wall,
        damping=piece.damping,
        progress=staged,
    )
    model_file.save(model, folder / f"{piece.name}.struck")
    staged("sounds", 0.0)
    sounds = list(_sounds(piece, model, folder))
    staged("picture", 0.0)
    picture = overview(model, sounds[0][1], title=piece.title)
    save_picture(picture, folder / f"{piece.name}.png")
    return Exhibit(
        title=piece.title,
        text=piece.text,
        model=model,
        sounds=sounds,
        picture=picture,
        spectrograms=[spectrogram(sound) for _, sound in sounds] if piece.spectrograms else (),
    )


def _sounds(piece: Piece, model: ModalModel, folder: Path) -> Iterator[tuple[str, Sound]]:
    for number, (caption, actions) in enumerate(piece.sounds, start=1):
        sound = render(model, actions, seconds=3.0)
        sound.save(folder / f"{piece.name}_{number}.wav", encoding="int24")
        yield caption, sound


_FROM, _TO = (-0.1, -0.06, 0.0015), (0.11, 0.05, 0.0015)


def _scrape(roughness: str) -> Scrape:
    return Scrape(path=(_FROM, _TO), speed=0.15, load=2.0, roughness=roughness, radius=0.5e-3)


def _blow(time: float = 0.0) -> Strike:
    return Strike(at=_FROM, striker="wood", speed=1.0, time=time)


PIECES = (
    Piece(
        name="chime",
        title="A wind chime",
        text="The D tube of the wind chimes of O'Brien et al. (2002): aluminium, 505 mm long. "
        "Struck at its end every bending mode speaks; at the middle every second one is silent.",
        body=lambda: Tube(length=0.505, radius=0.0125, wall=0.001),
        material="aluminium",
        damping="heard",
        sounds=(
            ("wooden striker at the end", Strike(at="end", striker="wood", speed=1.0)),
            ("wooden striker at the middle", Strike(at="middle", striker="wood", speed=1.0)),
            ("steel striker at the end", Strike(at="end", striker="steel", speed=1.0)),
        ),
    ),
    Piece(
        name="bowl",
        title="A bronze bowl",
        text="A shallow singing bowl, struck on its rim.",
        body=bowl,
        material="bronze",
        sounds=(
            ("felt on the rim", Strike(at="rim", striker="felt", speed=1.0)),
            ("wood on the rim", Strike(at="rim", striker="wood", speed=1.0)),
        ),
    ),
    Piece(
        name="bell",
        title="A bronze bell",
        text="A bell with a thick sound bow.",
        body=bell,
        material="bronze",
        sounds=(
            ("steel on the rim", Strike(at="rim", striker="steel", speed=1.0)),
            ("wood on the side", Strike(at="side", striker="wood", speed=1.0)),
        ),
    ),
    Piece(
        name="glass",
        title="A wine glass",
        text="Bowl, stem and foot of one piece of glass.",
        body=wine_glass,
        material="glass",
        sounds=(
            ("fingertip on the rim", Strike(at="rim", striker="fingertip", speed=1.0)),
            ("plastic on the rim", Strike(at="rim", striker="plastic", speed=0.5)),
        ),
    ),
    Piece(
        name="bird",
        title="A hollow ceramic bird",
        text="A closed triangle mesh from a file (bird.obj, beside this page), filled to a wall "
        "of 4 mm: the road that any scan or model takes.",
        body=bird,
        material="ceramic",
        damping="heard",
        wall=0.004,
        sounds=(
            ("wood on the head", Strike(at="top", striker="wood", speed=0.5)),
            ("steel on the head", Strike(at="top", striker="steel", speed=0.5)),
            ("fingertip on the tail", Strike(at="-x", striker="fingertip", speed=1.0)),
        ),
    ),
    Piece(
        name="plate",
        title="A steel plate, touched in many ways",
        text="One body, 300 x 200 x 3 mm: struck, scraped over three kinds of roughness (measured "
        "profiles of sandpaper and wood from ThreeDWorld, and a fractal one of concrete), rolled "
        "on, and struck twice, with a hand that takes hold at the second blow.",
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
)
