"""Recordings in, a model out: places, strengths and moments of hits, what is left, bad input."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import struck
from struck import Strike
from struck.errors import FileFormatError, OptionError, RecordingError
from struck.model.gains import Gains
from struck.model.model import ModalModel
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import SinglePoint, TimbreTable
from struck.recordings.fit import Fitting, files_read, fit_recordings
from struck.recordings.takes import Take
from tests.recordings.scenes import over_noise
from tests.recordings.sounds import chord, cymbal, sine
from tests.recordings.strings import (
    DECAYS,
    FREQUENCIES,
    ONSET,
    RATE,
    gains,
    hit,
    noise,
    ringing,
    sound,
    take,
)

CONTACTS = np.linspace(0, 1, 9)


def fitting(recordings: Take | list[Take], **options: object) -> Fitting:
    return fit_recordings(recordings, cache=False, **options)


def heard(found: Gains, contacts: np.ndarray, lead: float = 0.0) -> np.ndarray:
    """Return gains (K, M) at 1 m as of the hit itself."""
    drives = found.at(contacts.reshape(len(contacts), -1), np.zeros((len(contacts), 3)))
    outputs = found.toward(np.array([[1.0, 0.0, 0.0]]))
    poles = -DECAYS + 2j * np.pi * FREQUENCIES
    return (drives * outputs).sum(axis=1) * np.exp(-poles * lead)


def decibels(found: np.ndarray, true: np.ndarray) -> float:
    """Return the energy of the difference over that of the truth, a common factor left out."""
    scale = np.vdot(found, true) / np.vdot(found, found)
    return float(10 * np.log10((np.abs(scale * found - true) ** 2).sum() / (true**2).sum()))


@pytest.fixture(scope="module")
def bar() -> Fitting:
    takes = [hit(contact, seed=seed) for seed, contact in enumerate(CONTACTS)]
    return fitting(takes, contacts=CONTACTS)


def test_one_take_is_a_model_of_a_single_point() -> None:
    made = fitting(hit(0.05))
    model = made.model
    assert isinstance(model.gains, SinglePoint)
    assert model.frequencies == pytest.approx(FREQUENCIES, rel=1e-5)
    assert model.decays == pytest.approx(DECAYS, rel=0.01)
    assert model.natural_frequencies == pytest.approx(
        np.hypot(FREQUENCIES, DECAYS / 2 / np.pi), rel=1e-5
    )
    found = heard(model.gains, np.zeros((1, 0)), made.lead)
    assert decibels(found, gains(np.array(0.05))) < -40
    assert not model.calibrated
    assert "corbett2007" in model.provenance.references


def test_a_rendered_strike_is_the_recording() -> None:
    recorded = hit(0.05, level=70)
    made = fitting(recorded)
    played = struck.render(
        made.model, Strike(impulse=1.0, duration=0.0), seconds=0.5, sample_rate=RATE, fade=0
    )
    start = round((ONSET + made.lead) * RATE)
    original = recorded.samples[0, start : start + played.samples.shape[1]]
    left = original - played.samples[0]
    assert 10 * np.log10((original**2).sum() / (left**2).sum()) > 35


def test_stated_errors_cover_the_truth(bar: Fitting) -> None:
    errors = bar.model.errors * bar.model.frequencies
    assert np.all(np.abs(bar.model.frequencies - FREQUENCIES) < 4 * errors)
    assert np.all(np.abs(bar.model.decays - DECAYS) < 4 * bar.fitted.decay_errors)
    assert errors.max() < 0.01


def test_contacts_between_those_that_were_struck(bar: Fitting) -> None:
    model = bar.model
    assert isinstance(model.gains, TimbreField)
    assert model.coordinates == ("u",)
    between = np.array([0.06, 0.19, 0.31, 0.44, 0.69, 0.94])
    # Nine contacts are two for each half wave of the fourth mode; the sixth has fewer.
    found = heard(model.gains, between, bar.lead)
    assert decibels(found[:, :4], gains(between)[:, :4]) < -28
    assert decibels(heard(model.gains, CONTACTS, bar.lead), gains(CONTACTS)) < -35


@pytest.mark.prove
def test_without_listeners_a_round_body_is_heard_alike_all_around() -> None:
    around = np.array([[0.5, 0, 0], [0, 0.5, 0], [-0.3, 0.4, 0], [0, 0.3, 0.4]])
    made = fitting([hit(0.05), hit(0.3, seed=1)], contacts=[0.05, 0.3], symmetry="axial")
    outputs = made.model.gains.toward(around)[:, 0]
    np.testing.assert_allclose(outputs, outputs[[0] * 4], rtol=1e-9)
    assert any("heard alike all around" in note for note in made.model.provenance.dropped)
    plain = fitting([hit(0.05), hit(0.3, seed=1)], contacts=[0.05, 0.3]).model
    np.testing.assert_allclose(outputs, plain.gains.toward(around)[:, 0], rtol=1e-6)


def test_the_default_contact_is_one_that_was_struck(bar: Fitting) -> None:
    contact = bar.model.contact(None).point
    assert contact[0] in CONTACTS
    assert np.isfinite(struck.render(bar.model, Strike(), seconds=0.2).samples).all()


@pytest.mark.prove
def test_moments_of_hits_are_told_by_the_fit_in_noise() -> None:
    """At 20 dB the steepest rise is off by samples; drives that are real put it right."""
    takes = [
        hit(contact, level=20, seed=seed, onset=ONSET + 0.0137 * seed)
        for seed, contact in enumerate(CONTACTS)
    ]
    made = fitting(takes, contacts=CONTACTS)
    assert decibels(heard(made.model.gains, CONTACTS, made.lead), gains(CONTACTS)) < -24


@pytest.mark.prove
def test_hits_of_one_contact_are_brought_to_one_strength() -> None:
    """Four hits of each contact, up to 10 dB apart, in one file: the noise of the mean counts."""
    chance = np.random.default_rng(5)
    takes, strengths = [], 10 ** (-chance.uniform(0, 10, (3, 4)) / 20)
    strengths[:, 0] = 1.0
    for place, contact in enumerate((0.0, 0.3, 0.8)):
        several = sum(
            ringing(strength * gains(np.array(contact))[0], onset=ONSET + number, seconds=4.5)
            for number, strength in enumerate(strengths[place])
        )
        takes.append(take(several + noise(len(several), 40, place)))
    made = fitting(takes, contacts=[0.0, 0.3, 0.8])
    assert len(made.fitted.rows) == 12
    found = heard(made.model.gains, np.array([0.0, 0.3, 0.8]), made.lead)
    assert decibels(found, gains(np.array([0.0, 0.3, 0.8]))) < -35
    assert np.abs(found[0]).max() == pytest.approx(
        0.2 * np.abs(gains(np.array(0.0))).max(), rel=0.05
    )


@pytest.mark.prove
def test_levels_of_takes_without_places_are_noted_where_they_differ() -> None:
    """Half and a fifth of the first's level, by distance or by the blow; 1 dB is not noted."""
    first = hit(0.05)
    far = [Take(samples=first.samples * scale, sample_rate=RATE) for scale in (0.5, 0.2)]
    notes = fitting([first, *far]).model.provenance.dropped
    assert any("differ by 14 dB" in note and "a list of takes" in note for note in notes)
    near = Take(samples=first.samples * 0.9, sample_rate=RATE)
    assert not any("levels" in each for each in fitting([first, near]).model.provenance.dropped)


