"""Models in files told by their endings, and SOFA files made from the shell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from struck.cli import Parser, Result, declare
from struck.cli.info import describe_model
from struck.errors import ContactError, FileFormatError, LossWarning, OptionError
from struck.files import model_file, sofa_fields
from struck.files.sampled_field import SampledField, recorded_contacts, recorded_listeners
from struck.files.sofa_fields import load_sofa_field, load_sofa_responses, save_sofa
from struck.model.damping import InternalFriction
from struck.model.gains import Gains
from struck.model.model import ModalModel
from struck.model.provenance import Provenance, TerminalProgress
from struck.model.residual import Residual
from struck.model.survey import from_spherical
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import SinglePoint
from struck.model.waves import ORDER, real_harmonics
from tests.live.hand import ball
from tests.model.vases import HEIGHTS, Vase, listeners

sofar = pytest.importorskip("sofar", reason="NO SOFA FILE WAS VERIFIED: pip install sofar")

HEARD = np.array([[0.0, 2.0, 0.0], [0.0, 0.0, 3.0], [-1.0, 1.0, 0.5]])


def field(contacts: np.ndarray = HEIGHTS) -> SampledField:
    drawn = Vase.drawn(np.random.default_rng(5))
    natural = np.hypot(drawn.frequencies, drawn.decays / (2 * np.pi))
    assert (np.diff(natural) > 0).all()
    return SampledField(
        frequencies=drawn.frequencies,
        decays=drawn.decays,
        contacts=contacts,
        listeners=listeners(),
        gains=drawn.gains(contacts[:, 0], listeners()),
        centre=np.zeros(3),
        symmetry="axial",
        coordinates=("height (vase heights)", "azimuth (rad)")[: contacts.shape[1]],
    )


def point() -> ModalModel:
    outputs = np.linspace(1, 2, 25) * np.exp(1j * np.arange(25))
    gains = SinglePoint(outputs=outputs, centre=np.array([0.0, 0.1, 0.2]))
    return replace(
        field().model(),
        gains=gains,
        centre=gains.centre,
        coordinates=(),
        places={"recorded": np.zeros(0)},
    )


def verified(path: Path) -> sofar.Sofa:
    read = sofar.read_sofa(str(path), verbose=False)
    assert read.verify(issue_handling="return", mode="write") is None
    return read


def whole(gains: Gains, contacts: np.ndarray, heard: np.ndarray) -> np.ndarray:
    drives = gains.at(contacts, np.zeros((len(contacts), 3)))
    return np.einsum("prm,qrm->pqm", drives, gains.toward(heard))


MODELS = {
    "field": lambda: field().model("field"),
    "turned": lambda: field(np.column_stack([HEIGHTS, [0.0, 1.0, 2.0]])).model("field"),
    "table": lambda: field().model("table"),
    "point": point,
    "two products": lambda: field().model("table").expanded(),
}


@pytest.mark.parametrize("kind", MODELS)
def test_recorded_models_are_saved_without_being_told_where(kind: str, tmp_path: Path) -> None:
    """SOFA files pass sofar's verify, and round-trip to the last bit in frequency and decay."""
    model, path = MODELS[kind](), tmp_path / "model.sofa"
    model_file.save(model, path)
    read = verified(path)
    assert read.N.tobytes() == model.frequencies.tobytes()
    assert read.ModeDecay.tobytes() == model.decays.tobytes()
    if kind == "two products":
        return
    again = model_file.load(path)
    assert again.frequencies.tobytes() == model.frequencies.tobytes()
    assert again.decays.tobytes() == model.decays.tobytes()
    assert again.coordinates == model.coordinates
    assert again.places.keys() == model.places.keys()
    assert type(again.gains) is type(model.gains)
    contacts = recorded_contacts(model.gains)
    assert contacts is not None
    heard = from_spherical(np.array([0.7, 1.0, 3.0]), np.array([0.2, 1.0, -2.0]), 1.1)
    old, new = (whole(each.gains, contacts, heard) for each in (model, again))
    apart = np.linalg.norm(new - old) / np.linalg.norm(old)
    assert apart < (1e-12 if kind in {"table", "point"} else 0.02)


def test_tables_are_sampled_where_they_were_recorded() -> None:
    sampled = SampledField.of(field().model("table"))
    assert np.array_equal(np.sort(sampled.contacts, axis=0), np.sort(HEIGHTS, axis=0))
    folded = listeners() * [1, 0, 1] + np.abs(listeners()) * [0, 1, 0]
    gaps = np.linalg.norm(sampled.listeners[:, None] - folded, axis=2)
    assert gaps.min(axis=0) == pytest.approx(0, abs=1e-12)
    assert gaps.min(axis=1) == pytest.approx(0, abs=1e-12)
    assert recorded_contacts(ball().gains) is None
    assert recorded_listeners(ball().gains) is None


