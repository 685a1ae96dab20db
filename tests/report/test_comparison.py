"""Models beside recordings and other models."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import ModalModel, Rayleigh, Sound, Strike
from struck.errors import ContactError, FileFormatError, OptionError, RecordingError
from struck.recordings.noise import Noise
from struck.recordings.poles.search import search
from struck.recordings.segments import Segment
from struck.report.comparison import HEADINGS, Comparison, compare
from struck.shapes import Bar, CircularMembrane
from struck.solids import Block

Array = NDArray[np.float64]

RATE = 48000
BAR = Bar(length=0.4, width=0.03, thickness=0.005)
HINGED = Bar(length=0.4, width=0.03, thickness=0.005, ends="hinged", theory="euler-bernoulli")
END, QUARTER = Strike(at="end", impulse=0.01), Strike(at="quarter", impulse=0.01)


@pytest.fixture(scope="module")
def bar() -> ModalModel:
    """A free steel bar with the losses of wood, so that two seconds tell them."""
    steel = replace(struck.Material.named("steel"), damping=Rayleigh(mass=6.0, stiffness=1e-8))
    return struck.analyze(BAR, steel, band=(100, 20_000), recoil=False)


def modes_of(model: ModalModel, gains: Array | None = None) -> SimpleNamespace:
    """Return the modes of a model as if they had been fitted."""
    heard = np.ones(len(model.frequencies)) if gains is None else gains
    return SimpleNamespace(frequencies=model.frequencies, decays=model.decays, gains=heard)


def fitted_to(sound: Sound) -> SimpleNamespace:
    noise = Noise.white([(1e-7 * sound.peak) ** 2])
    found = search([Segment.of(sound.samples.astype(float), sound.sample_rate, noise)])
    return SimpleNamespace(frequencies=found.frequencies, decays=found.decays, gains=found.gains)


@pytest.mark.prove
def test_a_body_beside_itself_struck_elsewhere(bar: ModalModel) -> None:
    sound = struck.render(bar, QUARTER, seconds=2, sample_rate=RATE)
    found = compare(bar, fitted_to(sound), strike=END, recording=sound)
    assert len(found.pairs) == len(bar.frequencies)
    assert np.abs(found.cents).max() < 0.1
    assert np.abs(found.decay_ratios - 1).max() < 0.02
    assert not len(found.missing)
    assert not len(found.extra)
    assert found.explained
    assert np.ptp(found.level_differences) > 6  # it was struck elsewhere


def test_levels_are_those_of_the_contacts() -> None:
    """A hinged bar vibrates in sines, and what reaches the ear goes with their height."""
    model = struck.analyze(HINGED, "steel", band=(20, 8000))
    one, two = 0.11, 0.17
    strikes = [Strike(at=(x, 0.0, 0.0025), direction=(0, 0, -1), impulse=0.01) for x in (one, two)]
    found = compare(model, model, strike=strikes[0], against=strikes[1])
    orders = np.arange(1, len(model.frequencies) + 1)
    heights = np.abs(np.sin(np.pi * np.outer([one, two], orders) / HINGED.length))
    assert found.level_differences == pytest.approx(
        20 * np.log10(heights[1] / heights[0]), abs=1e-3
    )
    assert found.cents == pytest.approx(np.zeros(len(orders)), abs=1e-9)
    assert any("absolute" in line for line in found.summary())


@pytest.mark.prove
def test_equal_bodies_are_equal_wherever_they_are_struck() -> None:
    """Elements of one block, coarse and fine, and one of another size."""
    block, band = Block(size=(0.2, 0.05, 0.01)), (20, 5000)
    model, finer = (
        struck.analyze(block, "steel", accuracy=each, band=band) for each in ("preview", "standard")
    )
    apart = compare(model, finer, strike=Strike(), against=Strike(at="middle"))
    assert np.nanmax(np.abs(apart.level_differences)) > 3
    for at in (None, "vertex:3", (0.04, 0.01, 0.005)):
        found = compare(model, finer, at=at)
        assert np.abs(found.level_differences).max() < 0.7
        larger = compare(model, model.scaled(1.5), at=at, strike=Strike(impulse=0.01))
        assert np.ptp(larger.level_differences) < 1e-6
        where = model.contact(at).point
        for side, place in ((larger.model, where), (larger.other, 1.5 * where)):
            told = ", ".join(f"{value:.4g}" for value in np.round(place, 9) + 0.0)
            assert f"({told}) m" in side.struck
            assert f"the {side.name} is {side.struck}" in larger.summary()


def test_a_recording_is_said_to_be_of_the_strike(bar: ModalModel) -> None:
    alone, told = compare(bar, modes_of(bar)), compare(bar, modes_of(bar), at="end")
    assert "taken to be of that strike" in alone.other.struck
    assert "give the place or the blow" in alone.other.struck
    assert "give the place" not in told.other.struck
    assert "struck at end" in told.model.struck


def test_a_longer_pulse_dulls_the_model(bar: ModalModel) -> None:
    """Half a sine of duration T passes 1 / (1 - (2 f T)^2) cos(pi f T) of an impulse."""
    soft = replace(END, duration=1e-4)
    found = compare(bar, bar, strike=END, against=soft)
    turns = found.model.partials.frequencies[found.pairing.computed] * 1e-4
    passed = np.abs(np.cos(np.pi * turns) / (1 - (2 * turns) ** 2))
    loud = passed > 1e-2
    assert found.level_differences[loud] == pytest.approx(20 * np.log10(passed[loud]), abs=0.05)


def test_a_twin_at_one_frequency_is_heard_with_the_other() -> None:
    """A circular membrane has its modes with a nodal diameter two by two."""
    membrane = CircularMembrane(radius=0.15, thickness=2.5e-4, tension=3000.0)
    drum = struck.analyze(membrane, "nylon", band=(50, 1200))
    once = np.unique(drum.frequencies.round(6), return_index=True)[1]
    assert len(once) < len(drum.frequencies)
    heard = SimpleNamespace(
        frequencies=drum.frequencies[once], decays=drum.decays[once] + 1, gains=np.ones(len(once))
    )
    found = compare(drum, heard, strike=Strike(at=(0.1, 0.02, 0)))
    assert len(found.pairs) == len(once)
    assert not len(found.missing)
    assert len(found.twins) + len(found.pairs) == len(drum.frequencies)
    assert any("share a frequency" in line for line in found.summary())


def test_size_and_damping_show_as_cents_and_ratios(bar: ModalModel) -> None:
    smaller = bar.scaled(0.99).damped(Rayleigh(mass=12.0, stiffness=2e-8))
    found = compare(bar, smaller, strike=END)
    assert found.cents == pytest.approx(np.full(len(found.cents), -1200 * np.log2(0.99)), abs=0.05)
    assert found.decay_ratios == pytest.approx(
        smaller.decays[found.pairs[:, 1]] / bar.decays[found.pairs[:, 0]]
    )
    assert found.pairs[:, 0].tolist() == found.pairs[:, 1].tolist()


def test_modes_of_one_side_alone_are_named(bar: ModalModel) -> None:
    fitted = modes_of(bar)
    kept = np.arange(len(bar.frequencies)) != 5
    fitted.frequencies = np.r_[bar.frequencies[kept], 1200.0, 30_000.0]
    fitted.decays = np.r_[bar.decays[kept], 5.0, 5.0]
    fitted.gains = np.ones(len(fitted.frequencies))
    found = compare(bar, fitted, strike=END)
    assert found.missing.tolist() == [5]
    assert fitted.frequencies[found.extra].tolist() == [1200.0]  # the bar is known to 20 kHz


def test_modes_that_the_strike_does_not_wake_are_not_missed(bar: ModalModel) -> None:
    """In the middle of a bar every second mode has a node."""
    fitted = modes_of(bar)
    odd = np.arange(len(bar.frequencies)) % 2 == 0
    fitted = SimpleNamespace(
        frequencies=bar.frequencies[odd], decays=bar.decays[odd], gains=np.ones(odd.sum())
    )
    middle = Strike(at=(0.2, 0.0, 0.0025), direction=(0, 0, -1), impulse=0.01)
    found = compare(bar, fitted, strike=middle)
    assert len(found.pairs) == odd.sum()
    assert not len(found.missing)
    assert len(compare(bar, fitted, strike=END).missing) == (~odd).sum()


def test_recordings_are_relative(bar: ModalModel) -> None:
    quiet, loud = (
        compare(bar, modes_of(bar, level * np.ones(16)), strike=END) for level in (1, 10)
    )
    assert loud.level_offset - quiet.level_offset == pytest.approx(20)
    assert loud.level_differences == pytest.approx(quiet.level_differences)
    assert np.median(loud.level_differences) == pytest.approx(0)


class Reader(HTMLParser):
    """What a page holds."""

    def __init__(self) -> None:
        super().__init__()
        self.count: dict[str, int] = {}
        self.sources: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.count[tag] = self.count.get(tag, 0) + 1
        self.sources += [value or "" for name, value in attrs if name in {"src", "href"}]

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.fixture(scope="module")
def comparison(bar: ModalModel) -> Comparison:
    fitted = modes_of(bar.scaled(1.01))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("struck.report.comparison._SECONDS", 0.5)  # pictures of less take less
        return compare(bar, fitted, strike=END)


def test_the_page_needs_no_other_file(comparison: Comparison, tmp_path: Path) -> None:
    comparison.save_page(tmp_path / "page.html")
    reader = Reader()
    reader.feed((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert reader.count["audio"] == 2
    assert reader.count["img"] == 4
    assert reader.sources
    assert all(source.startswith("data:") for source in reader.sources)
    assert reader.count["tr"] == 1 + len(comparison.pairs)
    for line in (*comparison.summary(), *HEADINGS):
        assert line in reader.text
    assert "-17.23" in reader.text  # cents of one per cent


@pytest.mark.prove
def test_a_page_without_pairs_is_a_page(bar: ModalModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("struck.report.comparison._SECONDS", 0.5)
    stranger = SimpleNamespace(frequencies=[31.0], decays=[1.0], gains=[1.0])
    found = compare(bar, stranger, strike=END)
    assert not len(found.pairs)
    assert not found.explained
    assert "caution" in found.page()


def test_what_does_not_belong_is_refused(
    bar: ModalModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sound = Sound(samples=np.zeros(100, np.float32), sample_rate=RATE)
    with pytest.raises(OptionError, match="against="):
        compare(bar, modes_of(bar), strike=END, against=END)
    with pytest.raises(OptionError, match=r"at is 'end' and .* give the place once"):
        compare(bar, bar, at="end", strike=END)
    with pytest.raises(OptionError, match="recording="):
        compare(bar, bar, strike=END, recording=sound)
    with pytest.raises(ContactError, match="wakes none of"):
        compare(bar, bar, strike=Strike(at="end", direction=(1, 0, 0), impulse=0.01))
    with pytest.raises(RecordingError, match="0 fitted modes"):
        compare(bar, SimpleNamespace(frequencies=[], decays=[], gains=[]), strike=END)
    monkeypatch.setattr(Comparison, "page", lambda _: "pictures take a second")
    with pytest.raises(FileFormatError):
        compare(bar, bar, strike=END).save_page(tmp_path / "nowhere" / "page.html")
    with pytest.raises(FileFormatError, match=r"pages end in .html, .htm, as x.html"):
        compare(bar, bar, strike=END).save_page(tmp_path / "x.png")
