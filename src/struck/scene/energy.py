"""Energy balance of excited bodies: from the striker through the modes to material and air."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from struck.errors import OptionError, counted, rounded
from struck.excitation.excitation import Excitation, Hold, Push, Pushing, drive
from struck.excitation.strike import Strike
from struck.model.air_losses import AirLosses
from struck.model.arrays import (
    Array,
    Complex,
    Mask,
    brief,
    checked,
    require_number,
    require_numbers,
)
from struck.model.damping import contains_air
from struck.model.gains import ShapeGains
from struck.model.material import AIR
from struck.model.model import ModalModel
from struck.model.radiation_efficiency import (
    air_around,
    contained_air_decays,
    external_decays,
    known_losses,
    require_calibrated,
)
from struck.model.recoil import Recoil
from struck.model.third_octaves import NumberTable, ThirdOctaves
from struck.scene.body import Action, Body
from struck.scene.strike_energy import recoil_energy
from struck.synth.mode_energy import (
    ModeEnergies,
    SampledModes,
    SampledMotion,
    energies_of_pulses,
)
from struck.synth.poles import Poles
from struck.synth.ring_down import Pulse, below_nyquist

_BLOCK = 128  # samples in which the drive of a moving contact changes linearly, as in `render`
_BATCH_BLOCKS = 64  # blocks that are advanced together, so that memory does not grow
_LONGEST_PUSH = 60.0  # s, as in `render`: the longest excitation if no length is given
_LISTED_MODES = 12  # modes of a table as text, those that radiate most
_FAR_DISTANCE = 1e3  # radii: distance at which directions are compared
_DIRECTIONS = 200  # over a sphere, for the phase of a timbre field
_REQUIRED_PARTS = (
    "material",
    "sound",
)  # entries of a text that are listed even if they are 0
_PARTS = ("material", "support", "hold", "surface", "sound")


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Energy:
    """Energy that excitations put into the modes of a body, and where it goes.

    `entered` is the sum of `material`, `support`, `hold`, `surface` and `sound`. `radiated` is the
    energy in the rendered sound, which differs from `sound` while a force acts: its acceleration
    radiates as well, as that of the recoil does, and is not taken from the vibration.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing frequencies of the modes, Hz.
    entered : array (M,)
        Work of the forces on each mode, J.
    material : array (M,)
        Loss in the material, J.
    support : array (M,)
        Loss in the support, the `external` part of the damping law, J.
    hold : array (M,)
        Loss in hands that hold the body, J.
    surface : array (M,)
        Loss to the air by friction and heat on the surface, J.
    sound : array (M,)
        Loss to the air by sound, J.
    radiated : array (M,)
        Energy in the rendered sound of each mode alone, over all directions, J.
    modes_sound : float
        Energy in the rendered sound of all modes together, J. It is the sum of `radiated` unless
        resonances overlap, as the pressures of modes add.
    recoil : float
        Energy of the motion of a free body as a whole, at rest before each strike, J.
    recoil_sound : float
        Energy in the rendered sound of that motion, J.
    striker : float or None
        Kinetic energy of the strikers, J; None if one is unknown.
    notes : tuple of str, default ()
        What the energies leave out or rest upon.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> energy = struck.energy(model, struck.Strike(at="end", striker="wood", speed=1.0))
    >>> energy.total["entered"] < energy.striker
    True
    >>> losses = energy.material + energy.support + energy.hold + energy.surface + energy.sound
    >>> np.allclose(losses, energy.entered)
    True
    """

    __repr__ = brief
    frequencies: Array
    entered: Array
    material: Array
    support: Array
    hold: Array
    surface: Array
    sound: Array
    radiated: Array
    modes_sound: float
    recoil: float
    recoil_sound: float
    striker: float | None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = np.shape(self.frequencies)
        for name in ("frequencies", "entered", *_PARTS):
            require_numbers(name, getattr(self, name), shape)
        # Infinite of a mode without losses.
        require_numbers("radiated", self.radiated, shape, least=0, gaps=True)

    @property
    def total(self) -> dict[str, float]:
        """Sums over the modes by the name of the entry, J."""
        return {
            name: float(np.sum(getattr(self, name))) for name in ("entered", *_PARTS, "radiated")
        }

    @property
    def modes(self) -> NumberTable:
        """Table of the modes."""
        columns = {f"{name} (J)": getattr(self, name) for name in ("entered", *_PARTS, "radiated")}
        return NumberTable(columns={"frequency (Hz)": self.frequencies} | columns)

    @property
    def bands(self) -> NumberTable:
        """Table of the third octaves, with the sums over their modes."""
        bands = ThirdOctaves.of(self.frequencies)
        columns = {
            f"{name} (J)": bands.sums(getattr(self, name))
            for name in ("entered", *_PARTS, "radiated")
        }
        return NumberTable(
            columns={"third octave (Hz)": bands.nominal_centres, "modes": bands.counts} | columns
        )

    @property
    def lines(self) -> list[str]:
        """Totals and notes as lines of text."""
        total = self.total
        rows = [("striker", "unknown" if self.striker is None else _joules(self.striker))]
        rows.append(("entered the modes", _joules(total["entered"])))
        rows += [
            (f"  {name}", f"{_joules(total[name])}{_percentage(total[name], total['entered'])}")
            for name in _PARTS
            if total[name] or name in _REQUIRED_PARTS
        ]
        rows.append(("radiated by the modes", _joules(self.modes_sound)))
        rows.append(("recoil", _joules(self.recoil)))
        rows.append(("radiated by the recoil", _joules(self.recoil_sound)))
        width = max(len(name) for name, _ in rows)
        return [f"{name.ljust(width)}  {text}" for name, text in rows] + [
            f"note: {note}" for note in self.notes
        ]

    def __str__(self) -> str:
        loudest_modes = np.sort(np.argsort(-self.radiated, kind="stable")[:_LISTED_MODES])
        columns = self.modes.columns
        table_columns = {
            name: column[loudest_modes] for name, column in columns.items() if column.any()
        }
        table = NumberTable(columns=table_columns)
        hidden_count = len(self.frequencies) - len(loudest_modes)
        remark = [f"... and {counted(hidden_count, 'mode')} that radiate less"] * (hidden_count > 0)
        return "\n".join([*self.lines, "", str(table), *remark])

    def _repr_html_(self) -> str:
        from html import escape

        lines = "<br>".join(escape(line) for line in self.lines)
        return f"<p>{lines}</p>{self.modes._repr_html_()}"


@checked
def energy(
    model: ModalModel,
    excitations: Action | Sequence[Action],
    *,
    seconds: float | None = None,
    sample_rate: int = 48000,
) -> Energy:
    """Compute the energy that excitations put into a body, and where it goes.

    The body rings until it is at rest, whatever the length of a rendered sound. Strikes that are
    half-sines are computed in closed form, all other excitations from the sampled forces that
    `render` uses.

    Parameters
    ----------
    model : ModalModel
        Model with mode shapes and calibrated radiation, as `struck.analyze` computes it.
    excitations : Strike, Scrape, Roll, Pluck, ForceTrack, Hold or sequence of them
        What touches the body.
    seconds : float, optional
        Time at which forces end, s. Default: when the excitations end, at most after 60 s.
    sample_rate : int, default 48000
        Sample rate of forces, Hz. Modes at or above half of it get no energy, as in `render`.

    Returns
    -------
    Energy
        Energies in J, mode by mode and in total.

    Raises
    ------
    OptionError
        If the model was recorded or its gains are relative, so that no energy is known, if nothing
        pushes the body, or if an excitation does not end and `seconds` is not given.
    ContactError
        If a contact is not on the body.

    Examples
    --------
    >>> plate = struck.shapes.RectangularPlate(length=0.3, width=0.2, thickness=0.002)
    >>> model = struck.analyze(plate, "aluminium", band=(20, 6000), progress=None)
    >>> energy = struck.energy(model, struck.Strike(impulse=0.005, duration=1e-4))
    >>> bool(energy.sound.sum() < energy.entered.sum())
    True
    >>> print(energy.lines[0])
    striker                 unknown

    In third octaves, saved as a table:

    >>> struck.files.save_table(energy.bands, "bands.csv")
    """
    gains = require_calibrated(model.gains)
    require_number("sample_rate", sample_rate, 8000, 1e6, whole=True, hint="give Hz, as 48000")
    if seconds is not None:
        require_number("seconds", seconds, 0, 3600, above=True, hint="it must lie above 0")
    actions = [
        action
        for action in Body(model=model, excitations=excitations).actions
        if seconds is None or not getattr(action, "time", 0.0) >= seconds
    ]
    if all(isinstance(action, Hold) for action in actions):
        raise OptionError("nothing pushes the body: give at least one strike")
    audible_mask = below_nyquist(model.frequencies, sample_rate)
    outputs = _outputs(gains)
    strikes = [action for action in actions if isinstance(action, Strike)]
    contacts = [model.contact(strike.at, strike.direction) for strike in strikes]
    blows = [
        strike.resolved(model, contact) for strike, contact in zip(strikes, contacts, strict=True)
    ]
    # Forces that `seconds` cuts off have no closed form.
    last_release = max(
        (strike.time + blow.duration for strike, blow in zip(strikes, blows, strict=True)),
        default=0.0,
    )
    is_whole = seconds is None or last_release <= seconds
    if (
        is_whole
        and len(strikes) == len(actions)
        and all(strike.has_closed_form for strike in strikes)
    ):
        part, recoil_sound = _energies_of_strikes(
            model, strikes, audible_mask, sample_rate, outputs[:, audible_mask]
        )
    else:
        part, recoil_sound = _energies_of_forces(
            model, actions, audible_mask, seconds, sample_rate, outputs[:, audible_mask]
        )
    energies = _fill_modes(part, audible_mask)
    air_losses = known_losses(gains)
    rates, notes = _rates(model, air_losses)
    total_rates = np.sum(list(rates.values()), axis=0)
    ordinary_losses = energies.inputs - energies.hold_losses
    losses = {
        name: ordinary_losses
        * np.divide(rate, total_rates, out=np.zeros_like(rate), where=total_rates > 0)
        for name, rate in rates.items()
    }
    recoil = sum(
        recoil_energy(model, contact, blow) for contact, blow in zip(contacts, blows, strict=True)
    )
    optional_energies = [
        strike.striker_energy(model, contact)
        for strike, contact in zip(strikes, contacts, strict=True)
    ]
    striker_energies = [value for value in optional_energies if value is not None]
    is_complete = len(striker_energies) == sum(not isinstance(action, Hold) for action in actions)
    return Energy(
        frequencies=model.frequencies,
        entered=energies.inputs,
        hold=energies.hold_losses,
        **losses,
        radiated=energies.radiated_energies(air_losses.sound, _coherences(outputs)),
        modes_sound=4 * np.pi / air_around(gains).impedance * part.sound_integral,
        recoil=float(recoil),
        recoil_sound=recoil_sound,
        striker=sum(striker_energies) if is_complete else None,
        notes=notes + _notes(model, actions, audible_mask, sample_rate),
    )


def _joules(value: float) -> str:
    return f"{rounded(value, 3)} J"


def _percentage(part: float, sum_energy: float) -> str:
    return f" ({100 * part / sum_energy:.1f} %)" if sum_energy else ""


def _rates(model: ModalModel, losses: AirLosses) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Return the decay rate (M,) by each loss, 1/s, and notes of what they rest upon."""
    law = None if model.material is None else model.material.damping
    support, notes = external_decays(law, model.decays), ()
    air = contained_air_decays(law, model.decays, model.air_decays, losses)
    if law is not None and contains_air(law):
        count = int(np.count_nonzero(air < losses.total))
        text = "the damping law contains the air: the material's part is what remains of it"
        notes = (f"{text}, nothing in {counted(count, 'mode')}" if count else text,)
    elif len(model.decays) and not model.air_decays.any():
        notes = ("decay rates leave the air out: the sound takes no energy from the modes",)
    fractions = np.divide(air, losses.total, out=np.zeros_like(air), where=losses.total > 0)
    rates = {
        "material": model.decays - support - air,
        "support": support,
        "surface": losses.surface * fractions,
        "sound": losses.sound * fractions,
    }
    return rates, notes


