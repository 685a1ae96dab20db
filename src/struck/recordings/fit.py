"""The verb: recordings of one object in, its model out."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.analysis.cached_steps import Stages, fingerprint, holding
from struck.errors import OptionError, RecordingError, counted, require_choice, rounded
from struck.files.atomic import is_file, is_folder
from struck.files.cache import opened
from struck.files.sampled_field import WAYS
from struck.model.arrays import Array, Complex, Mask, brief, checked
from struck.model.exponentials import Exponentials
from struck.model.gains import Gains
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.model.provenance import Progress, Provenance, silent
from struck.model.residual import Residual
from struck.model.survey import Survey
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import SinglePoint, TimbreTable
from struck.recordings.disturbances import without_hum
from struck.recordings.gain_table import Gathered
from struck.recordings.manifest import KINDS, manifest_in, read_manifest
from struck.recordings.poles.search import CLEAR, METHODS, Fitted, fit_poles
from struck.recordings.poles.selection import hidden, raised
from struck.recordings.residual_sound import (
    SHORT,
    may_be_of_room,
    one_strike,
    remainder,
    reverberation,
)
from struck.recordings.takes import Recorded, Recording, Take

if TYPE_CHECKING:
    from struck.excitation.strike import Strike


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitting:
    """A model of recordings, with all that is known of how well it fits.

    Parameters
    ----------
    model : ModalModel
    fitted : Fitted
        Shared poles, gains of each channel of each hit, standard errors, verdict and notes.
    recorded : Recorded
        The takes and their places.
    survey : Survey or None
        Gains over contact and listener; None for a model of a single point.
    lead : float
        From the arrival of a hit to the moment that gains are as of, s: until then the object is
        still being struck.
    room : array (M,), bool, or None
        Which modes the room may have; None where its reverberation is not given.
    residual : Residual
        Attack and noise of the loudest hit, which the model has where it was asked for or needed.
    short : float
        By how much a band of the ear is short without the residual, at most, dB.
    """

    __repr__ = brief
    model: ModalModel
    fitted: Fitted
    recorded: Recorded
    survey: Survey | None
    lead: float
    room: NDArray[np.bool_] | None
    residual: Residual
    short: float


RECORDED = "recorded"  # default contact of a model from recordings
_REFERENCES = {
    "shared": ("roy1989", "golub1973", "corbett2007"),
    "corbett2007": ("corbett2007", "steiglitz1965"),
}
_NAMES = {"shared": "poles that all share", "corbett2007": "the method of 2007"}
_RINGING = holding("poles", Exponentials)
_FEW = 6  # takes that are also judged one by one
_TOLD = 3.0  # least energy of a mode over the skirts of louder ones, beside a room that was told
_WEAKEST = 0.1  # least share of its impulse with which a blow counts at a mode: 20 dB
_APART = 6.0  # dB between takes without places, from which the blow or the distance is noted


@checked
def fit_recordings(
    recordings: Recording | Sequence[Recording],
    *,
    contacts: ArrayLike | None = None,
    listeners: ArrayLike | Sequence[ArrayLike] | None = None,
    manifest: str | os.PathLike[str] | None = None,
    symmetry: str | None = None,
    centre: ArrayLike | None = None,
    radius: float = 0.0,
    way: str = "field",
    method: str = "shared",
    modes: int | None = 64,
    onsets: Sequence[Sequence[float]] | None = None,
    room: float | Recording | None = None,
    pitch: ArrayLike | None = None,
    geometry: Mesh | str | os.PathLike[str] | None = None,
    blow: Strike | None = None,
    residual: bool | None = None,
    force: bool = False,
    cache: bool | str | os.PathLike[str] = True,
    progress: Progress = silent,
) -> Fitting:
    """Fit a model to recordings of one object, with a report on the fit.

    The parameters are those of `struck.fit`.

    Returns
    -------
    Fitting
    """
    _require(way, method, radius, modes)
    _require_blow(blow, residual=residual)
    surface = geometry if isinstance(geometry, Mesh | None) else _surface(geometry)
    recorded = Recorded.of(
        recordings,
        contacts=contacts,
        listeners=listeners,
        manifest=manifest,
        symmetry=symmetry,
        centre=centre,
        progress=progress,
    )
    _require_use(recorded, way, radius)
    seconds = None if room is None else reverberation(room)
    told = {"method": method, "budget": modes, "onsets": onsets}
    fitted = _fitted(recorded.takes, told, cache, progress)
    _require_modes(fitted, recorded, told, force=force)
    fitted = _with_room_note(fitted, seconds, measured=modes is None)
    natural = np.hypot(fitted.frequencies, fitted.decays / (2 * np.pi))
    fitted = fitted.of(np.argsort(natural, kind="stable"))
    asked = residual if blow is None else False
    made = _made(fitted, recorded, seconds, way, radius, method, residual=asked)
    model = made.model if blow is None else without_blow(made.model, blow, made.lead)
    if pitch is not None or surface is not None:
        model = model.charted(pitch=pitch, geometry=surface)
    sought = model.provenance.extended(modes_sought=modes or "all")
    return replace(made, model=replace(model, provenance=sought))


def _fitted(
    takes: Sequence[Take],
    told: dict[str, Any],
    cache: bool | str | os.PathLike[str],  # noqa: FBT001 - as of the verb
    progress: Progress,
) -> Fitted:
    """Fit poles, going on from finished stages of an earlier run."""
    stages = Stages(cache=opened(choice=cache), progress=progress)
    heard = fingerprint([(take.samples, take.sample_rate) for take in takes])

    def kept(name: str, compute: Callable[[], Exponentials]) -> Exponentials:
        return stages.kept(_RINGING, compute, name=name, takes=heard, **told)

    return fit_poles(takes, **told, progress=progress, kept=kept)


def _require(way: str, method: str, radius: float, modes: int | None) -> None:
    if modes is not None and not (isinstance(modes, int | np.integer) and modes >= 1):
        raise OptionError(f"modes is {modes!r}: give a whole number of at least 1, or None for all")
    require_choice("way", way, WAYS)
    require_choice("method", method, METHODS)
    if not (np.isfinite(radius) and radius >= 0):
        raise OptionError(f"radius is {radius}: give that of a ball around the body, m, at least 0")


def _surface(path: str | os.PathLike[str]) -> Mesh:
    from struck.files.meshes import load_surface  # as few fits need one

    return load_surface(path)


def _require_blow(blow: Strike | None, *, residual: bool | None) -> None:
    if blow is None:
        return
    if residual:
        raise OptionError(
            "residual=True keeps the attack of the recorded blow, and blow= divides that blow out: "
            "leave one of them out"
        )
    if blow.shape != "half-sine" or blow.transient:
        raise OptionError(
            f"blow has the shape {blow.shape!r} and the transient {blow.transient:g}: what is "
            "divided out is a half-sine of some impulse and duration, so give that"
        )


def without_blow(model: ModalModel, blow: Strike, lead: float = 0.0) -> ModalModel:
    """Return a model whose gains are for a force in N, the blow of its recordings divided out.

    The blow begins `lead` s before the moment that gains are as of. Modes that it drove by less
    than a tenth of its impulse are divided by a tenth alone, and counted in `provenance`.
    """
    from struck.synth.ring_down import released

    if model.gains.of_surface:
        raise OptionError("its gains are for a force in N already: leave blow= out")
    struck = blow.resolved(model, model.contact())
    poles = -model.decays + 2j * np.pi * model.frequencies
    share: Complex = np.asarray(released(poles, struck.duration), np.complex128)
    sizes = np.abs(share * np.exp(-poles * struck.duration))  # before the modes decayed
    weak, own = sizes < _WEAKEST, model.of_object
    share = np.where(weak, share * _WEAKEST / np.maximum(sizes, 1e-300), share)
    later = np.exp(poles * (lead - struck.duration))
    lost = model.frequencies[weak & own]
    note = (
        f"{len(lost)} of {np.count_nonzero(own)} modes, the lowest at "
        f"{lost.min(initial=np.inf):.6g} Hz, were hardly driven by a blow of "
        f"{rounded(struck.duration, 3)} s: forces drive them too softly"
    )
    return replace(
        model,
        gains=model.gains.deconvolved(struck.impulse * share * later),
        provenance=model.provenance.extended(
            dropped=(note,) * bool(len(lost)),
            divided_blow={"impulse": struck.impulse, "duration": struck.duration},
        ),
    )


def _require_use(recorded: Recorded, way: str, radius: float) -> None:
    if recorded.contacts is not None or recorded.listeners is not None:
        return
    idle = {"way": way != "field", "radius": radius > 0, "symmetry": recorded.symmetry != "none"}
    idle |= {"centre": recorded.centre.any()}
    given = [name for name, asked in idle.items() if asked]
    if given:
        raise OptionError(
            f"{given[0]} is about the places where it was struck and heard, and none are given: "
            "give a list of takes with their places (manifest=)"
        )


def _require_modes(
    fitted: Fitted, recorded: Recorded, told: dict[str, Any], *, force: bool
) -> None:
    if len(fitted.frequencies) and (fitted.verdict.modal or force):
        return
    more = len(recorded.takes) - 1
    names = recorded.takes[0].name + (f" and {more} more" if more else "")
    if fitted.verdict.modal:
        raise RecordingError(
            f"{names}: no mode is clear of the noise, all lie below {CLEAR:.0f} dB of "
            "energy: record louder or nearer, or fit for playing, with modes=64"
        )
    way = told["method"]
    other = (
        f" That is by method={way!r}: leave method= out for the default." if way != "shared" else ""
    )
    if told["budget"] is None and way == "shared":
        other = " With modes=64 the blow is fitted too, for playing: of short sounds it is most."
    advice = "" if not len(fitted.frequencies) else " Fit it all the same with force=True."
    each = _each_alone(recorded.takes, told) if 1 < len(recorded.takes) <= _FEW else ""
    raise RecordingError(f"{names}: not modal: {fitted.verdict.reason}.{each}{other}{advice}")


def _each_alone(takes: Sequence[Take], told: dict[str, Any]) -> str:
    """Return the sentence, for takes refused together, that names the ones modal alone."""
    alone = {"method": told["method"], "budget": told["budget"]}
    verdicts = [fit_poles(take, **alone).verdict for take in takes]
    modal = [Path(take.name).name for take, each in zip(takes, verdicts, strict=True) if each.modal]
    if len(modal) == len(takes):
        return " Each alone is modal: they are not of one object, or it changed; fit them apart."
    return f" Alone {', '.join(modal) or 'none'} of them would be modal."


def _with_room_note(fitted: Fitted, seconds: float | None, *, measured: bool) -> Fitted:
    """Add a note on the modes that may be the room's; of `measured` ones leave out its crowd."""
    if seconds is None or not (fast := may_be_of_room(fitted.decays, seconds)).any():
        return fitted
    heard = Exponentials(poles=-fitted.decays + 2j * np.pi * fitted.frequencies, gains=fitted.gains)
    own = np.isin(fitted.heard.decays, fitted.decays)
    crowd = hidden(heard, ~fast, _TOLD) & raised(fitted.segments, fitted.heard)[own]
    notes = list(fitted.notes)
    if measured and crowd.any():
        notes.append(
            f"{crowd.sum()} modes that die away as fast as the room, T60 {rounded(seconds, 2)} s, "
            "and hardly stand out of what else sounds there, left out of the model as its own"
        )
        fitted, fast = fitted.of(~crowd), fast[~crowd]
    if fast.any():
        notes.append(
            f"{fast.sum()} of {len(fast)} modes die away nearly as fast as the room, T60 "
            f"{rounded(seconds, 2)} s, or faster: they may be its own; those that stay when the "
            "object is moved are not"
        )
    return replace(fitted, notes=tuple(notes))


