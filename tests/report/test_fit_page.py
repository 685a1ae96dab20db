"""A report shows and plays what is true of a fit."""

from __future__ import annotations

import base64
import io
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import soundfile
from numpy.typing import NDArray

from struck.errors import RecordingError
from struck.model.survey import Survey
from struck.recordings.fit import Fitting, fit_recordings
from struck.recordings.poles.search import ModalVerdict
from struck.recordings.takes import Take
from struck.report import fit_page, fit_pictures
from struck.report.fit_page import report
from struck.report.fit_pictures import (
    Energies,
    RenderedHit,
    chosen_hits,
    hits_of,
    played,
    setting_in,
)

Array = NDArray[np.float64]

RATE = 16000
ONSET, LENGTH = 0.3, 1.0
NOISE = 1e-4
FREQUENCIES = np.array([440.0, 1210.0, 2390.0, 3970.0])
DECAYS = np.array([6.0, 9.0, 14.0, 20.0])
CONTACTS = np.linspace(0.05, 0.95, 8)
LOUDEST = 5
STEP = 1 / 2**15
"""Of 16 bits."""
FULL = 10 ** (-1 / 20)


def drives(contacts: Array) -> Array:
    """Return how strongly a string's modes are driven: sines with their number."""
    return np.sin(np.pi * np.outer(contacts, np.arange(1, len(FREQUENCIES) + 1)))


def ringing(contact: float, times: Array) -> Array:
    turns = np.exp((-DECAYS + 2j * np.pi * FREQUENCIES)[:, None] * np.maximum(times, 0))
    return 0.2 * drives(np.array([contact]))[0] @ turns.imag * (times >= 0)


def take_of(number: int, contact: float) -> Take:
    times = np.arange(round((ONSET + LENGTH) * RATE)) / RATE - ONSET
    chance = np.random.default_rng(number)
    sound = (1.5 if number == LOUDEST else 1.0) * ringing(contact, times)
    noisy = sound + NOISE * chance.standard_normal(len(times))
    return Take(samples=noisy, sample_rate=RATE, name=f"<i>{number}.wav")