def _notes(
    model: ModalModel, actions: Sequence[Action], audible_mask: Mask, sample_rate: int
) -> tuple[str, ...]:
    """Return notes of what the energies leave out."""
    notes = []
    if not audible_mask.all():
        count = counted(np.count_nonzero(~audible_mask), "mode")
        notes.append(f"{count} at or above {rounded(sample_rate / 2)} Hz left out")
    if undamped_count := np.count_nonzero(model.decays == 0):
        notes.append(f"{counted(undamped_count, 'mode')} without losses keep what entered")
    other_kinds = {type(action).__name__ for action in actions} - {"Strike", "Hold"}
    if other_kinds and not model.supported:
        kinds = " and ".join(sorted(other_kinds)).lower()
        notes.append(f"the motion of the body as a whole by {kinds} is not counted")
    fluid = model.provenance.details.get("fluid")
    if fluid is not None and not model.supported:
        notes.append(f"the motion of the body as a whole leaves out the mass of the {fluid}")
    return tuple(notes)


def _outputs(gains: ShapeGains) -> Complex:
    """Return the outputs of the modes at 1 m (D, M), in directions all around or in one of them."""
    directions = np.eye(3)[:1]
    if gains.directional:
        # A spiral of equal areas (Gonzalez 2010, doi:10.1007/s11004-009-9257-x).
        heights = 1 - (2 * np.arange(_DIRECTIONS) + 1) / _DIRECTIONS
        angles = np.pi * (3 - np.sqrt(5)) * np.arange(_DIRECTIONS)
        radii = np.sqrt(1 - np.square(heights))
        directions = np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=1)
    distance = _FAR_DISTANCE * gains.radius
    return distance * gains.toward(gains.centre + distance * directions)[:, 0]