def _made(
    fitted: Fitted,
    recorded: Recorded,
    seconds: float | None,
    way: str,
    radius: float,
    method: str,
    *,
    residual: bool | None,
) -> Fitting:
    still = zip((without_hum(take)[0] for take in recorded.takes), fitted.controls, strict=True)
    calm = replace(recorded, takes=tuple(by.undone(take) if by else take for take, by in still))
    gathered = Gathered.of(fitted, calm)
    survey, gains = _gains(gathered, recorded, way, radius, ~fitted.blow)
    rest, short = remainder(fitted, calm, gathered)
    asked = short > SHORT if residual is None else residual
    places = {RECORDED: np.zeros(0) if survey is None else _loudest(survey, fitted.decays)}
    model = ModalModel(
        frequencies=fitted.frequencies,
        natural_frequencies=np.hypot(fitted.frequencies, fitted.decays / (2 * np.pi)),
        decays=fitted.decays,
        gains=gains,
        centre=recorded.centre,
        complete_to=0.0,
        errors=fitted.frequency_errors / fitted.frequencies,
        places=places,
        coordinates=() if survey is None else recorded.coordinates or ("u",),
        residual=rest if asked else None,
        provenance=_provenance(fitted, recorded, gains, method, gathered),
    )
    return Fitting(
        model=model,
        fitted=fitted,
        recorded=recorded,
        survey=survey,
        lead=gathered.lead,
        room=None if seconds is None else may_be_of_room(fitted.decays, seconds),
        residual=rest,
        short=short,
    )