def test_default_listeners_of_a_field_tell_its_waves_apart() -> None:
    heard = recorded_listeners(field().model().gains)
    assert heard is not None
    directions = heard / np.linalg.norm(heard, axis=1, keepdims=True)
    distances = np.repeat([0.12, 0.24], len(heard) // 2)  # who listened nearest, and twice that
    assert np.linalg.norm(heard, axis=1) == pytest.approx(distances)
    assert np.linalg.cond(real_harmonics(directions, ORDER)) < 2


def test_points_on_a_surface_come_back_as_numbered_contacts(tmp_path: Path) -> None:
    model, path = ball(), tmp_path / "ball.sofa"
    with pytest.warns(LossWarning, match=r"ball\.sofa .* without its shape, its material: keep"):
        model_file.save(model, path, contacts=["top", "side"], listeners=HEARD)
    verified(path)
    again = model_file.load(path)
    assert sorted(again.places) == ["contact 1", "contact 2"]
    assert again.frequencies.tobytes() == model.frequencies.tobytes()
    assert again.decays.tobytes() == model.decays.tobytes()
    for number, name in ((1, "top"), (2, "side")):
        contact = model.contact(name)
        drive = model.gains.at(contact.point[None], contact.direction[None])[0, 0]
        place = again.contact(f"contact {number}").point[None]
        expected = drive * model.gains.toward(HEARD)[:, 0]
        found = whole(again.gains, place, HEARD)[0]
        np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_what_a_model_tells_of_its_gains_comes_back(tmp_path: Path) -> None:
    """Its errors, papers and notes; how far gains were from products nobody knows any more."""
    sampled, path = field(), tmp_path / "vase.sofa"
    errors = np.r_[np.nan, np.geomspace(1e-7, 1e-3, 24)]
    dropped = ("2 tones of the surroundings", "the end is\ncut short")
    plain = sampled.model(radius=0.1)
    assert isinstance(plain.gains, TimbreField)
    assert np.isfinite(plain.gains.rank_errors).all()
    model = replace(
        plain,
        errors=errors,
        places={"recorded": HEIGHTS[1]},
        gains=replace(plain.gains, unmeasured=np.array([3, 7]), notes=("2 of 25 modes",)),
        provenance=Provenance(method="fit", references=("roy1989", "golub1973"), dropped=dropped),
    )
    model_file.save(model, path)
    read = verified(path)
    assert np.array_equal(read.ModeError, errors, equal_nan=True)
    assert model.cite() == read.GLOBAL_References
    again = model_file.load(path)
    assert again.errors is not None
    assert again.errors.tobytes() == errors.tobytes()
    assert again.cite() == model.cite()
    assert plain.places["recorded"] != HEIGHTS[1]
    assert again.places["recorded"].tobytes() == HEIGHTS[1].tobytes()
    assert again.provenance.dropped == (dropped[0], "the end is cut short")
    assert again.provenance.details == {"sampled_from": "fit"}
    assert isinstance(again.gains, TimbreField)
    assert np.isnan(again.gains.rank_errors).all()
    assert (again.gains.unmeasured.tolist(), again.gains.notes) == ([3, 7], ("2 of 25 modes",))
    for each in (model, again):
        with pytest.raises(ContactError, match=r"inside its radius of 0\.1 m"):
            each.gains.toward(np.array([[0.0, 0.05, 0.05]]))


def swapped(name: str, value: object) -> Callable[[h5py.File], None]:
    def change(file: h5py.File) -> None:
        if name in file:
            file[name][0] = value
        else:
            file.attrs[name] = value

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (swapped("ModeError", -1.0), "errors: some go down to -1"),
        (swapped("ModeError", np.inf), "ModeError holds 1 values"),
        (swapped("BodyRadius", -0.1), "BodyRadius is -0.1"),
        (swapped("BodyRadius", 99.0), "no model can be made of it"),
        (swapped("RecordedContact", "here"), "RecordedContact is 'here'"),
        (swapped("RecordedContact", "nan"), "RecordedContact is 'nan'"),
    ],
)
def test_what_cannot_be_told_of_gains_is_refused(
    change: Callable[[h5py.File], None], message: str, tmp_path: Path
) -> None:
    path = tmp_path / "vase.sofa"
    model = replace(field().model(radius=0.1), errors=np.full(25, 1e-4))
    model_file.save(model, path)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FileFormatError, match=message):
        model_file.load(path)


