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
from struck.recordings.gain_table import GainTable
from struck.recordings.manifest import KINDS, manifest_in, read_manifest
from struck.recordings.poles.search import CLEAR, METHODS, PoleFit, fit_poles
from struck.recordings.poles.selection import find_masked, find_unexplained_bands
from struck.recordings.residual_sound import (
    MAX_DEFICIT,
    may_be_of_room,
    one_strike,
    remainder,
    reverberation,
)
from struck.recordings.takes import Recording, RecordingSet, Take

if TYPE_CHECKING:
    from struck.excitation.strike import Strike


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitting:
    """A model of recordings, with the quality of its fit.

    Parameters
    ----------
    model : ModalModel
        The model.
    fitted : PoleFit
        Shared poles, gains of each channel of each hit, standard errors, verdict and notes.
    recorded : RecordingSet
        The takes with their contacts and listeners.
    survey : Survey or None
        Gains over contact and listener. None: a model of a single point.
    lead : float
        Time from the arrival of a hit to the time of the gains, s, until which the object is still
        being struck.
    room : array (M,) of bool, or None
        Modes that may be those of the room. None: its reverberation is unknown.
    residual : Residual
        Attack and noise of the loudest hit, which the model has if requested or needed.
    short : float
        Largest loss of a band of the ear without the residual, dB.
    """

    __repr__ = brief
    model: ModalModel
    fitted: PoleFit
    recorded: RecordingSet
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
_MAX_JUDGED_TAKES = 6  # takes that are also judged one by one
# Least energy of a mode over the skirts of louder ones, if the room is known.
_MIN_SKIRT_RATIO = 3.0
_MIN_DRIVE = 0.1  # least fraction of the impulse by which a blow drives a mode: -20 dB
# dB between takes without places, from which the blow or the distance is noted.
_MAX_LEVEL_RANGE = 6.0


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
    interpolation: str = "field",
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
    """Fit a modal model to recordings of one object, with a report on the fit.

    The parameters are those of `struck.fit`; `progress` is silent by default.

    Returns
    -------
    Fitting
        The model, with the fitted modes, their errors and the recordings.

    Examples
    --------
    >>> time = np.arange(48_000) / 48_000
    >>> hit = 0.5 * np.exp(-8 * time) * np.sin(2 * np.pi * 440 * time)
    >>> noise = 1e-4 * np.random.default_rng(0).standard_normal(72_000)
    >>> samples = noise + np.concatenate([np.zeros(24_000), hit])
    >>> recording = struck.Sound(samples=samples[None], sample_rate=48_000)
    >>> fitting = struck.recordings.fit_recordings(
    ...     recording, modes=None, residual=False, cache=False
    ... )
    >>> fitting.fitted.frequencies.round(1)
    array([440.])
    >>> bool(fitting.fitted.frequency_errors[0] < 0.01)
    True
    """
    _require(interpolation, method, radius, modes)
    _require_blow(blow, residual=residual)
    surface = geometry if isinstance(geometry, Mesh | None) else _surface(geometry)
    recording_set = RecordingSet.of(
        recordings,
        contacts=contacts,
        listeners=listeners,
        manifest=manifest,
        symmetry=symmetry,
        centre=centre,
        progress=progress,
    )
    _require_use(recording_set, interpolation, radius)
    seconds = None if room is None else reverberation(room)
    options = {"method": method, "budget": modes, "onsets": onsets}
    fit = _fit_takes(recording_set.takes, options, cache, progress)
    _require_modes(fit, recording_set, options, force=force)
    fit = _add_room_note(fit, seconds, measured=modes is None)
    natural = np.hypot(fit.frequencies, fit.decays / (2 * np.pi))
    fit = fit.of(np.argsort(natural, kind="stable"))
    residual_option = residual if blow is None else False
    fitting = _make_fitting(
        fit, recording_set, seconds, interpolation, radius, method, residual=residual_option
    )
    model = fitting.model if blow is None else without_blow(fitting.model, blow, fitting.lead)
    if pitch is not None or surface is not None:
        model = model.charted(pitch=pitch, geometry=surface)
    provenance = model.provenance.extended(modes_sought=modes or "all")
    return replace(fitting, model=replace(model, provenance=provenance))


