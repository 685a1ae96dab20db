"""A strike: one short push somewhere on a body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from struck.errors import OptionError, require_choice, rounded
from struck.excitation.excitation import (
    Burst,
    freeze_place,
    require_at_least_zero,
    require_positive,
)
from struck.excitation.hertz import (
    Striker,
    contact_modulus,
    contact_time,
    effective_mass,
    joint_mass,
)
from struck.excitation.pulses import SPECTRA, Samples, sampled
from struck.model.arrays import Array, checked
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

_DEFAULT_STRIKER = "wood"
_DEFAULT_SPEED = 0.5
_MIN_TRANSIENT_SECONDS = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Blow:
    """Impulse and duration of a strike on one body."""

    impulse: float  # area of the force, N s
    duration: float  # s; 0 is an ideal impulse


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Strike:
    """A short push at one place of a body.

    How hard is said by `impulse`, or by `striker` with `speed` or `energy`. With a striker the
    others and the duration follow from elastic impact (Hertz) between its head and the body, whose
    own mass, inertia and material count where the model knows them. A bare ``Strike()`` is the
    wooden striker at 0.5 m/s; of a model of recordings, the blow that was recorded.

    Parameters
    ----------
    at : array-like, str or None
        Place in body coordinates, m, or its name ("top", "rim", "vertex:120"); None takes
        the body's playing place: the rim of a bell, bowl or glass, the end of a tube, else the
        place that speaks most of the lowest modes (`ModalModel.contact`).
    impulse : float or None
        N s. Without a striker and a duration it acts in no time.
    striker : str or None
        Name in ``strikers.toml``: fingertip, felt, rubber, plastic, wood, brass, steel, glass.
    speed : float or None
        Speed of the striker along `direction` at the first touch, m/s; 0.5 when a striker comes
        with neither impulse, energy nor speed.
    energy : float or None
        Kinetic energy of the striker at the first touch, J: speed = sqrt(2 energy / mass). The
        striker is the wooden one unless given.
    direction : array-like (3,) or None
        Which way it pushes, of any length; None is straight into the surface.
    duration : float or None
        How long it pushes, s; 0 is an ideal impulse, None leaves it to the striker.
    shape : str
        Of the force over time: "half-sine", "hertz" or "gaussian" (`struck.excitation.pulses`).
    patch : float
        Radius of the area of contact, m; 0 is a point.
    transient : float
        Level of a noise burst in the force, as a share of the impulse: its expected spectrum is
        white at `transient` times that of the impulse acting in no time. 1998 models the click of
        an attack, which modes do not explain, by a short burst of white noise; as part of the
        force it wakes the modes that the pulse is too long for. It lasts as long as the pulse, but
        at least 1 ms, and fades in and out as a half-sine.
    time : float
        When it begins, s.
    seed : int
        Of the noise burst.

    Raises
    ------
    OptionError
        On an unknown striker, contradictory arguments, or a number outside its bound.
    """

    at: Place = None
    impulse: float | None = None
    striker: str | None = None
    speed: float | None = None
    energy: float | None = None
    direction: Place = None
    duration: float | None = None
    shape: str = "half-sine"
    patch: float = 0.0
    transient: float = 0.0
    time: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        freeze_place(self, "direction")
        if self.striker is not None:
            Striker.named(self.striker)
        require_choice("shape", self.shape, SPECTRA)
        self._require_one_strength()
        require_positive(impulse=self.impulse, speed=self.speed, energy=self.energy)
        require_at_least_zero(
            duration=self.duration,
            patch=self.patch,
            transient=self.transient,
            time=self.time,
            seed=self.seed,
        )

    def _require_one_strength(self) -> None:
        values = {
            f"impulse is {self.impulse} N s": self.impulse,
            f"speed is {self.speed} m/s": self.speed,
            f"energy is {self.energy} J": self.energy,
        }
        strengths = [text for text, value in values.items() if value is not None]
        if len(strengths) > 1:
            raise OptionError(
                f"{' and '.join(strengths)}: each follows from the other, so give one of them"
            )
        if self.speed is not None and self.striker is None:
            raise OptionError(
                f"speed is {self.speed} m/s, but of what? add a striker, such as "
                f"striker={_DEFAULT_STRIKER!r}, or give impulse= in N s instead"
            )

    def resolved(self, model: ModalModel, contact: Contact) -> Blow:
        """Return the blow that a model receives at a contact.

        A model without mass, or held somewhere, counts as heavy, one without material as hard. The
        gains of recordings include the recorded blow: if the strike gives no strength, it is that
        blow.
        """
        options = (self.impulse, self.striker, self.speed, self.energy, self.duration)
        if not (any(option is not None for option in options) or model.gains.of_surface):
            return Blow(impulse=1.0, duration=0.0)
        if self.impulse is not None and (self.striker is None or self.duration is not None):
            return Blow(impulse=self.impulse, duration=self.duration or 0.0)
        striker = Striker.named(self.striker or _DEFAULT_STRIKER)
        mass = _mass_in_contact(striker, model, contact)
        gain = mass * (1 + striker.restitution)
        speed = self.speed or _DEFAULT_SPEED
        if self.impulse is not None:
            speed = self.impulse / gain
        elif self.energy is not None:
            speed = float(np.sqrt(2 * self.energy / striker.mass))
        duration = self.duration
        if duration is None:
            solids = (striker,) if model.material is None else (striker, model.material)
            modulus = contact_modulus(*solids)
            duration = contact_time(mass=mass, radius=striker.radius, modulus=modulus, speed=speed)
        return Blow(impulse=gain * speed, duration=duration)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Burst:
        """Begin on a model at sample number `start`; see `struck.excitation.excitation`.

        The force is band-limited, so it begins `pulses.LEAD` samples before `time`.

        Raises
        ------
        ContactError
            When it touches no body.
        OptionError
            When the model's gains are no product of contact and listener, or not finite.
        """
        require_positive(sample_rate=sample_rate)
        contact = model.contact(self.at, self.direction)
        blow = self.resolved(model, contact)
        pulse = self.pulse(blow, sample_rate)
        if self.transient:
            noise = self._noise(blow, sample_rate)
            pulse = _add_samples(pulse, Samples(first=round(self.time * sample_rate), force=noise))
        return Burst.at(contact, pulse, model, patch=self.patch, start=start)

    def pulse(self, blow: Blow, sample_rate: float) -> Samples:
        """Return the band-limited force of a `blow`, N, at a `sample_rate`, Hz, without noise."""
        return sampled(
            self.shape,
            impulse=blow.impulse,
            onset=self.time,
            duration=blow.duration,
            sample_rate=sample_rate,
        )

    def _noise(self, blow: Blow, sample_rate: float) -> np.ndarray:
        length = max(blow.duration, _MIN_TRANSIENT_SECONDS) * sample_rate
        window = np.sin(np.pi * (np.arange(max(1, round(length))) + 0.5) / max(1, round(length)))
        noise = np.random.default_rng(int(self.seed)).standard_normal(len(window))
        strength = self.transient * blow.impulse * sample_rate
        return strength * noise * window / np.linalg.norm(window)


def after_attack(strike: Strike, model: ModalModel) -> Strike:
    """Return the strike as its modes feel it: later by the attack that leads up to them."""
    lead_seconds = 0.0 if model.residual is None else model.residual.lead
    return replace(strike, time=strike.time + lead_seconds) if lead_seconds else strike


def residual_of(strike: Strike, model: ModalModel, sample_rate: float) -> Samples | None:
    """Return the residual sound of a strike on a recorded model at 1 m; None without one."""
    if model.residual is None:
        return None
    blow = strike.resolved(model, model.contact(strike.at, strike.direction))
    samples = model.residual.samples(round(sample_rate), int(strike.seed))
    if not blow.duration:
        return Samples(first=round(strike.time * sample_rate), force=blow.impulse * samples)
    # A longer push than the recorded one takes its treble off, as it does with the modes.
    pulse = strike.pulse(blow, sample_rate)
    from scipy.signal import oaconvolve

    convolved_samples = np.asarray(oaconvolve(samples, pulse.force), np.float64) / sample_rate
    return Samples(first=pulse.first, force=convolved_samples)


def note_yielding(
    strikes: Sequence[Strike],
    blows: Sequence[Blow],
    contacts: Sequence[Contact],
    model: ModalModel,
    drives: Array,
) -> str:
    """Return a note of blows that bring less energy than they leave in the modes.

    `drives` (K, M), kg^-1/2, are those of the modes at each contact. Hertz's blow meets a rigid
    body; a light one yields while it is touched, and takes less.
    """
    energy_ratios = [0.0]
    for strike, blow, contact, drive in zip(strikes, blows, contacts, drives, strict=True):
        if strike.striker is None and strike.impulse is not None:
            continue
        striker = Striker.named(strike.striker or _DEFAULT_STRIKER)
        gain = _mass_in_contact(striker, model, contact) * (1 + striker.restitution)
        striker_energy = striker.mass * (blow.impulse / gain) ** 2
        mode_amplitudes = (
            blow.impulse * SPECTRA[strike.shape](model.frequencies * blow.duration) * drive
        )
        energy_ratios.append(float(np.vdot(mode_amplitudes, mode_amplitudes)) / striker_energy)
    max_ratio, count = max(energy_ratios), sum(ratio > 1 for ratio in energy_ratios)
    note = (
        f"{count} of {len(strikes)} strikes leave up to {rounded(max_ratio, 2)} times the "
        "striker's energy in the modes: the body is too light to stay at rest under the blow, and "
        f"would sound at least {10 * np.log10(max(max_ratio, 1.0)):.1f} dB softer; take a lighter "
        "or a softer striker"
    )
    return note if count else ""


def _add_samples(samples_a: Samples, samples_b: Samples) -> Samples:
    first = min(samples_a.first, samples_b.first)
    force = np.zeros(max(part.first + len(part.force) for part in (samples_a, samples_b)) - first)
    for part in (samples_a, samples_b):
        offset = part.first - first
        force[offset : offset + len(part.force)] += part.force
    return Samples(first=first, force=force)


def _mass_in_contact(striker: Striker, model: ModalModel, contact: Contact) -> float:
    if model.supported or model.mass is None or model.centre is None or model.inertia is None:
        return striker.mass
    body = effective_mass(
        mass=model.mass,
        centre=model.centre,
        inertia=model.inertia,
        point=contact.point,
        direction=contact.direction,
    )
    return joint_mass(striker.mass, body)