def _coherences(outputs: Complex) -> Complex:
    """Return the mean over directions of g^2 of each mode (M,), divided by that of |g|^2."""
    squares = np.square(outputs).mean(axis=0)
    powers = np.square(np.abs(outputs)).mean(axis=0)
    return np.divide(squares, powers, out=np.zeros_like(squares), where=powers > 0)


def _fill_modes(part: ModeEnergies, audible_mask: Mask) -> ModeEnergies:
    """Return the energies of all modes, of which `part` holds the selected ones."""
    energies = ModeEnergies.none(len(audible_mask))
    for name in ("inputs", "powers", "squares", "hold_losses"):
        getattr(energies, name)[audible_mask] = getattr(part, name)
    return energies


def _energies_of_strikes(
    model: ModalModel,
    strikes: Sequence[Strike],
    audible_mask: Mask,
    sample_rate: int,
    outputs: Complex,
) -> tuple[ModeEnergies, float]:
    """Return the energies of the selected modes after plain strikes, and of the recoil."""
    pulses, recoil_sound = [], _RecoilSound(model.recoil, sample_rate)
    for strike in sorted(strikes, key=lambda strike: strike.time):
        contact = model.contact(strike.at, strike.direction)
        blow = strike.resolved(model, contact)
        drives = drive(model, contact)
        gains = blow.impulse * drives[: len(audible_mask)][audible_mask]
        pulses.append(Pulse(gains=gains.astype(complex), onset=strike.time, duration=blow.duration))
        if model.recoil is not None:
            samples = strike.pulse(blow, sample_rate)
            recoil_sound.add(samples.first, np.outer(samples.force, drives[len(audible_mask) :]))
    poles = -model.decays[audible_mask] + 2j * np.pi * model.frequencies[audible_mask]
    return energies_of_pulses(poles, pulses, outputs), recoil_sound.energy()