class Reader(HTMLParser):
    """What a page holds."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.count: dict[str, int] = {}
        self.links: list[str] = []
        self.rows: list[list[str]] = []
        self.text = ""
        self.inside: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.count[tag] = self.count.get(tag, 0) + 1
        self.links += [value or "" for name, value in attrs if name in {"src", "href"}]
        if tag == "tr":
            self.rows.append([])
        if tag not in {"meta", "img"}:
            self.inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.inside.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data
        if self.inside and self.inside[-1] in {"td", "th"}:
            self.rows[-1].append(data)

    def under(self, headings: tuple[str, ...]) -> list[list[str]]:
        """Return the rows of the table with these first headings."""
        start = next(
            n for n, row in enumerate(self.rows) if tuple(row[: len(headings)]) == headings
        )
        width = len(self.rows[start])
        found = []
        for row in self.rows[start + 1 :]:
            if len(row) != width or row[0] in {"mode", "take"}:
                break
            found.append(row)
        return found

    def sounds(self) -> list[Array]:
        """Return the samples of each player (n, channels), read by soundfile."""
        wavs = [link for link in self.links if link.startswith("data:audio/wav;base64,")]
        files = (io.BytesIO(base64.b64decode(each.partition(",")[2])) for each in wavs)
        return [soundfile.read(file, always_2d=True)[0] for file in files]


@pytest.fixture(scope="module")
def fitting() -> Fitting:
    takes = [take_of(number, contact) for number, contact in enumerate(CONTACTS)]
    return fit_recordings(takes, contacts=CONTACTS, cache=False)


def loudest_of(fitting: Fitting) -> RenderedHit:
    fitted, recorded = fitting.fitted, fitting.recorded
    return played(fitted, recorded, [LOUDEST], setting_in(fitted, recorded, fitting.lead))


@pytest.fixture(scope="module")
def page(fitting: Fitting) -> str:
    return report(fitting)


@pytest.fixture(scope="module")
def reader(page: str) -> Reader:
    return Reader(page)


@pytest.mark.prove
def test_the_page_needs_no_other_file_and_is_whole(page: str, reader: Reader) -> None:
    assert not reader.inside
    assert reader.links
    assert all(link.startswith("data:") for link in reader.links)
    assert not re.search(r"https?:|url\(|@import", page)
    assert len(page) < 8e6


def test_names_of_takes_are_text(reader: Reader) -> None:
    assert "i" not in reader.count
    takes = reader.under(fit_page.TAKES)
    assert [row[0] for row in takes] == [f"<i>{number}.wav" for number in range(len(CONTACTS))]


def test_every_mode_stands_in_the_table_once(reader: Reader, fitting: Fitting) -> None:
    rows = reader.under(fit_page.MODES)
    assert [row[0] for row in rows] == [str(number + 1) for number in range(len(FREQUENCIES))]
    assert [row[1] for row in rows] == [f"{each:.3f}" for each in fitting.model.frequencies]
    told = np.array([[float(row[column]) for column in (1, 4, 6)] for row in rows])
    times, qualities = np.log(1000) / DECAYS, np.pi * FREQUENCIES / DECAYS
    assert told == pytest.approx(np.stack([FREQUENCIES, times, qualities], axis=1), rel=0.01)
    levels = np.array([float(row[7]) for row in rows])
    true = 20 * np.log10(
        np.abs(drives(CONTACTS) * np.where(np.arange(8) == LOUDEST, 1.5, 1)[:, None]).max(axis=0)
    )
    assert levels == pytest.approx(true - true.max(), abs=1.0)
    assert [row[9] for row in rows] == ["yes"] * len(rows)
    assert all(0 < float(row[8]) < 5 for row in rows)  # rank errors, %


def test_takes_are_told_by_their_levels(reader: Reader, fitting: Fitting) -> None:
    for row, take in zip(reader.under(fit_page.TAKES), fitting.recorded.takes, strict=True):
        assert row[1:3] == ["1", "1"]
        assert float(row[3]) == pytest.approx(20 * np.log10(np.abs(take.samples).max()), abs=0.05)
        assert float(row[4]) == pytest.approx(20 * np.log10(NOISE), abs=0.5)
        signal = np.square(take.samples[:, round(ONSET * RATE) :]).mean()
        assert float(row[5]) == pytest.approx(10 * np.log10(signal / NOISE**2), abs=1.0)


def test_players_play_what_was_recorded_and_what_is_true(reader: Reader, fitting: Fitting) -> None:
    """The loudest hit first: original, model, residual, on one scale."""
    original, model, residual = (sound[:, 0] for sound in reader.sounds()[:3])
    loudest = np.abs([original, model, residual]).max()
    assert loudest == pytest.approx(FULL, abs=STEP)
    take = fitting.recorded.takes[LOUDEST].samples[0]
    hit = fitting.fitted.rows[LOUDEST]
    first = round(hit.onset * RATE) - RATE // 10
    middle = slice(RATE // 50, len(original) - RATE // 10)  # without the fades
    recorded = take[first : first + len(original)][middle]
    factor = original[middle] @ recorded / (recorded @ recorded)
    assert np.abs(original[middle] - factor * recorded).max() < STEP
    times = (first + np.arange(len(original))) / RATE
    ringing_freely = times > hit.time
    ringing_freely[middle.stop :] = False
    true = 1.5 * factor * ringing(CONTACTS[LOUDEST], times - ONSET)
    assert np.abs(model - true)[ringing_freely].max() < 2 * factor * NOISE + STEP
    assert np.abs(original - model - residual).max() < 2 * STEP
    assert not model[times < ONSET - 0.001].any()
    assert np.square(residual[middle]).mean() < (2 * factor * NOISE) ** 2  # nothing but noise
    for sound in (original, model, residual):
        assert np.abs(sound[[0, -1]]).max() <= STEP


def test_six_hits_are_played_the_loudest_first(reader: Reader, fitting: Fitting) -> None:
    chosen = chosen_hits(fitting.fitted, Energies.of(fitting.fitted))
    takes = [fitting.fitted.rows[rows[0]].take for rows in chosen]
    assert takes[0] == LOUDEST
    assert sorted(takes[1:]) == takes[1:]
    assert len(set(takes)) == 6
    assert {0, 7} <= set(takes)  # spread over all
    assert len(reader.sounds()) == 6 * 3
    assert "2 more hits not played here" in reader.text
    assert len(hits_of(fitting.fitted)) == 8


def test_errors_that_the_method_does_not_tell_are_dashes(fitting: Fitting) -> None:
    known = fit_page._known(fitting.model)
    unknown = fit_page._known(replace(fitting.model, errors=np.full(4, np.nan)))
    assert known.all()
    assert not unknown.any()
    rows = fit_page.mode_table(fitting.fitted, unknown)
    assert [(row[3], row[5]) for row in rows] == [("-", "-")] * len(FREQUENCIES)


def test_modes_not_measured_are_named() -> None:
    rows = fit_page.place_columns(np.array([0.02, np.nan]), np.array([False, True]))
    assert rows == [["2", "yes"], ["-", "not measured"]]


def test_what_does_not_ring_has_no_report() -> None:
    noise = 0.1 * np.random.default_rng(1).standard_normal(RATE)
    take = Take(samples=noise, sample_rate=RATE, name="hiss")
    with pytest.raises(RecordingError, match="nothing rings"):
        fit_recordings(take, onsets=[[0.5]], force=True, cache=False)


@pytest.mark.parametrize(
    ("ratio", "misfit", "told"),
    [
        (35.0, 36.0, "hardly anything is missing"),
        (12.0, 13.0, "part of the sound is missing"),
        (12.0, np.inf, "noise of the recording"),
    ],
)
def test_a_ratio_is_put_in_words(ratio: float, misfit: float, told: str) -> None:
    verdict = ModalVerdict(modal=True, reason="", signal_to_residual=ratio, signal_to_misfit=misfit)
    lines = fit_page.verdict_lines(verdict, 3)
    assert lines[0].startswith("Modal")
    assert told in lines[1]
    assert f"{100 * 10 ** (-ratio / 10):.2g} %" in lines[1]


def test_the_model_with_residual_comes_nearer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A short burst at the hit is no mode; where the model has it, it is played."""
    monkeypatch.setattr(fit_page, "_drawing", lambda *_: "pictures take seconds")
    take = take_of(LOUDEST, 0.2)
    burst = np.zeros_like(take.samples)
    start = round(ONSET * RATE)
    hiss = np.random.default_rng(5).standard_normal(320)
    burst[0, start : start + 320] = 0.5 * hiss * np.exp(-np.arange(320) / 40)
    fitting = fit_recordings(
        replace(take, samples=take.samples + burst), modes=4, residual=True, cache=False
    )
    reader = Reader(report(fitting))
    original, model, whole, residual = (sound[:, 0] for sound in reader.sounds())
    assert np.square(original - whole).sum() < 0.1 * np.square(residual).sum()
    assert np.abs(original - model - residual).max() < 2 * STEP
    assert "--residual" not in reader.text