def _fit_takes(
    takes: Sequence[Take],
    options: dict[str, Any],
    cache: bool | str | os.PathLike[str],  # noqa: FBT001 - as of the verb
    progress: Progress,
) -> PoleFit:
    """Fit poles, going on from finished stages of an earlier run."""
    stages = Stages(cache=opened(choice=cache), progress=progress)
    key = fingerprint([(take.samples, take.sample_rate) for take in takes])

    def run_stage(name: str, compute: Callable[[], Exponentials]) -> Exponentials:
        return stages.get_or_compute(_RINGING, compute, name=name, takes=key, **options)

    return fit_poles(takes, **options, progress=progress, run_stage=run_stage)


def _require(interpolation: str, method: str, radius: float, modes: int | None) -> None:
    if modes is not None and not (isinstance(modes, int | np.integer) and modes >= 1):
        raise OptionError(f"modes is {modes!r}: give a whole number of at least 1, or None for all")
    require_choice("interpolation", interpolation, WAYS)
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
            f"blow has the shape {blow.shape!r} and the transient {rounded(blow.transient)}: only "
            "a half-sine of some impulse and duration is divided out, so give that"
        )


def without_blow(model: ModalModel, blow: Strike, lead: float = 0.0) -> ModalModel:
    """Return a model whose gains are for a force in N, the blow of its recordings divided out.

    The blow begins `lead` s before the moment that gains are as of. Modes that it drove by less
    than a tenth of its impulse are divided by a tenth alone, and counted in `provenance`.
    """
    from struck.synth.ring_down import released

    if model.gains.of_surface:
        raise OptionError("its gains are for a force in N already: leave blow= out")
    pulse = blow.resolved(model, model.contact())
    poles = -model.decays + 2j * np.pi * model.frequencies
    drives: Complex = np.asarray(released(poles, pulse.duration), np.complex128)
    sizes = np.abs(drives * np.exp(-poles * pulse.duration))  # before the modes decayed
    is_weak, is_object_mode = sizes < _MIN_DRIVE, model.of_object
    drives = np.where(is_weak, drives * _MIN_DRIVE / np.maximum(sizes, 1e-300), drives)
    time_factors = np.exp(poles * (lead - pulse.duration))
    lost_frequencies = model.frequencies[is_weak & is_object_mode]
    note = (
        f"{len(lost_frequencies)} of {np.count_nonzero(is_object_mode)} modes, the lowest at "
        f"{lost_frequencies.min(initial=np.inf):.6g} Hz, were hardly driven by a blow of "
        f"{rounded(pulse.duration, 3)} s: forces drive them too softly"
    )
    return replace(
        model,
        gains=model.gains.deconvolved(pulse.impulse * drives * time_factors),
        provenance=model.provenance.extended(
            dropped=(note,) * bool(len(lost_frequencies)),
            divided_blow={"impulse": pulse.impulse, "duration": pulse.duration},
        ),
    )


def _require_use(recording_set: RecordingSet, interpolation: str, radius: float) -> None:
    if recording_set.contacts is not None or recording_set.listeners is not None:
        return
    options = {
        "interpolation": interpolation != "field",
        "radius": radius > 0,
        "symmetry": recording_set.symmetry != "none",
    }
    options |= {"centre": recording_set.centre.any()}
    option_names = [name for name, is_set in options.items() if is_set]
    if option_names:
        raise OptionError(
            f"{option_names[0]} is about the places where it was struck and heard, and none are "
            "given: give a list of takes with their places (manifest=)"
        )


