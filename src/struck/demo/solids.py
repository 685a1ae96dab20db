"""Bodies of the gallery that finite elements compute."""

from __future__ import annotations

from struck.bird import bird
from struck.demo.piece import Piece
from struck.excitation.hold import Hold
from struck.excitation.roll import Roll
from struck.excitation.scrape import Scrape
from struck.excitation.strike import Strike
from struck.solids import Block, Tube
from struck.solids.profiles import bell, bowl, wine_glass

INTRODUCTION = (
    "Each body below is a shape and a material, nothing else: its modes of vibration were "
    "computed by finite elements, and the sounds are those modes under a touch."
)

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