def _energies_of_forces(
    model: ModalModel,
    actions: Sequence[Action],
    audible_mask: Mask,
    seconds: float | None,
    sample_rate: int,
    outputs: Complex,
) -> tuple[ModeEnergies, float]:
    """Return the energies of the selected modes under sampled forces, and of the recoil."""
    holds = [action for action in actions if isinstance(action, Hold)]
    excitations = [action for action in actions if not isinstance(action, Hold)]
    rises = [grip.raised(model)[audible_mask] for grip in holds]
    poles = Poles.of(model, sample_rate).values[: len(audible_mask)][audible_mask]
    modes = SampledModes(poles, sample_rate, outputs)
    recoil_sound = _RecoilSound(model.recoil, sample_rate)
    ideal_voices = {
        n for n, e in enumerate(excitations) if isinstance(e, Strike) and e.is_ideal(model)
    }
    active_holds: tuple[bool, ...] = (False,) * len(holds)
    batch: list[tuple[Array, Array]] = []
    idle_blocks = 0

    def flush_batch() -> None:
        nonlocal idle_blocks
        if batch:
            forces, ideal_forces = (np.concatenate(part) for part in zip(*batch, strict=True))
            modes.advance(
                forces[:, : len(audible_mask)][:, audible_mask], ideal_forces[:, audible_mask]
            )
            batch.clear()
        if idle_blocks:
            modes.rest(idle_blocks * _BLOCK)
            idle_blocks = 0

    for first, voice_forces in _blocks(model, excitations, holds, seconds, sample_rate):
        new_active_holds = tuple(grip.holds_at(first / sample_rate) for grip in holds)
        if new_active_holds != active_holds:
            flush_batch()
            active_rises = [
                rise for rise, is_on in zip(rises, new_active_holds, strict=True) if is_on
            ]
            modes.take(poles - np.sum([np.zeros(len(poles)), *active_rises], axis=0))
            active_holds = new_active_holds
        if not voice_forces:
            if batch:
                flush_batch()
            idle_blocks += 1
            continue
        if idle_blocks or len(batch) == _BATCH_BLOCKS:
            flush_batch()
        forces = sum(push for _, push in voice_forces)
        ideal_forces = sum(
            push[:, : len(audible_mask)] * (voice in ideal_voices) for voice, push in voice_forces
        )
        batch.append((np.asarray(forces), np.asarray(ideal_forces)))
        if model.recoil is not None:
            recoil_sound.add(first, np.asarray(forces)[:, len(audible_mask) :])
    flush_batch()
    modes.rest(np.inf)
    return modes.energies, recoil_sound.energy()


