"""Radiation efficiency of the modes of a body, and its mean in third octaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from struck.errors import OptionError
from struck.model.air_losses import AirLosses, decays_of_pressures
from struck.model.arrays import Array, brief, checked, require_numbers
from struck.model.damping import Damping, contains_air
from struck.model.gains import Gains, ShapeGains, SkinRadiation
from struck.model.material import AIR, Air
from struck.model.third_octaves import NumberTable, ThirdOctaves

_ESTIMATE_ERROR = 9.0  # dB, the largest error of the estimate in docs, "Measured errors"


def known_losses(gains: ShapeGains) -> AirLosses:
    """Return the losses to the air of calibrated gains, of older files from their outputs."""
    if gains.losses is not None:
        return gains.losses
    sound = decays_of_pressures(np.abs(gains.outputs), air_around(gains).impedance)
    return AirLosses(
        sound=sound,
        surface=np.zeros(len(sound)),
        uncertainty=np.full(len(sound), _ESTIMATE_ERROR),
    )


def require_calibrated(gains: Gains) -> ShapeGains:
    """Return gains with which energies are known; OptionError on others."""
    if not isinstance(gains, ShapeGains) or not gains.calibrated:
        source = "relative" if isinstance(gains, ShapeGains) else "of recordings"
        raise OptionError(
            f"no energy in J and no power in W is known of this model, as its gains are {source}: "
            "analyze a body with radiation='power'"
        )
    return gains


def air_around(gains: ShapeGains) -> Air:
    """Return the air that calibrated gains were computed for."""
    return gains.radiation.air if isinstance(gains.radiation, SkinRadiation) else AIR


def external_decays(damping: Damping | None, decays: Array) -> Array:
    """Return the part of decay rates (M,) that a damping law ascribes to the support, 1/s."""
    external_rate = getattr(damping, "external", 0.0)
    return np.minimum(external_rate if np.ndim(external_rate) == 0 else 0.0, decays)


def contained_air_decays(
    damping: Damping | None, decays: Array, added_decays: Array, losses: AirLosses
) -> Array:
    """Return the part of decay rates (M,) that is loss to the air, 1/s.

    It was added to the damping law, or is contained in it.
    """
    is_in_law = damping is not None and contains_air(damping)
    air_decays = losses.total if is_in_law else added_decays
    return np.minimum(air_decays, decays - external_decays(damping, decays))


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RadiationEfficiency:
    """How strongly each mode of a body radiates into the air.

    A mode whose normal velocity has the mean square <v^2> over time and the outer surface S
    radiates the power W = rho c S sigma <v^2> (Fahy & Gardonio 2007, chapter 3). The efficiency
    sigma is 1 for a large flat surface in phase.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing frequencies, Hz.
    efficiencies : array (M,)
        Radiation efficiency sigma.
    mean_squares : array (M,)
        Mean squares of the normal mode shape over the outer surface, 1/kg.
    decays : array (M,)
        Decay rates by radiated sound, 1/s.
    fractions : array (M,)
        Fraction of all energy lost by the mode that leaves as sound, 0 to 1. It is 0 if the decay
        rates leave the air out, and estimated if the damping law contains the air.
    uncertainties : array (M,)
        Uncertainty of the radiated power, dB: within it for 19 of 20 modes.
    area : float
        Area of the outer surface, m^2.
    impedance : float
        Density times speed of sound of the air, Pa s/m.

    Examples
    --------
    >>> plate = struck.shapes.RectangularPlate(length=0.4, width=0.3, thickness=0.005)
    >>> model = struck.analyze(plate, "steel", band=(20, 6000), progress=None)
    >>> power = model.radiated_power()
    >>> bool(power.efficiencies[0] < 0.1 < 0.5 < power.efficiencies[-1])
    True
    >>> power.bands.headings[:3]
    ('third octave (Hz)', 'modes', 'radiation efficiency')
    """

    __repr__ = brief
    frequencies: Array
    efficiencies: Array
    mean_squares: Array
    decays: Array
    fractions: Array
    uncertainties: Array
    area: float
    impedance: float

    def __post_init__(self) -> None:
        modes = np.shape(self.frequencies)
        for name in ("efficiencies", "mean_squares", "decays", "fractions", "uncertainties"):
            require_numbers(name, getattr(self, name), modes, least=0)

    @classmethod
    def of(
        cls, gains: Gains, frequencies: Array, decays: Array, *, damping: Damping | None, air: Array
    ) -> RadiationEfficiency:
        """Compute the efficiencies of modes; see `ModalModel.radiated_power`.

        Parameters
        ----------
        gains : Gains
            Gains of the modes.
        frequencies : array (M,)
            Ringing frequencies, Hz.
        decays : array (M,)
            Decay rates by all losses, 1/s.
        damping : Damping or None
            Damping law of the material, which may contain the air.
        air : array (M,)
            Decay rates by the air that were added to those of the law, 1/s.

        Returns
        -------
        RadiationEfficiency
            Numbers of each mode.

        Raises
        ------
        OptionError
            If the gains are relative, or of recordings.
        """
        gains = require_calibrated(gains)
        losses = known_losses(gains)
        if not isinstance(gains.radiation, SkinRadiation):
            raise OptionError(
                f"radiation {gains.radiation.name!r} gives no outer surface: analyze the body with "
                "radiation='power'"
            )
        area, mean_squares = gains.radiation.skin_motion(gains.surface, gains.shapes, gains.centre)
        impedance = gains.radiation.air.impedance
        # At the modal velocity cos(w t) the power is the decay rate, and <v^2> half of the square.
        motions = impedance * area * mean_squares / 2
        efficiencies = np.divide(
            losses.sound, motions, out=np.zeros_like(motions), where=motions > 0
        )
        # Where decay rates contain less of the air than the estimate, both parts are reduced.
        sound_fractions = np.divide(
            losses.sound, losses.total, out=np.zeros_like(losses.sound), where=losses.total > 0
        )
        included_decays = contained_air_decays(damping, decays, air, losses) * sound_fractions
        return cls(
            frequencies=frequencies,
            efficiencies=efficiencies,
            mean_squares=mean_squares,
            decays=losses.sound,
            fractions=np.divide(
                included_decays,
                decays,
                out=np.zeros_like(included_decays),
                where=decays > 0,
            ),
            uncertainties=losses.uncertainty,
            area=area,
            impedance=impedance,
        )

    @property
    def resistances(self) -> Array:
        """Power of each mode (M,) per mean square of its normal velocity, N s/m."""
        return self.impedance * self.area * self.efficiencies

    @property
    def modes(self) -> NumberTable:
        """Table of the modes."""
        return NumberTable(
            columns={
                "frequency (Hz)": self.frequencies,
                "radiation efficiency": self.efficiencies,
                "power per squared velocity (N s/m)": self.resistances,
                "decay rate by sound (1/s)": self.decays,
                "lost as sound (%)": 100 * self.fractions,
                "uncertainty (dB)": self.uncertainties,
            }
        )

    @property
    def bands(self) -> NumberTable:
        """Table of the third octaves, in which all modes of a band have the same energy."""
        bands = ThirdOctaves.of(self.frequencies)
        efficiencies = bands.means(self.efficiencies, self.mean_squares)
        counts = bands.counts
        return NumberTable(
            columns={
                "third octave (Hz)": bands.nominal_centres,
                "modes": counts,
                "radiation efficiency": efficiencies,
                "power per squared velocity (N s/m)": self.impedance * self.area * efficiencies,
                "decay rate by sound (1/s)": bands.means(self.decays, np.ones_like(self.decays)),
                "lost as sound (%)": 100
                * bands.means(self.fractions, np.ones_like(self.fractions)),
            }
        )

    def __str__(self) -> str:
        return str(self.bands)

    def _repr_html_(self) -> str:
        return self.bands._repr_html_()
