"""One body of the gallery: computed, struck, drawn and saved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from struck.analysis.analysis import BAND, analyze
from struck.analysis.discretisation import Solid
from struck.bird import written
from struck.files import model_file
from struck.files.sound import Sound
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.progress import Progress
from struck.rendering import render
from struck.report.charts import overview, spectrogram
from struck.report.charts import save as save_picture
from struck.report.model_page import Exhibit
from struck.scene.body import Action
from struck.shapes.shape import Shape


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """One body of the gallery.

    Parameters
    ----------
    name, title, text : str
    body : callable
        Makes the body.
    material : str or Material
    sounds : sequence of (caption, what happens)
    band : pair of float
        Hz.
    wall : float or None
        m, of a hollow mesh.
    damping : str
    spectrograms : bool
        Whether each sound gets a picture of its own.
    """

    name: str
    title: str
    text: str
    body: Callable[[], Solid | Mesh | Shape]
    material: str | Material
    sounds: tuple[tuple[str, Action | Sequence[Action]], ...]
    band: tuple[float, float] = BAND
    wall: float | None = None
    damping: str = "own"
    spectrograms: bool = False

    def exhibit(self, folder: Path, progress: Progress) -> Exhibit:
        """Compute the body into a folder, with its sounds and its picture."""

        def staged(stage: str, fraction: float) -> None:
            progress(f"{self.title}: {stage}", fraction)

        body = self.body()
        source = written(body, folder / f"{self.name}.obj") if isinstance(body, Mesh) else body
        model = analyze(
            source,
            self.material,
            up="z" if isinstance(body, Mesh) else None,
            band=self.band,
            wall=self.wall,
            damping=self.damping,
            progress=staged,
        )
        model_file.save(model, folder / f"{self.name}.struck")
        staged("sounds", 0.0)
        sounds = list(self._played(model, folder))
        staged("picture", 0.0)
        picture = overview(model, sounds[0][1], title=self.title)
        save_picture(picture, folder / f"{self.name}.png")
        return Exhibit(
            title=self.title,
            text=self.text,
            model=model,
            sounds=sounds,
            picture=picture,
            spectrograms=[spectrogram(sound) for _, sound in sounds] if self.spectrograms else (),
        )

    def _played(self, model: ModalModel, folder: Path) -> Iterator[tuple[str, Sound]]:
        for number, (caption, actions) in enumerate(self.sounds, start=1):
            sound = render(model, actions, seconds=3.0)
            sound.save(folder / f"{self.name}_{number}.wav", encoding="int24")
            yield caption, sound