@pytest.mark.prove
def test_a_clipped_hit_among_good_ones_does_no_harm() -> None:
    """Its fit begins late, when fast modes have gone: there the others count."""
    loud = 30 * ringing(gains(np.array(0.05))[0], onset=ONSET + 1.5, seconds=3.0)
    whole = ringing(gains(np.array(0.05))[0], seconds=3.0) + loud + noise(3 * RATE, 50, 1)
    clipped = Take(samples=np.clip(0.2 * whole, -0.9, 0.9), sample_rate=RATE)
    made = fitting([hit(0.05), clipped])
    found = np.abs(heard(made.model.gains, np.zeros((1, 0)), made.lead))[0]
    assert found / found[0] == pytest.approx(
        np.abs(gains(np.array(0.05)))[0] / np.abs(gains(np.array(0.05)))[0, 0], rel=0.25
    )


@pytest.mark.prove
def test_a_second_hit_keeps_its_own_moment_among_triggered_takes() -> None:
    places = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [-1.0, 0, 0], [0, -1.0, 0]])
    several = ringing(gains(np.array(0.4))[0], seconds=3.0) + ringing(
        gains(np.array(0.4))[0], onset=ONSET + 1.5, seconds=3.0
    )
    takes = [hit(0.1 * number, seed=number) for number in range(4)]
    takes.append(take(several + noise(len(several), 50, 9)))
    made = fitting(takes, listeners=places)
    heard_at = np.abs(made.survey.gains) / 0.2
    assert heard_at.max() < 1.1 * np.abs(gains(0.1 * np.arange(5))).max()