def _blocks(
    model: ModalModel,
    excitations: Sequence[Excitation],
    holds: Sequence[Hold],
    seconds: float | None,
    sample_rate: int,
) -> Iterator[tuple[int, list[tuple[int, Array]]]]:
    """Yield the first sample of each block, and the voices with their modal forces (block, N)."""
    first = -_BLOCK
    pushings: list[Pushing | None] = [
        excitation.begin(model, sample_rate, start=first) for excitation in excitations
    ]
    last_changes = [grip.time + (grip.seconds or 0.0) for grip in holds]
    end = np.inf if seconds is None else seconds * sample_rate
    last_drives: dict[int, Array] = {}
    ramp = (np.arange(1, _BLOCK + 1) / _BLOCK)[:, None]
    while first < end and (
        any(p is not None for p in pushings)
        or first <= max(last_changes, default=-1) * sample_rate + _BLOCK
    ):
        if seconds is None and first > _LONGEST_PUSH * sample_rate:
            raise OptionError(
                f"an excitation has not ended after {_LONGEST_PUSH:g} s: give its end with seconds="
            )
        voice_forces, drives = [], {}
        for voice, pushing in enumerate(pushings):
            push: Push | None = None if pushing is None else pushing.advance(_BLOCK)
            if push is not None:
                last_drive = last_drives.get(voice, push.drive)
                courses = last_drive + ramp * (push.drive - last_drive)
                drives[voice] = push.drive
                voice_forces.append((voice, push.force[:, None] * courses))
            if pushing is not None and pushing.finished:
                pushings[voice] = None
        last_drives = drives
        yield first, voice_forces
        first += _BLOCK


class _RecoilSound:
    """Energy in the sound of the recoil, as resonators make it from sampled forces."""

    def __init__(self, recoil: Recoil | None, sample_rate: int) -> None:
        self._recoil, self._rate, self._sum = recoil, sample_rate, 0.0
        self._parts: list[tuple[int, Array]] = []

    def add(self, first: int, forces: Array) -> None:
        """Add forces on the three axes (n, 3) from a sample number on, later ones later."""
        self._parts.append((first, forces))

    def energy(self) -> float:
        """Return the energy over all directions, J."""
        if self._recoil is None or not self._parts:
            return 0.0
        motion = SampledMotion(self._recoil.poles(self._rate), self._rate)
        outputs = self._recoil.outputs(self._rate)
        tail = self._recoil.answers(self._rate, int(self._rate)).shape[1]
        for forces in _join_parts(self._parts, tail):
            motion.states[:] = 0
            states = motion.advance(np.concatenate([forces, np.zeros((tail, 3))]))
            states[: len(forces)] -= motion.steady_states * forces
            self._sum += float(np.square(np.imag(states @ outputs)).sum()) / self._rate
        return 4 * np.pi / AIR.impedance * self._sum


def _join_parts(parts: Sequence[tuple[int, Array]], gap: int) -> Iterator[Array]:
    """Yield forces (n, 3) of parts that are less than `gap` samples apart together."""
    start, end, group = 0, 0, list[tuple[int, Array]]()
    for first, forces in sorted(parts, key=lambda part: part[0]):
        if group and first > end + gap:
            yield _add_forces(group, start, end)
            group = []
        if not group:
            start, end = first, first
        end = max(end, first + len(forces))
        group.append((first, forces))
    if group:
        yield _add_forces(group, start, end)


def _add_forces(group: Sequence[tuple[int, Array]], start: int, end: int) -> Array:
    """Return the sum of forces (n, 3) at their sample numbers, from `start` to `end`."""
    force_sums = np.zeros((end - start, 3))
    for first, forces in group:
        force_sums[first - start : first - start + len(forces)] += forces
    return force_sums
