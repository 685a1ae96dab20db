"""A strike: one short push somewhere on a body."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from struck.errors import OptionError, require_choice
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
from struck.model.arrays import checked
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
    """A short force at one contact of a body.

    Its strength is given by `impulse`, or by `striker` with `speed` or `energy`. With a striker,
    impulse and duration follow from the elastic impact (Hertz) of its head on the body, whose mass,
    inertia and material are used if the model has them. ``Strike()`` is the wooden striker at 0.5
    m/s; for a model of recordings, the strike that was recorded.

    Parameters
    ----------
    at : str, array-like or None, default None
        Contact: a point in body coordinates, m, or a name such as "top", "rim" or "vertex:120".
        None: the playing place of the body (see `ModalModel.contact`).
    impulse : float or None, default None
        Impulse, N s. Without a striker and a duration it is an ideal impulse.
    striker : str or None, default None
        Name in ``strikers.toml``: fingertip, felt, rubber, plastic, wood, brass, steel, glass.
    speed : float or None, default None
        Speed of the striker along `direction` at the first contact, m/s. Default: 0.5 with a
        striker but no impulse and no energy.
    energy : float or None, default None
        Kinetic energy of the striker at the first contact, J: speed = sqrt(2 energy / mass).
        Default striker: wood.
    direction : array-like (3,) or None, default None
        Direction of the push, of any length. None: straight into the surface.
    duration : float or None, default None
        Duration, s; 0 for an ideal impulse. None: as the striker gives.
    shape : {"half-sine", "hertz", "gaussian"}, default "half-sine"
        Form of the force over time (`struck.excitation.pulses`).
    patch : float, default 0.0
        Radius of the area of contact, m; 0 for a point.
    transient : float, default 0.0
        Level of a noise burst in the force, as a fraction of the impulse: its expected spectrum is
        white at `transient` times that of an ideal impulse. 1998 models the click of an attack,
        which modes do not explain, by a short burst of white noise; as part of the force it excites
        the modes for which the pulse is too long. It lasts as long as the pulse, but at least 1 ms,
        and fades in and out as a half-sine.
    time : float, default 0.0
        Start, s.
    seed : int, default 0
        Seed of the noise burst.

    Raises
    ------
    OptionError
        If a striker is unknown, arguments contradict each other, or a number is out of range.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "rosewood", progress=None)
    >>> soft = struck.Strike(at="middle", striker="felt", speed=1.0)
    >>> hard = struck.Strike(at="middle", striker="steel", speed=1.0)
    >>> contact = model.contact("middle")
    >>> durations = [strike.resolved(model, contact).duration for strike in (soft, hard)]
    >>> durations[0] > 5 * durations[1]
    True
    >>> struck.render(model, [soft, hard], seconds=0.5).samples.shape
    (1, 24000)
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

    @property
    def has_closed_form(self) -> bool:
        """Whether it is a half-sine at a point, which has a closed form."""
        return self.shape == "half-sine" and not self.patch and not self.transient

    def is_ideal(self, model: ModalModel) -> bool:
        """Return whether it is an impulse without duration on a model.

        Parameters
        ----------
        model : ModalModel
            Model of the body.

        Returns
        -------
        bool
            True for a duration of 0.
        """
        return not self.resolved(model, model.contact(self.at, self.direction)).duration

    def resolved(self, model: ModalModel, contact: Contact) -> Blow:
        """Compute impulse and duration of the strike on a model.

        A model without mass, or one that is held somewhere, counts as infinitely heavy, one without
        material as infinitely hard. The gains of recordings contain the recorded blow, which is the
        default there.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        contact : Contact
            Contact on the body.

        Returns
        -------
        Blow
            Impulse, N s, and duration, s.
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

    def striker_energy(self, model: ModalModel, contact: Contact) -> float | None:
        """Compute the kinetic energy of the striker at the first contact.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        contact : Contact
            Contact on the body.

        Returns
        -------
        float or None
            Energy, J; None if an impulse is given without a striker, or the strike is the one that
            was recorded.
        """
        is_recorded = not model.gains.of_surface and self.speed is None and self.energy is None
        if self.striker is None and (self.impulse is not None or is_recorded):
            return None
        striker = Striker.named(self.striker or _DEFAULT_STRIKER)
        gain = _mass_in_contact(striker, model, contact) * (1 + striker.restitution)
        return striker.mass / 2 * (self.resolved(model, contact).impulse / gain) ** 2

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Burst:
        """Begin the excitation on a model.

        The force is band-limited, so it begins `pulses.LEAD` samples before `time`.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        sample_rate : float
            Sample rate of the forces, Hz.
        start : int, default 0
            Number of the first sample; negative for a prelude.

        Returns
        -------
        Burst
            The excitation at work, which returns its pushes block by block.

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
        """Compute the band-limited force of a blow, without noise.

        Parameters
        ----------
        blow : Blow
            Impulse and duration.
        sample_rate : float
            Sample rate, Hz.

        Returns
        -------
        Samples
            The force, N.
        """
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


def _add_samples(samples_a: Samples, samples_b: Samples) -> Samples:
    first = min(samples_a.first, samples_b.first)
    force = np.zeros(max(part.first + len(part.force) for part in (samples_a, samples_b)) - first)
    for part in (samples_a, samples_b):
        offset = part.first - first
        force[offset : offset + len(part.force)] += part.force
    return Samples(first=first, force=force)


def find_rigid_mass(model: ModalModel, contact: Contact) -> float:
    """Return the mass that a body shows to a push, kg; infinite if it is held or unknown."""
    if model.supported or model.mass is None or model.centre is None or model.inertia is None:
        return np.inf
    return effective_mass(
        mass=model.mass,
        centre=model.centre,
        inertia=model.inertia,
        point=contact.point,
        direction=contact.direction,
    )


def _mass_in_contact(striker: Striker, model: ModalModel, contact: Contact) -> float:
    body = find_rigid_mass(model, contact)
    return striker.mass if np.isinf(body) else joint_mass(striker.mass, body)
