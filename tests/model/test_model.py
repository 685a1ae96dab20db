"""The model: contacts, and copies that are damped, scaled, tuned or of another material."""

import copy
import pickle
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import scipy.sparse.linalg
import scipy.spatial
import skfem
from scipy import sparse
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity

import struck
from struck import InternalFriction, Material, ModalModel, Rayleigh, Strike
from struck.analysis.analysis import model_of_modes
from struck.errors import ContactError, MaterialError, OptionError, ScaleWarning
from struck.model.contact import Contact
from struck.model.mesh import Mesh
from struck.scene import Body
from struck.solids import Block, VolumeMesh
from struck.solids.surface.distance import FilledBody, WalledSheet

BLOCK = Block(size=(0.11, 0.07, 0.043), elements=(5, 4, 3))
BAND = (20.0, 40_000.0)


@pytest.fixture(scope="module")
def block() -> ModalModel:
    return struck.analyze(BLOCK, "steel", band=BAND)


def _tetrahedra() -> skfem.MeshTet:
    ends = [
        np.linspace(-edge / 2, edge / 2, n + 1) for edge, n in ((0.11, 4), (0.07, 3), (0.043, 2))
    ]
    return skfem.MeshTet.init_tensor(*ends)


def _external_modes(
    mesh: skfem.MeshTet, material: Material, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Natural frequencies and shapes at `points`, which are nodes, by scikit-fem and ARPACK."""
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP2()), intorder=4)
    stiffness = linear_elasticity(material.first_lame, material.shear_modulus).assemble(basis)
    weigh = skfem.BilinearForm(lambda u, v, _: material.density * dot(u, v))
    mass = weigh.assemble(basis)
    values, vectors = scipy.sparse.linalg.eigsh(
        sparse.csc_matrix(stiffness), 40, sparse.csc_matrix(mass), sigma=-1e8
    )
    kept = (values > 1e6) & (values < (2 * np.pi * BAND[1]) ** 2)
    dofs = np.hstack([basis.nodal_dofs, basis.edge_dofs])
    distance, node = scipy.spatial.cKDTree(basis.doflocs[:, dofs[0]].T).query(points)
    assert distance.max() < 1e-12
    shapes = vectors[:, kept][dofs[:, node]].transpose(1, 0, 2)
    return np.sqrt(values[kept]) / (2 * np.pi), shapes


def test_modes_of_another_program_sound_the_same() -> None:
    """scikit-fem's modes of the same mesh, read in by from_modes, against our own."""
    mesh, steel = _tetrahedra(), Material.named("steel")
    elements = mesh.t.T.astype(np.int64)
    corners = mesh.p.T[elements]
    wrong = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    elements[wrong] = elements[wrong][:, [0, 2, 1, 3]]
    volume = VolumeMesh(nodes=mesh.p.T.copy(), elements=elements, kind="tet4")
    ours = struck.analyze(volume, steel, band=BAND, recoil=False)
    surface = ours.geometry
    frequencies, shapes = _external_modes(mesh, steel, surface.points)
    theirs = model_of_modes(
        surface.points,
        surface.faces,
        frequencies,
        shapes,
        material=steel,
        mass=ours.mass,
        centre=ours.centre,
        inertia=ours.inertia,
    )
    assert theirs.frequencies == pytest.approx(ours.frequencies, rel=1e-9)
    push = Strike(at=surface.points[17], direction=(0.3, -0.5, 0.8), impulse=0.01)
    heard = [struck.render(model, push, seconds=0.05).samples[0] for model in (ours, theirs)]
    assert np.abs(heard[0] - heard[1]).max() < 1e-4 * np.abs(heard[0]).max()


def test_our_own_modes_given_from_outside_render_the_same_samples(block: ModalModel) -> None:
    copy = model_of_modes(
        block.geometry.points,
        block.geometry.faces,
        block.natural_frequencies,
        block.gains.shapes,
        material=block.material,
        mass=block.mass,
        centre=block.centre,
        inertia=block.inertia,
    )
    sounds = [
        struck.render(m, Strike(at=(0.055, 0.01, 0.01), striker="wood"), seconds=0.1).samples
        for m in (replace(block, recoil=None), copy)
    ]
    assert np.abs(sounds[0] - sounds[1]).max() <= 1e-6 * np.abs(sounds[0]).max()


def test_modes_that_do_not_fit_are_refused(block: ModalModel) -> None:
    facts = {
        "material": block.material,
        "mass": block.mass,
        "centre": block.centre,
        "inertia": block.inertia,
    }
    points, faces = block.geometry.points, block.geometry.faces
    frequencies, shapes = block.natural_frequencies, block.gains.shapes
    for wrong_frequencies, wrong_shapes in (
        (frequencies[:-1], shapes),
        (frequencies[::-1], shapes),
        (np.r_[0.0, frequencies[1:]], shapes),
        (frequencies, np.where(shapes == shapes.max(), np.nan, shapes)),
    ):
        with pytest.raises(OptionError):
            model_of_modes(points, faces, wrong_frequencies, wrong_shapes, **facts)


def test_other_damping_is_arithmetic(block: ModalModel) -> None:
    law = Rayleigh(mass=5.0, stiffness=3e-8)
    lossy = block.damped(law)
    natural = block.natural_frequencies
    by_law = (5 + 3e-8 * (2 * np.pi * natural) ** 2) / 2
    assert lossy.decays == pytest.approx(by_law + block.air_decays)
    assert replace(block, air=False).damped(law).decays == pytest.approx(by_law)
    assert lossy.frequencies == pytest.approx(
        np.sqrt(natural**2 - (lossy.decays / (2 * np.pi)) ** 2)
    )
    assert lossy.t60 == pytest.approx(np.log(1000) / lossy.decays)


def test_laws_that_leave_no_mode_are_doubted(block: ModalModel) -> None:
    swapped = Rayleigh(mass=1e-7, stiffness=30.0)
    with pytest.warns(ScaleWarning, match=r"mass=1e-07, stiffness=30.*no mode .*mass in 1/s"):
        silent = block.damped(swapped)
    assert not len(silent.frequencies)


def test_overdamped_modes_are_dropped_and_counted(block: ModalModel) -> None:
    edge = float(block.natural_frequencies[9:11].mean())
    heavy = block.damped(Rayleigh(mass=0.0, stiffness=1 / (np.pi * edge)))
    expected = 10
    assert len(heavy.frequencies) == expected
    assert f"{len(block.frequencies) - expected} overdamped modes" in heavy.provenance.dropped[0]
    assert heavy.gains.shapes.shape[2] == expected


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_size_is_arithmetic(block: ModalModel, factor: float) -> None:
    edges = tuple(factor * edge for edge in BLOCK.size)
    fresh = struck.analyze(
        Block(size=edges, elements=BLOCK.elements), "steel", band=(0.0, BAND[1] / factor)
    )
    scaled = block.scaled(factor)
    assert scaled.frequencies == pytest.approx(fresh.frequencies, rel=1e-9)
    assert scaled.complete_to == pytest.approx(fresh.complete_to)
    assert scaled.mass == pytest.approx(fresh.mass)
    assert scaled.inertia == pytest.approx(fresh.inertia, abs=1e-12)
    strike = Strike(at=tuple(factor * x for x in (0.05, 0.02, 0.0215)), impulse=0.01)
    sounds = [struck.render(m, strike, seconds=0.01).samples for m in (scaled, fresh)]
    assert np.abs(sounds[0] - sounds[1]).max() < 1e-4 * np.abs(sounds[1]).max()


def test_tuned_rings_at_the_wanted_frequency(block: ModalModel) -> None:
    tuned = block.damped(InternalFriction(loss_tangent=0.05)).tuned(lowest=440.0)
    assert tuned.frequencies[0] == pytest.approx(440.0, rel=1e-9)


def test_a_material_without_slopes_cannot_change_its_poisson_ratio(block: ModalModel) -> None:
    copy = model_of_modes(
        block.geometry.points,
        block.geometry.faces,
        block.natural_frequencies,
        block.gains.shapes,
        material=block.material,
        mass=block.mass,
        centre=block.centre,
        inertia=block.inertia,
    )
    with pytest.raises(MaterialError, match="compute them again"):
        copy.made_of("glass")


def test_contacts_snap_and_tell_how_far(block: ModalModel) -> None:
    above = block.contact((0.0, 0.0, 0.0215 + 0.001))
    assert above.point == pytest.approx((0, 0, 0.0215))
    assert above.distance == pytest.approx(0.001)
    assert above.direction == pytest.approx((0, 0, -1))
    with pytest.raises(ContactError, match=r"nearest point is \(0, 0, 0.0215\)"):
        block.contact((0.0, 0.0, 0.05))
    assert block.contact("vertex:5").point == pytest.approx(block.geometry.points[5])
    with pytest.raises(ContactError, match="the place is 'knob'"):
        block.contact("knob")


def test_the_loudest_contact_is_louder_than_others(block: ModalModel) -> None:
    def loudness(contact: Contact) -> float:
        drive = block.gains.at(contact.point[None], contact.direction[None])
        return float(np.square(np.abs(drive * block.gains.outputs)).sum())

    chosen = loudness(block.contact())
    others = [loudness(block.contact(f"vertex:{i}")) for i in range(0, 150, 7)]
    assert chosen > 0.5 * max(others)


def test_a_table_shows_every_mode(block: ModalModel) -> None:
    assert block._repr_html_().count("<tr>") == len(block.frequencies) + 1


def _by_pickle(thing: object) -> object:
    return pickle.loads(pickle.dumps(thing))  # noqa: S301 - our own bytes


@pytest.mark.parametrize("copied", [_by_pickle, copy.deepcopy])
def test_copies_are_made_also_after_contacts_were_looked_up(
    block: ModalModel, copied: Callable[[Any], Any]
) -> None:
    """Of all that holds a search tree of libigl once it has been asked for a nearest point."""
    strike = Strike(at="top", impulse=0.01)
    sound = struck.render(block, strike, seconds=0.01)
    again = struck.render(copied(block), strike, seconds=0.01)
    assert np.array_equal(again.samples, sound.samples)
    body = Body(model=block, excitations=strike)
    heard, again = (struck.render(each, seconds=0.01) for each in (body, copied(body)))
    assert np.array_equal(again.samples, heard.samples)
    coarse = struck.analyze(replace(BLOCK, elements=(2, 1, 1)), "steel", band=(20.0, 20e3))
    sounds, top = struck.sound_map(coarse, 12.0, level=30), coarse.places["top"]
    assert np.array_equal(sounds.at(top), copied(sounds).at(top))
    filled = FilledBody(mesh=block.geometry)
    sheet = WalledSheet(mesh=Mesh(points=np.eye(3), faces=np.array([[0, 1, 2]])), wall=0.1)
    for solid in (filled, sheet):
        places = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03], [0.4, 0.3, 0.3]])
        depths = solid.depths(places)
        assert depths.min() < 0 < depths.max()
        assert np.array_equal(copied(solid).depths(places), depths)
