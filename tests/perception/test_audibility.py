"""Which modes are heard, and what a model without the others loses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import struck
from struck.errors import OptionError, ScaleWarning
from struck.model.contact import Place
from struck.model.damping import Rayleigh
from struck.model.model import ModalModel
from struck.perception import audibility
from struck.perception.audibility import _select_modes, audible, budgeted
from struck.perception.sonic_distance import (
    HeardModel,
    band_excess,
    contacts_over,
    erb_distance,
    sonic_distance,
)
from struck.scene import RigidBody, Scene
from struck.scene.body import with_fewer_modes
from struck.shapes import Bar, RectangularPlate
from tests.perception.bodies import LEFT, RIGHT, chord, clamped_plate, hinged_bar, random_contacts


def audible_modes(
    model: ModalModel,
    contacts: Sequence[Place],
    listener: ArrayLike | None = None,
    level: float | None = None,
) -> NDArray[np.bool_]:
    """Return which modes are heard, for each contact and listener by itself (K, L, M)."""
    heard = HeardModel.at(model, listener, level)
    intensities = audibility._intensities(model, contacts, heard)
    cases = intensities.reshape(-1, 1, intensities.shape[2])
    missed = [audibility._left_out(model.frequencies, case) for case in cases]
    return ~np.stack(missed).reshape(intensities.shape)


@pytest.fixture(scope="module")
def plate() -> ModalModel:
    return clamped_plate(16_000.0)


def test_a_loud_mode_masks_a_soft_neighbour_but_none_far_off() -> None:
    tones, heights = [1000.0, 1060.0, 3000.0], [1.0, 0.05, 0.05]
    heard = audible_modes(chord(tones, heights, heights), [LEFT])
    assert heard.tolist() == [[[True, False, True]]]


def test_a_mode_that_is_masked_at_one_contact_is_heard_where_its_masker_is_silent() -> None:
    model = chord([1000.0, 1060.0], [1.0, 0.05], [0.0, 0.05])
    assert audible_modes(model, [LEFT, RIGHT])[:, 0].tolist() == [[True, False], [False, True]]
    assert len(audible(model, [LEFT]).frequencies) == 1
    assert len(audible(model, [LEFT, RIGHT]).frequencies) == 2


def test_the_threshold_in_quiet_decides_where_nothing_masks() -> None:
    # At 100 Hz it is at 23 dB, at 3300 Hz at -5 dB (Terhardt 1979).
    model = chord([100.0, 3300.0], [1.0, 0.02], [1.0, 0.02])
    for level, wanted in ((40, [True, True]), (20, [False, False]), (27, [True, False])):
        assert audible_modes(model, [LEFT], level=level)[0, 0].tolist() == wanted


def test_a_farther_listener_hears_less() -> None:
    model = chord([100.0, 1000.0], [1.0, 1.0], [1.0, 1.0])
    places = [(1.0, 0.0, 0.0), (1000.0, 0.0, 0.0)]
    near, far = audible_modes(model, [LEFT], listener=places, level=60)[0]
    assert near.tolist() == [True, True]
    assert far.tolist() == [False, False]


def test_equal_modes_do_not_mask_each_other_away() -> None:
    full = chord(1000 + np.arange(12) / 2, np.ones(12), np.ones(12))
    less = audible(full, [LEFT])
    assert 0 < len(less.frequencies) < 12
    point, direction = np.array([LEFT]), np.array([[0.0, 0.0, -1.0]])
    whole, left = (
        np.square(np.abs(each.gains.at(point, direction) * each.gains.toward(2 * point + 1))).sum()
        for each in (full, less)
    )
    assert 10 * np.log10(left / whole) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("level", [60, 40])
def test_a_model_of_what_is_heard_sounds_the_same_at_contacts_of_its_own(
    plate: ModalModel, level: float
) -> None:
    less = audible(plate, level=level)
    lost = len(plate.frequencies) - len(less.frequencies)
    assert lost > 0
    hearing = HeardModel.at(plate, level=level)
    points, directions = random_contacts(plate.geometry, 200, seed=4)
    outputs = less.gains.toward(hearing.listeners)
    kept = np.isin(plate.natural_frequencies, less.natural_frequencies)
    full = hearing.intensities(points, directions)[:, 0]
    solved = HeardModel(
        model=less,
        listeners=hearing.listeners,
        outputs=outputs,
        level=level,
        weights=hearing.weights[kept],
    ).intensities(points, directions)[:, 0]
    wanted = band_excess(plate.frequencies, full)
    apart = erb_distance(wanted, band_excess(less.frequencies, solved))
    bare = erb_distance(wanted, band_excess(less.frequencies, full[:, kept]))
    assert apart.mean() < 0.8 * bare.mean()  # the rest takes over what was left out
    assert apart.max() < 1.0  # less than can be noticed


def test_what_was_left_out_is_counted_and_the_rest_belongs_together(plate: ModalModel) -> None:
    less = audible(plate, level=40)
    kept = len(less.frequencies)
    assert (
        f"{len(plate.frequencies) - kept} of {len(plate.frequencies)} modes are not heard"
        in (less.provenance.dropped[-1])
    )
    assert less.gains.toward(np.array([[2.0, 0, 0]])).shape == (1, 1, kept)
    assert len(less.decays) == len(less.natural_frequencies) == kept
    lost = np.setdiff1d(plate.natural_frequencies, less.natural_frequencies)
    assert less.complete_to == lost.min()
    assert "Glasberg" in less.cite()
    assert len(less.scaled(2.0).frequencies) == kept
    assert sonic_distance(less, plate, at=(0.1, 0.08), level=40) < 1


def test_where_all_is_heard_the_model_stays() -> None:
    model = chord([300.0, 3000.0], [1.0, 1.0], [1.0, 1.0])
    assert audible(model) is model


def test_bad_arguments_are_refused() -> None:
    model = hinged_bar(3)
    with pytest.raises(OptionError, match="at least one place"):
        audible(model, [])
    with pytest.raises(OptionError, match="takes a list of a name or coordinates"):
        audible(model, "top")
    with pytest.raises(OptionError, match="none of 3 modes"):
        audible(model, level=-60)
    with pytest.warns(ScaleWarning, match="no mode that rings"):
        without = model.damped(Rayleigh(mass=1e9, stiffness=0))
    with pytest.raises(OptionError, match="0 modes"):
        audible(without)


@pytest.mark.prove
@pytest.mark.parametrize("modes", [12, pytest.param(40, marks=pytest.mark.prove)])
def test_a_budget_of_modes_keeps_the_sonic_distance_that_it_states(modes: int) -> None:
    plate = RectangularPlate(length=0.3, width=0.2, thickness=0.002, edges="free")
    whole = struck.analyze(plate, "steel", band=(20, 8000), recoil=False)
    few = struck.analyze(plate, "steel", band=(20, 8000), recoil=False, modes=modes)
    assert len(few.frequencies) == modes < len(whole.frequencies)
    told = few.provenance.dropped[-1]
    stated = few.provenance.details["budget_distance"]
    assert f"{len(whole.frequencies) - modes} of {len(whole.frequencies)} modes" in told
    assert f"by more than {stated:.2f} dB of sonic distance" in told
    points, _ = contacts_over(whole.geometry, 1000)
    some = points[np.random.default_rng(7).choice(len(points), 20, replace=False)]
    distances = [struck.sonic_distance(whole, few, at=point) for point in some]
    assert 0.3 * stated < max(distances) <= stated
    # The first modes, as many, are further off at most of the contacts.
    first = _select_modes(whole, np.arange(modes), np.ones(modes), "lie higher")
    others = [struck.sonic_distance(whole, first, at=point) for point in some]
    assert np.median(distances) < np.median(others)


def test_a_budget_of_what_sounds_is_told_in_its_notes() -> None:
    model = struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel", recoil=False)
    most, tap = len(model.frequencies), struck.Strike(at="end", impulse=1e-3)
    few = budgeted(model, 3)
    told = few.provenance.dropped[-1]
    assert f"{most - 3} of {most} modes" in told
    assert "dB of sonic distance" in told
    sound = struck.render(model, tap, seconds=0.1, modes=3)
    assert sound.notes[0] == told
    assert np.array_equal(sound.samples, struck.render(few, tap, seconds=0.1).samples)
    assert not struck.render(model, tap, seconds=0.1, modes=most).notes
    # Bodies that share a model, one of them silent.
    silent = struck.Body(model=RigidBody())
    bodies = [struck.Body(model=model, excitations=tap), struck.Body(model=model), silent]
    made, notes = with_fewer_modes(bodies, 3)
    assert [each.silent for each in made] == [False, False, True]
    assert made[0].model is made[1].model
    assert notes == (f"body 0 and body 1: {told}",)
    scene, notes = with_fewer_modes(Scene(bodies={"bar": bodies[0], "wall": silent}), 3)
    assert len(scene.bodies["bar"].model.frequencies) == 3
    assert notes == (f"bar: {told}",)
    assert struck.render(scene, seconds=0.1).samples.any()
    with pytest.raises(OptionError, match="modes is 0: give a whole number of at least 1"):
        struck.render(model, tap, modes=0)


def test_a_budget_below_one_mode_is_refused_before_the_work() -> None:
    with pytest.raises(OptionError, match="modes is 0: give a whole number of at least 1"):
        struck.analyze("no_file.stl", "steel", modes=0)