@pytest.mark.prove
def test_a_force_sensor_may_sit_in_any_channel() -> None:
    """It needs no place, and is no microphone."""
    pulse = np.zeros(RATE)
    first = round(ONSET * RATE)
    pulse[first : first + 30] = np.hanning(30)
    one, other = hit(0.1, seed=1), hit(0.6, seed=2)
    left = Take(samples=np.stack([one.samples[0], pulse]), sample_rate=RATE)
    right = Take(samples=np.stack([pulse, other.samples[0]]), sample_rate=RATE)
    alone = fitting([one, other], contacts=[0.1, 0.6])
    both = fitting([left, right], contacts=[0.1, 0.6])
    mixed = fitting([one, right], contacts=[0.1, 0.6])
    for made in (both, mixed):
        assert made.survey.gains == pytest.approx(alone.survey.gains, rel=1e-6, abs=1e-9)
    placed = fitting([left, right], contacts=[0.1, 0.6], listeners=(0, 1, 0))
    assert placed.survey.listeners.tolist() == [[0, 1, 0]]


def test_channels_without_places_count_as_one_microphone() -> None:
    left, right = gains(np.array(0.1))[0], gains(np.array(0.6))[0]
    both = np.stack([ringing(left), ringing(right)]) + noise(2 * RATE, 50, 1).reshape(2, -1)
    made = fitting(take(both))
    found = np.abs(heard(made.model.gains, np.zeros((1, 0)), made.lead))[0]
    assert found == pytest.approx(0.2 * np.sqrt((left**2 + right**2) / 2), rel=0.03)


def test_listeners_alone_make_a_field_around_one_contact() -> None:
    places = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [-1.0, 0, 0], [0.5, 0.5, 0.5]])
    takes = [hit(0.1 * number, seed=number) for number in range(5)]
    made = fitting(takes, listeners=places)
    outputs = made.model.gains.toward(places)[:, 0] * made.model.gains.at([[0.0]], places[:1])[0]
    found = np.abs(outputs) * np.linalg.norm(places, axis=1)[:, None]
    true = 0.2 * np.abs(gains(0.1 * np.arange(5))) * np.linalg.norm(places, axis=1)[:, None]
    assert np.median(np.abs(found - true)) < 0.03 * true.max()


@pytest.mark.prove
def test_the_full_table_has_the_recordings_themselves() -> None:
    takes = [hit(contact, seed=seed) for seed, contact in enumerate(CONTACTS)]
    made = fitting(takes, contacts=CONTACTS, interpolation="table")
    assert isinstance(made.model.gains, TimbreTable)
    table = made.model.gains
    found = (table.at(CONTACTS[:, None], np.zeros((9, 3))) * table.toward([[1.0, 0, 0]])).sum(
        axis=1
    )
    assert found == pytest.approx(made.survey.gains, rel=1e-12)


def test_the_method_of_2007_is_there() -> None:
    made = fitting(hit(0.05), method="corbett2007")
    assert made.model.frequencies == pytest.approx(FREQUENCIES, rel=1e-4)
    assert np.isnan(made.model.errors).all()
    assert "steiglitz1965" in made.model.provenance.references