def test_unknown_papers_and_endless_notes_do_no_harm(tmp_path: Path) -> None:
    path, notes = tmp_path / "vase.sofa", tuple(f"{each} " * 500 for each in range(100))
    model = replace(field().model(), provenance=Provenance(references=("roy1989",), dropped=notes))
    model_file.save(model, path)
    with h5py.File(path, "r+") as file:
        file.attrs["ReferenceKeys"] = "roy1989 nobody2099"
    again = model_file.load(path)
    assert again.cite() == model.cite()
    kept = again.provenance.dropped
    assert 10 < len(kept) < 100
    assert kept[-2] == f"... and {102 - len(kept)} more notes"
    assert kept[-1] == "1 reference, unknown to this version: nobody2099"
    with pytest.raises(OptionError, match="Title has 70,000 bytes"):
        sofa_fields.export(model, path, title="x" * 70_000)


def test_gains_that_were_measured_tell_how_far_they_are_from_products(tmp_path: Path) -> None:
    path, sampled = tmp_path / "vase.sofa", field()
    save_sofa(sampled, path)
    read = load_sofa_field(path)
    assert read.origin is None
    found, expected = read.model().gains, sampled.model().gains
    assert isinstance(found, TimbreField)
    assert isinstance(expected, TimbreField)
    assert np.array_equal(found.rank_errors, expected.rank_errors)


@pytest.mark.parametrize("turned", [False, True])
def test_listeners_inside_a_body_come_back(turned: bool, tmp_path: Path) -> None:  # noqa: FBT001 - both kinds
    whole_field = field(np.column_stack([HEIGHTS, [0.0, 1.0, 2.0]]) if turned else HEIGHTS)
    heard = np.concatenate([listeners(), [[0.05, 0.0, 0.05]]])
    gains = np.concatenate([whole_field.gains, 5 * whole_field.gains[:, :1]], axis=1)
    model = replace(whole_field, listeners=heard, gains=gains, radius=0.1).model()
    model_file.save(model, tmp_path / "vase.sofa")
    again = model_file.load(tmp_path / "vase.sofa")
    contacts, place = np.column_stack([HEIGHTS, [0.0] * 3])[:, : 1 + turned], heard[-1:]
    outer = model.gains.toward(from_spherical(0.5, 0.0, 1.1))
    for each in (model, again):
        assert isinstance(each.gains, TimbreField)
        assert len(each.gains.listener_part.inside.places) == 1
        assert np.abs(each.gains.toward(place)).max() > 2 * np.abs(outer).max()
    old, new = (whole(each.gains, contacts, place) for each in (model, again))
    assert np.linalg.norm(new - old) / np.linalg.norm(old) < 0.02


def test_a_residual_is_told_to_be_left_out(tmp_path: Path) -> None:
    bands = {"edges": np.array([100.0, 1000.0]), "levels": np.ones(1), "decays": np.ones(1)}
    rest = Residual(attack=np.ones(8, np.float32), sample_rate=8000, lead=0.0, **bands)
    model = replace(point(), residual=rest)
    with pytest.warns(LossWarning, match="without its residual"):
        model_file.save(model, tmp_path / "mug.sofa")
    details = {"blow": [0, 3]}
    marked = replace(point(), provenance=point().provenance.extended(**details))
    with pytest.warns(LossWarning, match="without its marks of the blow's modes"):
        model_file.save(marked, tmp_path / "mug.sofa")


@pytest.mark.parametrize("name", ["mug.wav", "mug.npz", "mug"])
def test_models_go_to_files_of_models(name: str, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"models end in \.struck"):
        model_file.save(point(), tmp_path / name)
    model_file.save(point(), tmp_path / "mug.STRUCK")
    assert [path.name for path in tmp_path.iterdir()] == ["mug.STRUCK"]
    assert len(model_file.load(tmp_path / "mug.STRUCK").frequencies) == 25


def struck_export(*arguments: object) -> Result:
    shell = Parser(prog="struck")
    declare(shell.add_subparsers().add_parser("export"), "export")
    options = shell.parse_args(["export", *map(str, arguments)])
    return options.run(options, TerminalProgress())


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    model_file.save(ball(), tmp_path / "ball.struck")
    return tmp_path / "ball.struck"