def test_long_sounds_are_shortened_to_their_share(fitting: Fitting) -> None:
    hit = loudest_of(fitting)
    assert "its first" not in fit_page.player("hit", hit, 1e7)
    told = fit_page.player("hit", hit, 30_000)
    assert f"its first {10_000 * 3 / 4 / 2 / RATE:.1f} s" in told  # three sounds of 16 bits
    assert len(told) < 32_000
    assert np.abs(Reader(told).sounds()[0][-1]).max() <= STEP


def test_spectrograms_share_their_colours(fitting: Fitting) -> None:
    hit = loudest_of(fitting)
    panels = fit_pictures.spectrograms(hit, 100.0).axes[:3]
    assert [axes.get_title() for axes in panels] == ["original", "model", "residual"]
    images = [axes.collections[0] for axes in panels]
    assert len({image.get_clim() for image in images}) == 1
    levels = [np.asarray(image.get_array()).max() for image in images]
    assert levels[0] == pytest.approx(0)
    assert levels[1] == pytest.approx(0, abs=0.5)
    ring = np.asarray(images[2].get_array())[:, 200:400].max()  # long after the hit
    assert ring < -40


def test_bars_of_ringing_times_reach_as_far_as_the_errors() -> None:
    errors = np.array([0.6, np.nan])
    figure = fit_pictures.ringing_times(FREQUENCIES[:2], DECAYS[:2], errors, RATE / 2)
    (bars,) = figure.axes[0].containers
    ends = bars.lines[2][0].get_segments()[0][:, 1]
    assert ends == pytest.approx(np.log(1000) / np.array([6.6, 5.4]))


def test_maps_show_the_shapes_of_modes() -> None:
    shapes = drives(CONTACTS)
    both = np.stack([shapes, 0.5 * shapes], axis=1).astype(complex)
    survey = Survey.full(CONTACTS[:, None], np.eye(3)[:2], both, FREQUENCIES)
    levels = fit_pictures.levels_at(survey, 0)
    true = 20 * np.log10(np.abs(shapes) / np.abs(shapes).max(axis=0))
    assert levels == pytest.approx(true, abs=1e-9)
    heard = fit_pictures.levels_at(survey, 1)
    assert heard[1] - heard[0] == pytest.approx(np.full(len(FREQUENCIES), -6.0206), abs=1e-3)
    lost = np.array([True, False, False, False])
    figure = fit_pictures.gain_map(
        levels, FREQUENCIES, fit_pictures.named(CONTACTS[:, None]), lost, "contact"
    )
    axes = figure.axes[0]
    assert axes.get_yticklabels()[0].get_text() == "0.05"
    assert [text.get_text() for text in axes.get_xticklabels()] == ["440", "1210", "2390", "3970"]
    (above,) = axes.child_axes
    assert above.get_xticks().tolist() == [0]


def test_the_loudest_channel_of_a_hit_is_chosen(fitting: Fitting) -> None:
    hit = loudest_of(fitting)
    two = RenderedHit(
        take=0,
        onset=hit.onset,
        lead=hit.lead,
        original=np.concatenate([0.5 * hit.original, hit.original]),
        modes=np.concatenate([0.5 * hit.modes, hit.modes]),
        beside=None,
        sample_rate=RATE,
    )
    assert np.array_equal(two.in_one_channel().original, hit.original)