def _require_modes(
    fit: PoleFit, recording_set: RecordingSet, options: dict[str, Any], *, force: bool
) -> None:
    if len(fit.frequencies) and (fit.verdict.modal or force):
        return
    count = len(recording_set.takes) - 1
    names = recording_set.takes[0].name + (f" and {count} more" if count else "")
    if fit.verdict.modal:
        raise RecordingError(
            f"{names}: no mode is clear of the noise, all lie below {CLEAR:.0f} dB of "
            "energy: record louder or nearer, or fit for playing, with modes=64"
        )
    method = options["method"]
    method_note = (
        f" That is by method={method!r}: leave method= out for the default."
        if method != "shared"
        else ""
    )
    if options["budget"] is None and method == "shared":
        method_note = (
            " With modes=64 the blow is fitted too, for playing: of short sounds it is most."
        )
    advice = "" if not len(fit.frequencies) else " Fit it all the same with force=True."
    takes_note = (
        _list_modal_takes(recording_set.takes, options)
        if 1 < len(recording_set.takes) <= _MAX_JUDGED_TAKES
        else ""
    )
    raise RecordingError(
        f"{names}: not modal: {fit.verdict.reason}.{takes_note}{method_note}{advice}"
    )


def _list_modal_takes(takes: Sequence[Take], options: dict[str, Any]) -> str:
    """Return the sentence, for takes refused together, that names the ones modal alone."""
    single_options = {"method": options["method"], "budget": options["budget"]}
    verdicts = [fit_poles(take, **single_options).verdict for take in takes]
    modal_names = [
        Path(take.name).name for take, verdict in zip(takes, verdicts, strict=True) if verdict.modal
    ]
    if len(modal_names) == len(takes):
        return " Each alone is modal: they are not of one object, or it changed; fit them apart."
    return f" Alone {', '.join(modal_names) or 'none'} of them would be modal."


def _add_room_note(fit: PoleFit, seconds: float | None, *, measured: bool) -> PoleFit:
    """Add a note on modes that may be of the room; drop its spurious modes if `measured`."""
    if seconds is None or not (is_fast := may_be_of_room(fit.decays, seconds)).any():
        return fit
    exponentials = Exponentials(poles=-fit.decays + 2j * np.pi * fit.frequencies, gains=fit.gains)
    is_fitted = np.isin(fit.exponentials.decays, fit.decays)
    is_spurious = (
        find_masked(exponentials, ~is_fast, _MIN_SKIRT_RATIO)
        & find_unexplained_bands(fit.segments, fit.exponentials)[is_fitted]
    )
    notes = list(fit.notes)
    if measured and is_spurious.any():
        notes.append(
            f"{is_spurious.sum()} modes that die away as fast as the room, T60 "
            f"{rounded(seconds, 2)} s, and do not stand out of the other sound in their bands, are "
            "left out of the model as modes of the room"
        )
        fit, is_fast = fit.of(~is_spurious), is_fast[~is_spurious]
    if is_fast.any():
        notes.append(
            f"{is_fast.sum()} of {len(is_fast)} modes die away nearly as fast as the room, T60 "
            f"{rounded(seconds, 2)} s, or faster: they may be its own; those that stay when the "
            "object is moved are not"
        )
    return replace(fit, notes=tuple(notes))


def _make_fitting(
    fit: PoleFit,
    recording_set: RecordingSet,
    seconds: float | None,
    interpolation: str,
    radius: float,
    method: str,
    *,
    residual: bool | None,
) -> Fitting:
    takes_and_controls = zip(
        (without_hum(take)[0] for take in recording_set.takes), fit.controls, strict=True
    )
    calm_takes = replace(
        recording_set,
        takes=tuple(
            control.undone(take) if control else take for take, control in takes_and_controls
        ),
    )
    gain_table = GainTable.of(fit, calm_takes)
    survey, gains = _gains(gain_table, recording_set, interpolation, radius, ~fit.blow)
    residual_sound, deficit = remainder(fit, calm_takes, gain_table)
    has_residual = deficit > MAX_DEFICIT if residual is None else residual
    places = {RECORDED: np.zeros(0) if survey is None else _loudest_contact(survey, fit.decays)}
    model = ModalModel(
        frequencies=fit.frequencies,
        natural_frequencies=np.hypot(fit.frequencies, fit.decays / (2 * np.pi)),
        decays=fit.decays,
        gains=gains,
        centre=recording_set.centre,
        complete_to=0.0,
        errors=fit.frequency_errors / fit.frequencies,
        places=places,
        coordinates=() if survey is None else recording_set.coordinates or ("u",),
        residual=residual_sound if has_residual else None,
        provenance=_provenance(fit, recording_set, gains, method, gain_table),
    )
    return Fitting(
        model=model,
        fitted=fit,
        recorded=recording_set,
        survey=survey,
        lead=gain_table.lead,
        room=None if seconds is None else may_be_of_room(fit.decays, seconds),
        residual=residual_sound,
        short=deficit,
    )