def _gains(
    gathered: Gathered, recorded: Recorded, way: str, radius: float, own: Mask
) -> tuple[Survey | None, Gains]:
    if recorded.contacts is None and recorded.listeners is None:
        outputs = gathered.in_one_point()
        return None, SinglePoint(outputs=outputs, centre=recorded.centre)
    survey = gathered.survey(recorded)
    if way == "table":
        return survey, TimbreTable.of(survey)
    return survey, TimbreField.of(survey, radius=radius, own=own)


def _loudest(survey: Survey, decays: Array) -> Array:
    """Return the coordinates of the contact with the most energy."""
    energies = (np.abs(survey.gains) ** 2 / np.maximum(decays, 1e-6)).sum(axis=1)
    return survey.contacts[survey.pairs[energies.argmax(), 0]]


def _provenance(
    fitted: Fitted, recorded: Recorded, gains: Gains, method: str, gathered: Gathered
) -> Provenance:
    notes = fitted.notes + tuple(getattr(gains, "notes", ()))
    if isinstance(gains, SinglePoint) and gathered.range > _APART:
        note = (
            f"the levels of the takes differ by {gathered.range:.0f} dB, and sound alone does not "
            "show whether the blows or the distances do: each take counts as loud as the loudest; "
            "a list of takes with their places keeps the levels"
        )
        notes += (note,)
    hits = len(np.unique(gathered.hits))
    details: dict[str, object] = {
        "recordings": len(recorded.takes),
        "hits": hits,
        "channels": int(np.bincount(gathered.hits).max()),
        "signal_to_residual": round(fitted.verdict.signal_to_residual, 2),
        "explained_by_one_strike": round(one_strike(fitted), 4),
        "rank_error": _middle(getattr(gains, "rank_errors", None), ~fitted.blow),
        "blow": np.flatnonzero(fitted.blow).tolist() or None,
        "vague": np.flatnonzero(fitted.vague).tolist() or None,
    }
    references = _REFERENCES[method]
    if isinstance(gains, TimbreField):
        references += ("rasmussen2006",)
    return Provenance(
        method=f"fit of {counted(hits, 'hit')} by {_NAMES[method]}",
        references=references,
        dropped=notes,
        details={name: value for name, value in details.items() if value is not None},
    )


def _middle(errors: Array | None, own: Mask) -> float | None:
    """Return the median of the finite errors of the object's own modes."""
    known = np.zeros(0) if errors is None else errors[np.isfinite(errors) & own]
    return float(np.round(np.median(known), 5)) if known.size else None


def files_read(
    recordings: Recording | Sequence[Recording], manifest: str | os.PathLike[str] | None
) -> list[str | os.PathLike[str]]:
    """Return all files that a fit reads, including the files named by a manifest or in a folder."""
    several = [recordings]
    if isinstance(recordings, Sequence) and not isinstance(recordings, str):
        several = recordings
    named = [each for each in (*several, manifest) if isinstance(each, str | os.PathLike)]
    paths = [manifest_in(Path(each)) if is_folder(each) else Path(each) for each in named]
    lists = [path for path in paths if path.suffix.lower() in KINDS and is_file(path)]
    return [*named, *lists, *(file for path in lists for file in read_manifest(path).files)]
