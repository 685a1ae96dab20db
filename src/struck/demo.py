"""The demo: a gallery of bodies, computed, struck, drawn and put on one page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from struck.analysis import Solid, analyze
from struck.atomic import write_bytes
from struck.bird import bird, written
from struck.errors import FileFormatError
from struck.excitation.strike import Strike
from struck.files import model_file
from struck.mesh import Mesh
from struck.model import ModalModel
from struck.pictures import overview
from struck.pictures import save as save_picture
from struck.progress import Progress, silent
from struck.rendering import render
from struck.report import Exhibit, page
from struck.solids import Tube
from struck.solids.profiles import bell, bowl, wine_glass
from struck.sound import Sound

_INTRODUCTION = (
    "Each body below is a shape and a material, nothing else: its modes of vibration were "
    "computed by finite elements, and the sounds are those modes after a strike."
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
    strikes : sequence of (caption, Strike)
    wall : float or None
        m, of a hollow mesh.
    """

    name: str
    title: str
    text: str
    body: Callable[[], Solid | Mesh]
    material: str
    strikes: tuple[tuple[str, Strike], ...]
    wall: float | None = None
    damping: str = "own"


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
    return Exhibit(title=piece.title, text=piece.text, model=model, sounds=sounds, picture=picture)


def _sounds(piece: Piece, model: ModalModel, folder: Path) -> Iterator[tuple[str, Sound]]:
    for number, (caption, strike) in enumerate(piece.strikes, start=1):
        sound = render(model, strike, seconds=3.0)
        sound.save(folder / f"{piece.name}_{number}.wav", encoding="int24")
        yield caption, sound


def _strikes(*pairs: tuple[str, Strike]) -> tuple[tuple[str, Strike], ...]:
    return pairs


PIECES = (
    Piece(
        name="chime",
        title="A wind chime",
        text="The D tube of the wind chimes of O'Brien et al. (2002): aluminium, 505 mm long. "
        "Struck at its end every bending mode speaks; at the middle every second one is silent.",
        body=lambda: Tube(length=0.505, radius=0.0125, wall=0.001),
        material="aluminium",
        damping="heard",
        strikes=_strikes(
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
        strikes=_strikes(
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
        strikes=_strikes(
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
        strikes=_strikes(
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
        strikes=_strikes(
            ("wood on the head", Strike(at="top", striker="wood", speed=0.5)),
            ("steel on the head", Strike(at="top", striker="steel", speed=0.5)),
            ("fingertip on the tail", Strike(at="-x", striker="fingertip", speed=1.0)),
        ),
    ),
)