def test_the_shell_exports_gains(saved: Path) -> None:
    path = saved.with_suffix(".sofa")
    places = ("--listeners", "0,2,0", "0,0,3", "--listeners=-1,1,0.5", "--title", "Ball")
    with pytest.warns(LossWarning):
        told = struck_export(saved, "--contacts", "top", "side", *places, "--licence", "CC0-1.0")
    assert told.lines == [f"wrote {path}"]
    assert told.facts == {
        "output": str(path),
        "convention": "GeneralTF-E",
        "left_out": 0,
        "without": ["its shape", "its material"],
    }
    read, model = verified(path), ball()
    assert (read.GLOBAL_Title, read.GLOBAL_License) == ("Ball", "CC0-1.0")
    assert np.array_equal(read.ListenerPosition, HEARD)
    found = load_sofa_field(path)
    assert found.frequencies.tobytes() == model.frequencies.tobytes()
    assert found.decays.tobytes() == model.decays.tobytes()
    again = model_file.load(path)
    assert again.frequencies.tobytes() == model.frequencies.tobytes()
    assert again.decays.tobytes() == model.decays.tobytes()


@pytest.mark.filterwarnings("ignore::struck.errors.LossWarning")
def test_the_shell_exports_responses(saved: Path, tmp_path: Path) -> None:
    path = tmp_path / "responses.sofa"
    beyond = np.count_nonzero(ball().frequencies >= 2000)
    told = struck_export(
        saved, "-o", path, "--contacts", "top", "--listeners", "0,2,0",
        "--convention", "GeneralFIR-E", "--seconds", 0.1, "--rate", 4000,
    )  # fmt: skip
    assert told.facts["left_out"] == beyond > 0
    assert f"{beyond} modes at or above 2000 Hz left out" in "\n".join(told.lines)
    assert verified(path).GLOBAL_SOFAConventions == "GeneralFIR-E"
    assert load_sofa_responses(path).samples.shape == (1, 1, 400)


@pytest.mark.filterwarnings("ignore::struck.errors.LossWarning")
def test_responses_last_until_the_slowest_mode_has_fallen_by_60_db(tmp_path: Path) -> None:
    path, model = tmp_path / "ball.sofa", ball().damped(InternalFriction(loss_tangent=0.01))
    sofa_fields.export(
        model, path, contacts=["top"], listeners=HEARD, convention="GeneralFIR-E", sample_rate=8000
    )
    seconds = load_sofa_responses(path).samples.shape[2] / 8000
    assert seconds == pytest.approx(np.log(1000) / model.decays.min(), abs=1e-3)
    sofa_fields.export(
        ball(),
        path,
        contacts=["top"],
        listeners=HEARD[:1],
        convention="GeneralFIR-E",
        sample_rate=80,
    )
    assert load_sofa_responses(path).samples.shape == (1, 1, 800)  # an endless one: 10 s


def test_what_does_not_fit_is_refused_and_nothing_is_written(saved: Path, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"give contacts=, .*, and listeners="):
        struck_export(saved)
    with pytest.raises(OptionError, match="give x,y,z of each"):
        struck_export(saved, "--contacts", "top", "--listeners", "0,2")
    with pytest.raises(FileFormatError, match=r"ends in '\.wav'.* end in \.sofa"):
        struck_export(saved, "-o", tmp_path / "ball.wav")
    with pytest.raises(OptionError, match="convention is 'FIR'"):
        struck_export(saved, "--convention", "FIR")
    with pytest.raises(OptionError, match=r"--seconds 1\.0 is of impulse responses"):
        struck_export(saved, "--seconds", 1)
    with pytest.raises(OptionError, match="holds modes, not samples"):
        sofa_fields.export(ball(), saved.with_suffix(".sofa"), seconds=1.0)
    with pytest.raises(OptionError, match=r"or end in \.sofa"):
        model_file.save(ball(), tmp_path / "other.struck", contacts=["top"])
    assert list(tmp_path.iterdir()) == [saved]


def test_what_a_file_of_gains_holds_is_told(tmp_path: Path) -> None:
    """As `struck info` tells it."""
    model_file.save(field().model(), tmp_path / "vase.sofa")
    told = describe_model(model_file.load(tmp_path / "vase.sofa"), "")
    assert told.lines[0].startswith("25 modes")
    assert told.facts["frequencies"] == field().frequencies.tolist()
    assert told.facts["decays"] == field().decays.tolist()


@pytest.mark.filterwarnings("ignore::struck.errors.LossWarning")
def test_a_file_of_another_kind_is_no_model(tmp_path: Path) -> None:
    path = tmp_path / "ball.sofa"
    sofa_fields.export(
        ball(), path, contacts=["top"], listeners=HEARD, convention="GeneralFIR-E", seconds=0.01
    )
    with pytest.raises(FileFormatError, match="'GeneralFIR-E'"):
        model_file.load(path)
    with pytest.raises(FileFormatError, match="nowhere"):
        model_file.load(tmp_path / "nowhere.struck")
    model_file.save(ball(), path, contacts=["top"], listeners=[[0.0, 0.0, 2.0]])
    assert len(model_file.load(path).frequencies)