@pytest.fixture(scope="module")
def hissing() -> tuple[Take, Fitting, Fitting]:
    """Return a take with a click and hiss beside its modes, its fit with them, and without."""
    clean = ringing(gains(np.array(0.05))[0])
    times = np.maximum(np.arange(len(clean)) / RATE - ONSET, 0)
    hiss = np.where(times > 0, np.exp(-40 * times), 0) * noise(len(clean), 6, 2)
    recorded = take(clean + hiss + noise(len(clean), 60, 3))
    return recorded, fitting(recorded, residual=True), fitting(recorded, residual=False)


@pytest.mark.prove
def test_what_modes_leave_is_played_with_a_strike(hissing: tuple[Take, Fitting, Fitting]) -> None:
    """With what is beside the modes the strike is the recording again."""
    recorded, made, bare = hissing
    assert made.model.residual is not None
    strike = Strike(impulse=1.0, duration=0.0)
    played = struck.render(made.model, strike, seconds=0.5, sample_rate=RATE).samples[0]
    start = round(made.fitted.rows[0].onset * RATE)
    first = slice(0, round(0.03 * RATE))
    original = recorded.samples[0, start:]
    assert np.abs(played[first] - original[first]).max() < 1e-3
    later = slice(round(0.06 * RATE), round(0.09 * RATE))
    alone = struck.render(bare.model, strike, seconds=0.5, sample_rate=RATE).samples[0]
    level = np.std(np.diff(played[later])) / np.std(np.diff(original[later]))
    assert level == pytest.approx(1, abs=0.25)
    assert np.std(np.diff(alone[later])) < np.std(np.diff(original[later]))


@pytest.mark.prove
def test_a_softer_blow_takes_the_treble_off_the_residual_too(
    hissing: tuple[Take, Fitting, Fitting],
) -> None:
    _, made, without = hissing
    hard, soft = (
        struck.render(made.model, Strike(impulse=1.0, duration=duration), seconds=0.3).samples[0]
        for duration in (0.0, 3e-3)
    )
    bare = struck.render(made.model, Strike(), seconds=0.3).samples[0]
    assert np.array_equal(bare, hard)
    assert np.abs(np.diff(soft)).max() < 0.3 * np.abs(np.diff(hard)).max()
    modes = struck.render(without.model, Strike(impulse=1.0, duration=3e-3), seconds=0.3).samples[0]
    assert np.abs(soft).max() < 2 * np.abs(modes).max()


def test_a_model_with_its_residual_goes_through_a_file(tmp_path: Path) -> None:
    made = fitting(hit(0.05), residual=True)
    struck.save(made.model, tmp_path / "bar.struck")
    again = struck.load(tmp_path / "bar.struck")
    assert isinstance(again, ModalModel)
    for name in ("attack", "edges", "levels", "decays", "lead", "sample_rate"):
        before, after = getattr(made.model.residual, name), getattr(again.residual, name)
        assert np.array_equal(before, after), name
    assert np.array_equal(
        heard(again.gains, np.zeros((1, 0))), heard(made.model.gains, np.zeros((1, 0)))
    )


def test_a_larger_recorded_body_rings_lower_and_keeps_its_contacts(bar: Fitting) -> None:
    larger = bar.model.scaled(2)
    assert larger.natural_frequencies == pytest.approx(bar.model.natural_frequencies / 2)
    assert larger.decays == pytest.approx(bar.model.decays)
    assert np.all(larger.frequencies < larger.natural_frequencies)
    tuned = bar.model.tuned(lowest=200.0)
    assert tuned.frequencies[0] == pytest.approx(200.0, rel=1e-6)
    assert larger.contact(None).point == pytest.approx(bar.model.contact(None).point)


def test_sounds_and_takes_are_the_same() -> None:
    one, other = fitting(hit(0.05)), fitting(sound(hit(0.05)))
    assert one.model.frequencies == pytest.approx(other.model.frequencies, rel=1e-7)