def _gains(
    gain_table: GainTable,
    recording_set: RecordingSet,
    interpolation: str,
    radius: float,
    is_object_mode: Mask,
) -> tuple[Survey | None, Gains]:
    if recording_set.contacts is None and recording_set.listeners is None:
        outputs = gain_table.in_one_point()
        return None, SinglePoint(outputs=outputs, centre=recording_set.centre)
    survey = gain_table.survey(recording_set)
    if interpolation == "table":
        return survey, TimbreTable.of(survey)
    return survey, TimbreField.of(survey, radius=radius, object_modes=is_object_mode)


def _loudest_contact(survey: Survey, decays: Array) -> Array:
    """Return the coordinates of the contact with the most energy."""
    energies = (np.abs(survey.gains) ** 2 / np.maximum(decays, 1e-6)).sum(axis=1)
    return survey.contacts[survey.pairs[energies.argmax(), 0]]


def _provenance(
    fit: PoleFit, recording_set: RecordingSet, gains: Gains, method: str, gain_table: GainTable
) -> Provenance:
    notes = fit.notes + tuple(getattr(gains, "notes", ()))
    if isinstance(gains, SinglePoint) and gain_table.range > _MAX_LEVEL_RANGE:
        note = (
            f"the levels of the takes differ by {gain_table.range:.0f} dB, and sound alone does "
            "not show whether the blows or the distances do: each take counts as loud as the "
            "loudest; a list of takes with their places keeps the levels"
        )
        notes += (note,)
    hits = len(np.unique(gain_table.hits))
    details: dict[str, object] = {
        "recordings": len(recording_set.takes),
        "hits": hits,
        "channels": int(np.bincount(gain_table.hits).max()),
        "signal_to_residual": round(fit.verdict.signal_to_residual, 2),
        "explained_by_one_strike": round(one_strike(fit), 4),
        "rank_error": _median_error(getattr(gains, "rank_errors", None), ~fit.blow),
        "blow": np.flatnonzero(fit.blow).tolist() or None,
        "vague": np.flatnonzero(fit.vague).tolist() or None,
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


def _median_error(errors: Array | None, is_object_mode: Mask) -> float | None:
    """Return the median of the finite errors of the object's modes."""
    finite_errors = np.zeros(0) if errors is None else errors[np.isfinite(errors) & is_object_mode]
    return float(np.round(np.median(finite_errors), 5)) if finite_errors.size else None


def files_read(
    recordings: Recording | Sequence[Recording], manifest: str | os.PathLike[str] | None
) -> list[str | os.PathLike[str]]:
    """Return all files that a fit reads, including the files named by a manifest or in a folder."""
    sources = [recordings]
    if isinstance(recordings, Sequence) and not isinstance(recordings, str):
        sources = recordings
    files = [source for source in (*sources, manifest) if isinstance(source, str | os.PathLike)]
    paths = [manifest_in(Path(name)) if is_folder(name) else Path(name) for name in files]
    lists = [path for path in paths if path.suffix.lower() in KINDS and is_file(path)]
    return [*files, *lists, *(file for path in lists for file in read_manifest(path).files)]
