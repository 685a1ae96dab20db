"""Pictures say what the numbers say."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.cbook import is_math_text
from matplotlib.collections import QuadMesh, TriMesh
from matplotlib.figure import Figure
from PIL import Image

import struck
from struck.analysis.analysis import model_of_modes
from struck.errors import FileFormatError
from struck.files.sound import Sound
from struck.model.damping import InternalFriction, Measured, Rayleigh
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.timbre_table import SinglePoint
from struck.report import charts, surface_picture
from struck.report.surface_picture import Painter

CLAY = Material(name="clay", density=2000.0, youngs_modulus=10e9, poisson_ratio=0.2)
RATE = 16000
TIMES = np.arange(RATE) / RATE
CHORD = Sound(
    samples=sum(
        part * np.exp(-5 * TIMES) * np.sin(2 * np.pi * tone * TIMES)
        for tone, part in ((440.0, 1.0), (1000.0, 0.1), (3000.0, 0.01))
    ),
    sample_rate=RATE,
    calibrated=True,
)


class Plain:
    """Radiation that hears all modes alike."""

    name = "plain"
    calibrated = False
    references = ()

    def coefficients(
        self, surface: object, shapes: object, frequencies: np.ndarray, centre: object
    ) -> np.ndarray:
        del surface, shapes, centre
        return np.ones(len(frequencies))


def model(mesh: trimesh.Trimesh, *shapes: np.ndarray, material: Material = CLAY) -> ModalModel:
    return model_of_modes(
        mesh.vertices,
        mesh.faces,
        440.0 * np.arange(1, len(shapes) + 1),
        np.stack(shapes, axis=2),
        material=material,
        mass=0.25,
        centre=np.zeros(3),
        inertia=np.eye(3),
        radiation=Plain(),
    )


BOX = trimesh.creation.box((0.2, 0.1, 0.1)).subdivide()
UPWARD = np.broadcast_to([0.0, 0.0, 1.0], BOX.vertices.shape)
STRETCH = BOX.vertices * [1.0, 0.0, 0.0]
BODY = model(BOX, UPWARD, STRETCH)


def spectrum(sound: Sound) -> Figure:
    figure = charts.chart(8.0, 4.0)
    charts._draw_spectrum(figure.subplots(), sound)
    return figure


def mode_shapes(body: ModalModel) -> Figure:
    """Draw all modes of a body as an overview does."""
    figure = charts.chart(8.0, 4.0)
    painter = Painter.of(body.gains.surface)
    charts._draw_modes(figure, painter, body, body.gains, len(body.frequencies))
    return figure


def pixels(figure: Figure) -> np.ndarray:
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=60)
    return np.asarray(Image.open(data).convert("RGB")).astype(int)


def texts(figure: Figure) -> str:
    figure.canvas.draw()
    return "\n".join(text.get_text() for text in figure.findobj(lambda o: hasattr(o, "get_text")))


def faces(figure: Figure, panel: int = 0) -> TriMesh:
    return figure.axes[panel].findobj(TriMesh)[0]


def test_spectrum_has_its_peaks_where_the_sound_has_them() -> None:
    figure = spectrum(CHORD)
    axes = figure.axes[0]
    frequencies, levels = axes.lines[0].get_data()
    for tone, level in ((440.0, 0.0), (1000.0, -20.0), (3000.0, -40.0)):
        near = np.abs(frequencies - tone) < 50
        assert frequencies[near][levels[near].argmax()] == pytest.approx(tone, abs=1)
        assert levels[near].max() == pytest.approx(level, abs=0.5)
    assert [text.get_text() for text in axes.texts] == ["440", "1000", "3000"]
    assert axes.get_xscale() == "log"
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "frequency (Hz)",
        "level (dB, strongest = 0)",
    )
    assert axes.get_title() == f"1.00 s, peak {CHORD.peak:.3g} Pa (95 dB)"  # 1 Pa is 94 dB


def test_spectrogram_shows_when_and_where() -> None:
    late = np.where(TIMES > 0.5, np.sin(2 * np.pi * 1000 * TIMES), 0)
    figure = charts.spectrogram(Sound(samples=late, sample_rate=RATE))
    axes = figure.axes[0]
    image = axes.findobj(QuadMesh)[0]
    levels = image.get_array()
    centres = image.get_coordinates()
    row, column = np.unravel_index(levels.argmax(), levels.shape)
    assert centres[row, 0, 1] < 1000 < centres[row + 2, 0, 1]
    assert centres[0, column, 0] > 0.5
    early = centres[0, :-1, 0] < 0.45
    assert levels[:, early].max() < -90
    assert axes.get_yscale() == "log"
    assert texts(figure).count("relative level") == 1


@pytest.mark.parametrize("draw", [spectrum, charts.spectrogram])
def test_silence_and_single_samples_can_be_drawn(draw: object) -> None:
    for samples in (np.zeros(1000), np.zeros(1), np.ones((2, 1))):
        assert pixels(draw(Sound(samples=samples, sample_rate=8000))).size


def test_a_mode_is_coloured_by_its_displacement_along_the_normal() -> None:
    figure = mode_shapes(BODY)
    figure.canvas.draw()
    up, along = (faces(figure, panel).get_facecolors() for panel in (0, 1))
    warmth = [colours[:, 0] - colours[:, 2] for colours in (up, along)]
    # Of the box three sides are seen, each of as many triangles; upward motion is along the
    # normal on one, a stretch along x on another.
    for share in warmth:
        assert (share > 0.15).mean() == pytest.approx(1 / 3, abs=0.01)
        assert (np.abs(share) < 0.1).mean() == pytest.approx(2 / 3, abs=0.01)
    assert not np.array_equal(warmth[0] > 0.15, warmth[1] > 0.15)


def test_titles_give_frequencies_and_ringing_times() -> None:
    damped = BODY.damped(Measured(frequencies=(100.0,), rates=(np.log(1000) / 2.5,)))
    written = texts(mode_shapes(damped))
    assert "1:  440.0 Hz" in written
    assert "2:  880.0 Hz" in written
    assert written.count("T60 2.5 s") == 2
    undamped = BODY.damped(InternalFriction(loss_tangent=0.0))
    assert "undamped" in texts(mode_shapes(undamped))


def test_only_triangles_that_face_the_eye_are_drawn_the_farthest_first() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3)
    painter = Painter.of(Mesh(points=ball.vertices, faces=ball.faces))
    axes = Figure().subplots()
    painter.paint(axes)
    (drawn,) = axes.findobj(TriMesh)
    toward = surface_picture._corners(painter.surface, np.zeros(painter.surface.faces.shape))
    facing = np.count_nonzero((toward[:, :, :3].mean(axis=1) @ painter.view[2]) > 0)
    assert len(drawn.get_facecolors()) / 3 == pytest.approx(facing, rel=0.02)
    flat, _ = surface_picture._visible(toward, painter.view, coloured=False)
    radii = np.linalg.norm(flat.mean(axis=1), axis=1)
    assert radii[:50].min() > 0.9
    assert radii[-50:].max() < 0.3


@pytest.mark.parametrize("up", "xyz")
def test_the_view_is_right_handed_and_shows_up_as_up(up: str) -> None:
    view = Painter.of(Mesh(points=BOX.vertices, faces=BOX.faces, up=up)).view
    np.testing.assert_allclose(view @ view.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(view) == pytest.approx(1)
    axis = "xyz".index(up)
    assert view[0, axis] == pytest.approx(0)
    assert view[1, axis] > 0.8


@pytest.mark.prove
def test_fine_surfaces_are_drawn_with_fewer_faces_and_say_so() -> None:
    ball = trimesh.creation.icosphere(subdivisions=5)
    fine = model(ball, ball.vertices * [0.0, 0.0, 1.0])
    painter = Painter.of(fine.geometry)
    assert len(painter.surface.faces) <= surface_picture.MOST_FACES < len(ball.faces)
    heights = painter.sources @ ball.vertices
    np.testing.assert_allclose(heights, painter.surface.points, atol=1e-3)
    figure = mode_shapes(fine)
    assert f"{len(painter.surface.faces):,} of {len(ball.faces):,} faces" in texts(figure)
    assert "faces" not in texts(mode_shapes(BODY))


def test_overview_tells_body_modes_and_sound() -> None:
    written = texts(charts.overview(BODY, CHORD))
    for part in ("clay, 0.25 kg", "200 \N{MULTIPLICATION SIGN} 100", "1:  440.0 Hz", "level (dB"):
        assert part in written
    silent = texts(charts.overview(BODY, title="My box"))
    for part in ("My box", "2 modes", "time to fall by 60 dB (s)"):
        assert part in silent


def test_pictures_have_ink_in_them() -> None:
    image = pixels(charts.overview(BODY, CHORD))
    red, green, blue = np.moveaxis(image, 2, 0)
    assert (red - blue > 60).sum() > 200
    assert (blue - red > 60).sum() > 200
    assert ((red + green + blue) < 765).mean() > 0.1


@pytest.mark.parametrize(
    ("name", "start"), [("a.png", b"\x89PNG"), ("a.PDF", b"%PDF"), ("a.svg", b"<?xml")]
)
def test_figures_are_saved_by_their_ending(tmp_path: Path, name: str, start: bytes) -> None:
    charts.save(spectrum(CHORD), tmp_path / name)
    assert (tmp_path / name).read_bytes().startswith(start)


def test_figures_that_cannot_be_saved_say_why(tmp_path: Path) -> None:
    figure = spectrum(CHORD)
    with pytest.raises(FileFormatError, match=r"'\.bmp': pictures end in \.png, \.pdf, \.svg"):
        charts.save(figure, tmp_path / "a.bmp")
    with pytest.raises(FileFormatError, match="does not exist"):
        charts.save(figure, tmp_path / "none" / "a.png")
    assert not list(tmp_path.iterdir())


def recorded(*decays: float) -> ModalModel:
    frequencies = 440.0 * np.arange(1, len(decays) + 1)
    return ModalModel(
        frequencies=frequencies,
        natural_frequencies=frequencies,
        decays=np.array(decays),
        gains=SinglePoint(outputs=np.ones(len(decays), complex)),
        complete_to=0.0,
    )


def test_overview_of_a_recorded_body_tells_ringing_times_and_sound() -> None:
    figure = charts.overview(recorded(1.0, 2.0, 40.0), CHORD, title="A mug")
    ringing, levels = figure.axes
    frequencies, times = ringing.lines[0].get_data()
    assert frequencies.tolist() == [440.0, 880.0, 1320.0]
    np.testing.assert_allclose(times, np.log(1000) / [1.0, 2.0, 40.0])
    assert [text.get_text() for text in levels.texts] == ["440", "1000", "3000"]
    for part in ("A mug", "3 modes", "time to fall by 60 dB (s)", "level (dB"):
        assert part in texts(figure)
    silent = charts.overview(recorded(1.0))
    assert len(silent.axes) == 1
    assert "1 mode" in texts(silent)


@pytest.mark.filterwarnings("ignore:.*leaves no mode that rings")
def test_models_without_modes_are_drawn_and_said_to_have_none() -> None:
    assert "0 modes" in texts(struck.show(BODY.damped(Rayleigh(mass=1e9, stiffness=0))))
    assert "0 modes" in texts(charts.overview(recorded()))


@pytest.mark.prove
@pytest.mark.parametrize(
    "name",
    [
        "a$\\frac{$b",
        *(
            pytest.param(each, marks=pytest.mark.prove)
            for each in ("a$x$b", "$", "\\$5 and $6", "$$")
        ),
    ],
)
def test_names_from_outside_are_no_formulas(name: str, tmp_path: Path) -> None:
    material = replace(CLAY, name=name)
    figure = struck.show(replace(BODY, material=material), tmp_path / "body.svg")
    heading = figure.get_suptitle()
    assert not is_math_text(heading)
    assert heading.replace(r"\$", "$").startswith(name)
    drawn = charts.overview(recorded(1.0), title=name)
    charts.save(drawn, tmp_path / "mug.png")
    assert not is_math_text(drawn.get_suptitle())