def test_a_stopped_fit_ends_in_the_same_model(tmp_path: Path) -> None:
    takes = [hit(contact, seed=seed) for seed, contact in enumerate(CONTACTS[:3])]
    whole = fit_recordings(takes, contacts=CONTACTS[:3], cache=tmp_path / "one").model

    def stop(stage: str, _share: float) -> None:
        if stage == "refining the modes":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_recordings(takes, contacts=CONTACTS[:3], cache=tmp_path / "two", progress=stop)
    told: list[str] = []
    again = fit_recordings(
        takes,
        contacts=CONTACTS[:3],
        cache=tmp_path / "two",
        progress=lambda stage, _share: told.append(stage),
    ).model
    assert "poles taken from the cache" in told
    assert np.array_equal(again.frequencies, whole.frequencies)
    assert np.array_equal(again.decays, whole.decays)
    assert np.array_equal(
        again.gains.at(CONTACTS[:3, None], np.zeros((3, 3))),
        whole.gains.at(CONTACTS[:3, None], np.zeros((3, 3))),
    )


UNFIT: dict[str, tuple[Callable[[], np.ndarray], str]] = {
    "sine": (sine, "steady tone|no hit"),
    "chord": (lambda: chord(0.7), "not modal"),
    "organ": (lambda: chord(8.0), "it breaks off and nothing was struck"),
    "cymbal": (lambda: cymbal(np.random.default_rng(2), 0.3), "not modal"),
    "silence": (lambda: np.zeros(RATE), "silent"),
    "noise": (lambda: noise(RATE, 20, 1), "no hit"),
    "short": (lambda: np.ones(100), "0.1 s"),
    "not finite": (lambda: np.array([np.nan] * RATE), "not finite"),
}


SLOW = {"cymbal": pytest.mark.prove}


@pytest.mark.parametrize("name", [pytest.param(n, marks=SLOW.get(n, ())) for n in UNFIT])
def test_what_is_no_hit_is_refused(name: str) -> None:
    sounding, reason = UNFIT[name]
    with pytest.raises(RecordingError, match=reason):
        fitting(Take(samples=sounding(), sample_rate=44100), modes=32)


def test_where_all_modes_explain_too_little_a_number_of_them_is_offered() -> None:
    take = Take(samples=chord(0.7), sample_rate=44100)
    with pytest.raises(RecordingError, match="With modes=64 the blow is fitted too"):
        fitting(take, modes=None)
    with pytest.raises(RecordingError) as told:
        fitting(take, modes=32)
    assert "modes=64" not in str(told.value)


@pytest.mark.parametrize("name", ["chord", pytest.param("cymbal", marks=pytest.mark.prove)])
def test_what_is_not_modal_is_fitted_when_somebody_insists(name: str) -> None:
    samples = chord(0.7) if name == "chord" else cymbal(np.random.default_rng(2), 0.5)
    made = fitting(Take(samples=samples, sample_rate=44100), modes=16, force=True)
    assert not made.fitted.verdict.modal
    assert 0 < len(made.model.frequencies) <= 16


def test_modes_that_are_all_too_weak_to_measure_are_refused() -> None:
    samples = over_noise(np.linspace(700, 3000, 8), np.full(8, 18.5), np.random.default_rng(0))
    with pytest.raises(RecordingError, match="no mode is clear of the noise"):
        fitting(Take(samples=samples, sample_rate=44100), modes=None, onsets=[[0.5]])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"interpolation": "cloud"}, "interpolation is 'cloud'"),
        ({"interpolation": "table"}, "interpolation is about the places where it was struck"),
        ({"centre": (0, 0, 1)}, "centre is about the places"),
        ({"symmetry": "axial"}, "symmetry is about the places"),
        ({"method": "magic"}, "method is 'magic'"),
        ({"radius": -1.0}, "radius is -1"),
        ({"modes": 0}, "modes is 0"),
        ({"modes": "all"}, "modes is 'all'"),
        ({"modes": 3.5}, "modes is 3.5"),
        ({"centre": (0, 0)}, "centre is"),
        ({"centre": (0, 0, np.nan)}, "centre is"),
        ({"centre": "abc"}, "centre is 'abc'"),
        ({"contacts": [[0.1], [0.2, 0.3]]}, "contacts is"),
        ({"onsets": [0.1]}, "onsets are"),
        ({"onsets": [[0.1, 0.1]]}, "one moment twice"),
        ({"symmetry": "round"}, "symmetry is 'round'"),
        ({"contacts": [[0.1], [0.2]]}, "there are 1 recordings"),
        ({"contacts": [np.nan]}, "not finite"),
        ({"listeners": [[0.1, 0.2]]}, "x, y, z"),
        ({"listeners": [[1, 0, 0], [0, 1, 0]]}, "for 2 recordings of 1"),
        ({"listeners": "here"}, "listeners is 'here'"),
    ],
)
def test_arguments_outside_their_bounds_are_refused(
    options: dict[str, object], message: str
) -> None:
    with pytest.raises(OptionError, match=message):
        fitting(hit(0.05), **options)


def test_takes_that_do_not_go_together_are_refused() -> None:
    other = Take(samples=hit(0.1).samples, sample_rate=44100, name="another")
    with pytest.raises(RecordingError, match="another was recorded at 44100 Hz"):
        fitting([hit(0.05), other])
    heard = ringing(gains(np.array(0.1))[0])
    stereo = take(np.stack([heard + noise(RATE, 50, seed) for seed in (4, 5)]))
    with pytest.raises(RecordingError, match="1 and 2 channels"):
        fitting([hit(0.05), stereo], contacts=[0.1, 0.2])
    with pytest.raises(OptionError, match="no recordings"):
        fitting([])


def written(folder: Path) -> Path:
    """Write three recordings with a manifest."""
    lines = ["file,u,x,y,z"]
    for number, contact in enumerate((0.0, 0.3, 0.8)):
        sound(hit(contact, seed=number)).save(folder / f"{number}.wav")
        lines.append(f"{number}.wav,{contact},1,0,0")
    (folder / "takes.csv").write_text("\n".join(lines))
    return folder / "takes.csv"


def test_a_manifest_tells_the_places(tmp_path: Path) -> None:
    manifest = written(tmp_path)
    made = fit_recordings(tmp_path, cache=False)  # the one table in it
    assert manifest in files_read(tmp_path, None)
    assert made.survey.contacts[:, 0] == pytest.approx([0.0, 0.3, 0.8])
    files = sorted(tmp_path.glob("*.wav"))
    again = fit_recordings(files, manifest=manifest, cache=False)
    assert np.array_equal(again.model.frequencies, made.model.frequencies)
    (tmp_path / "stray.wav").write_bytes(files[0].read_bytes())
    with pytest.raises(RecordingError, match=r"no entry in .*stray\.wav"):
        fit_recordings([*files, tmp_path / "stray.wav"], manifest=manifest, cache=False)
    with pytest.raises(OptionError, match="has them too"):
        fit_recordings(manifest, contacts=[0.1], cache=False)


def test_a_folder_without_a_manifest_and_missing_files_are_named(tmp_path: Path) -> None:
    said = r"has no manifest\.toml, nor one table alone .*: give its recordings one by one, or"
    for tables in ((), ("takes.csv", "more.csv")):
        for name in tables:
            (tmp_path / name).write_text("file\n")
        with pytest.raises(RecordingError, match=said):
            fit_recordings(tmp_path, cache=False)
    with pytest.raises(FileFormatError, match="is missing, there is no file"):
        fit_recordings(tmp_path / "none.wav", cache=False)


@pytest.mark.prove
def test_ten_minutes_with_twenty_hits() -> None:
    """A file as long as people leave a recorder running, with hits of one body in it."""
    samples = noise(600 * RATE, 80, 1)
    for number in range(20):
        contact = np.array(0.05 * number)
        sound = ringing(gains(contact)[0], onset=0, seconds=2.0)
        start = round((3.7 + 29.3 * number) * RATE)
        samples[start : start + len(sound)] += sound
    made = fitting(take(samples))
    assert len({row.hit for row in made.fitted.rows}) == 20
    nearest = np.abs(made.model.frequencies[:, None] - FREQUENCIES).argmin(axis=0)
    assert made.model.frequencies[nearest] == pytest.approx(FREQUENCIES, rel=1e-5)
