"""Bodies in space, each with its model, position, motion and excitations; scenes of bodies."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import Course3, Trajectory
from struck.ears.orientation import MovingPoint, Orientation, Turning
from struck.ears.propagation import Emitter, aside
from struck.errors import MeshError, OptionError, ScaleWarning, article, counted, rounded
from struck.excitation.excitation import Excitation, Hold
from struck.model.arrays import Array, checked, require_number, require_numbers
from struck.model.gains import ShapeGains
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.scene.gathered_notes import gather_notes

if TYPE_CHECKING:
    from struck.excitation.roughness import Finish
    from struck.scene.contacts import Contacts

Action = Excitation | Hold  # an action on a body
_EARTH = (0.0, 0.0, -9.81)
_PLAUSIBLE_SPEED = 100.0  # m/s of a striker: of a bullet rather than of a hand or a machine


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidBody:
    """Surface and mass of a silent body, which sounding bodies collide with.

    Parameters
    ----------
    geometry : Mesh or None, default None
        Surface. None: it may be touched anywhere.
    material : Material, str or None, default None
        Material, or its name as for `Material.named`. None: infinitely hard.
    mass : float or None, default None
        Mass, kg. None: it does not give way.
    centre : array-like (3,) or None, default None
        Centre of mass, m.
    inertia : array-like (3, 3) or None, default None
        Moments of inertia about the centre, kg m^2.
    plane : bool, default False
        Whether the body is all of the plane z = 0 of its coordinates, such as a floor. This changes
        only pictures: contacts define where it is touched.

    Raises
    ------
    OptionError
        If the mass is not positive, or a plane has another surface.
    MaterialError
        If the material is unknown.
    MeshError
        If the surface is inside out.

    Examples
    --------
    >>> floor = struck.scene.RigidBody(material="oak", plane=True)
    >>> struck.Body(model=floor).model.material.name
    'oak'
    """

    geometry: Mesh | None = None
    material: Material | str | None = None
    mass: float | None = None
    centre: ArrayLike | None = None
    inertia: ArrayLike | None = None
    plane: bool = False

    def __post_init__(self) -> None:
        if isinstance(self.material, str):
            object.__setattr__(self, "material", Material.named(self.material))
        if self.plane and self.geometry is not None:
            raise OptionError("plane is True, and there is a geometry: give one of the two")
        for name, shape in (("centre", (3,)), ("inertia", (3, 3))):
            value = getattr(self, name)
            if value is not None:
                array = np.array(value, np.float64)
                require_numbers(name, array, shape)
                object.__setattr__(self, name, array)
        if self.geometry is not None and self.geometry.volume < 0:
            raise MeshError(
                f"its surface encloses {rounded(self.geometry.volume, 3)} m^3: it is inside out; "
                "turn its faces round"
            )
        if self.mass is not None and not 0 < self.mass < np.inf:
            raise OptionError(f"mass is {self.mass} kg: it must exceed 0; None does not move")

    @property
    def supported(self) -> bool:
        """Whether the body is held, and does not move when it is hit."""
        return self.mass is None


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A body of a scene: its model, pose, motion and excitations.

    Parameters
    ----------
    model : ModalModel or RigidBody
        Model that sounds, or a silent body.
    excitations : excitation, Hold or sequence of them, default ()
        Excitations in the coordinates of the body and the time of the scene.
    position : array-like (3,), (times, points) or function of time, default (0, 0, 0)
        Position of the origin of the body coordinates in the scene, m.
    rotation : array-like (3, 3) or (4,), (times, quaternions) or function of time
        Rotation from the coordinates of the body to those of the scene (see `Turning`). Quaternions
        are (w, x, y, z). Default: (1, 0, 0, 0).
    roughness : str, Roughness, Profile or None, default None
        Finish of its surface for sliding and rolling. None: that of its material.
    fixed : bool, default False
        Whether the body is clamped and does not recoil from a hit.

    Raises
    ------
    OptionError
        If an excitation, the position or the rotation is not one.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> bodies = [
    ...     struck.Body(model=model, excitations=struck.Strike(time=time), position=(0.0, y, 0.0))
    ...     for time, y in ((0.0, -0.5), (0.2, 0.5))
    ... ]
    >>> sound = struck.render(bodies, seconds=1.0, listener=struck.Mono(position=(2.0, 0.0, 0.0)))
    >>> sound.samples.shape
    (1, 48000)
    """

    model: ModalModel | RigidBody
    excitations: Action | Sequence[Action] = ()
    position: Course3 = (0.0, 0.0, 0.0)
    rotation: Turning = (1.0, 0.0, 0.0, 0.0)
    roughness: str | Finish | None = None
    fixed: bool = False

    def __post_init__(self) -> None:
        _require_actions(self.actions)
        if self.actions and self.silent:
            raise OptionError(
                f"{counted(len(self.actions), 'excitation')} on a body without sound: give a "
                "ModalModel as its model, or leave them out"
            )
        Trajectory.of("position", self.position)
        Orientation.of("rotation", self.rotation)
        if self.roughness is not None:
            from struck.excitation.roughness import finish

            finish(self.roughness)

    @property
    def actions(self) -> Sequence[Action]:
        """Strikes and other excitations of the body."""
        if isinstance(self.excitations, Sequence):
            return tuple(self.excitations)
        return (self.excitations,)

    @property
    def pushed(self) -> bool:
        """Whether an excitation pushes the body, as a Hold alone does not."""
        return not all(isinstance(action, Hold) for action in self.actions)

    @property
    def silent(self) -> bool:
        """Whether the body has no model of its sound."""
        return not isinstance(self.model, ModalModel)

    @property
    def moves(self) -> bool:
        """Whether the body's place or orientation may change."""
        return self.origin.moves or self.orientation.moves

    @property
    def orientation(self) -> Orientation:
        """Orientation of the body over time."""
        return Orientation.of("rotation", self.rotation)

    @property
    def origin(self) -> Trajectory:
        """Where the origin of its coordinates is over time."""
        return Trajectory.of("position", self.position)

    @property
    def emitter(self) -> Emitter:
        """The body as a sound source: its centre, radius and surface."""
        model, surface = self.sounding, self.model.geometry
        gains = model.gains
        return Emitter(
            centre=self.carried(centre_of(self.model)),
            radius=radius_of(self.model),
            surface=gains.locator if isinstance(gains, ShapeGains) else None,
            nearest=0.0 if surface is None else min(surface.reach, radius_of(self.model)),
            field=("ears" if model.recorded else "head") if gains.directional else None,
        )

    @property
    def sounding(self) -> ModalModel:
        """Model of the body's sound; OptionError where it has none."""
        if not isinstance(self.model, ModalModel):
            raise OptionError("the body has no model of its sound: give it a ModalModel")
        if self.fixed and self.model.recoil is not None:
            return replace(self.model, recoil=None)  # a held body does not move
        return self.model

    def carried(self, point: Array) -> MovingPoint:
        """Return a point of the body as it moves through the scene.

        Parameters
        ----------
        point : array (3,)
            Point in body coordinates, m.

        Returns
        -------
        MovingPoint
            The moving point.
        """
        return MovingPoint(origin=self.origin, orientation=self.orientation, point=point)


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """Bodies by name, for the contacts of a log.

    Parameters
    ----------
    bodies : mapping of str to Body
        Bodies by name, sounding and silent ones.
    gravity : array-like (3,), default (0, 0, -9.81)
        Acceleration of gravity, m/s^2.
    notes : tuple of str, optional
        What was left out or guessed when the scene was made.
    logged : float or None, default None
        End of the log of contacts that excites the bodies, s, as set by `Events.on`: such a scene
        may be silent. None: a scene without a log.

    Raises
    ------
    OptionError
        If there are no bodies.

    Examples
    --------
    >>> from struck.scene import Contacts, RigidBody, Scene
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> bodies = {"bar": struck.Body(model=model), "floor": struck.Body(model=RigidBody())}
    >>> scene = Scene(bodies=bodies)
    >>> log = Contacts(
    ...     names=["floor", "bar"], time=[0.1], body0=[0], body1=[1],
    ...     position=[model.contact("end").point], impulse=[[0.0, 0.0, 0.02]],
    ... )  # fmt: skip
    >>> struck.render(scene, log, seconds=0.5).peak > 0
    True
    """

    bodies: Mapping[str, Body]
    gravity: ArrayLike = _EARTH
    notes: tuple[str, ...] = ()
    logged: float | None = None

    def __post_init__(self) -> None:
        invalid_names = [name for name, body in self.bodies.items() if not isinstance(body, Body)]
        if invalid_names or not self.bodies:
            kinds = [article(type(self.bodies[name]).__name__) for name in invalid_names]
            problem = f"{invalid_names[0]!r} is {kinds[0]}" if invalid_names else "none"
            raise OptionError(f"bodies: {problem}: give each name a Body(model=...)")
        gravity = np.array(self.gravity, np.float64)
        require_numbers("gravity", gravity, (3,))
        object.__setattr__(self, "bodies", MappingProxyType(dict(self.bodies)))
        object.__setattr__(self, "gravity", gravity)
        if self.logged is not None:
            require_number("logged", self.logged, 0.0, np.inf, hint="give the end of the log, s")

    def posed(self, contacts: Contacts) -> Scene:
        """Return the scene with its bodies at the poses of a log.

        Parameters
        ----------
        contacts : Contacts
            The log.

        Returns
        -------
        Scene
            The scene with moving bodies.

        Raises
        ------
        OptionError
            On names in the log that the scene does not have.
        """
        unknown_names = [name for name in contacts.names if name not in self.bodies]
        if unknown_names:
            raise OptionError(
                f"the log names {', '.join(map(repr, unknown_names[:5]))}, and the scene has "
                f"{', '.join(map(repr, self.bodies))}: give the scene a Body for each; "
                "Body(model=RigidBody()) is silent"
            )
        if contacts.poses is None:
            return self
        bodies = dict(self.bodies)
        for number, name in enumerate(contacts.names):
            times, positions, rotations = contacts.poses.of(number)
            if len(times):
                bodies[name] = replace(
                    bodies[name], position=(times, positions), rotation=(times, rotations)
                )
        return replace(self, bodies=bodies)


def with_fewer_modes(
    source: Any,  # noqa: ANN401 - a model, a body, several of them or a scene, returned as its kind
    modes: int | None,
) -> tuple[Any, tuple[str, ...]]:
    """Return models, bodies or a scene within a budget of modes each, and notes of the loss."""
    if modes is None:
        return source, ()
    from struck.perception.audibility import budgeted

    reduced_by_id: dict[int, ModalModel] = {}
    losses: list[tuple[str, str]] = []

    def reduce_modes(item: Any, name: str) -> Any:  # noqa: ANN401 - models, bodies, or what is refused
        if isinstance(item, Body):
            return replace(item, model=reduce_modes(item.model, name))
        if not isinstance(item, ModalModel):
            return item
        if id(item) not in reduced_by_id:  # bodies may share a model
            reduced_by_id[id(item)] = budgeted(item, modes)
        reduced_model = reduced_by_id[id(item)]
        losses.extend(
            (name, loss)
            for loss in reduced_model.provenance.dropped[-1:]
            if reduced_model is not item
        )
        return reduced_model

    if isinstance(source, Scene):
        reduced_bodies = {name: reduce_modes(body, name) for name, body in source.bodies.items()}
        return replace(source, bodies=reduced_bodies), gather_notes(losses)
    if isinstance(source, Sequence):
        bodies = [reduce_modes(body, f"body {n}") for n, body in enumerate(source)]
        notes = gather_notes(losses) if len(bodies) > 1 else tuple(loss for _, loss in losses)
        return bodies, notes
    return reduce_modes(source, ""), tuple(loss for _, loss in losses)


def material_of(model: ModalModel | RigidBody) -> Material | None:
    """Return the material of a body; None where it is unknown."""
    material = model.material
    return Material.named(material) if isinstance(material, str) else material


def centre_of(model: ModalModel | RigidBody) -> Array:
    """Return where a model's sound seems to come from, in its own coordinates, m (3,)."""
    return np.zeros(3) if model.centre is None else np.asarray(model.centre, np.float64)


def radius_of(model: ModalModel | RigidBody) -> float:
    """Return the radius of the ball about a model's centre that holds it, m; 0 where unknown."""
    if model.geometry is None:
        return 0.0
    return float(np.linalg.norm(model.geometry.points - centre_of(model), axis=1).max())


def away_from(model: ModalModel, positions: Array) -> Array:
    """Return how far places (K, 3) are from a model's centre, as `ShapeGains.toward` has it, m."""
    distances = np.linalg.norm(positions - centre_of(model), axis=1)
    min_distance = 0.0 if model.geometry is None else min(model.geometry.reach, radius_of(model))
    return np.maximum(distances, min_distance)


def place_beside(model: ModalModel) -> Array:
    """Return the default listener of a model, seen from its centre, m (3,)."""
    return aside(radius_of(model))


def unknowns(model: ModalModel, kinds: Iterable[type]) -> tuple[str, ...]:
    """Return warnings about kinds of excitation that a model from recordings cannot follow."""
    if not model.recorded:
        return ()
    from struck.excitation.scrape import Roll, Scrape
    from struck.excitation.strike import Strike
    from struck.excitation.touch import TouchLog

    excitation_kinds = set(kinds)
    moving = bool(excitation_kinds & {Scrape, Roll, TouchLog})
    notes = {
        "its gains hold the blow that was recorded: forces in N sound as if that had been 1 N s, "
        "and its spectrum stays in; fit it with blow= to divide it out": bool(
            excitation_kinds - {Strike, Hold}
        )
        and not (model.gains.of_surface or model.calibrated),
        "what it is made of was not recorded: all of the dent is in what touches it": moving
        and model.material is None,
        "it was recorded at one place: its timbre stays the same wherever it is touched": moving
        and not model.coordinates,
        "its modal masses were not recorded: a grip acts as on 1 kg where a mode moves most": Hold
        in excitation_kinds,
    }
    return tuple(note for note, holds in notes.items() if holds)


def unused_roughness(bodies: Sequence[Body]) -> tuple[str, ...]:
    """Return a note of roughness without use, as no log of contacts slides on the bodies."""
    text = " of a Body changes nothing here: contacts of a Scene use it; give it to Scrape or Roll"
    return tuple(f"roughness={body.roughness!r}{text}" for body in bodies if body.roughness)[:1]


def default_places(body: Body) -> tuple[str, ...]:
    """Return notes of the default place where excitations without a place touch a body."""
    model = body.model
    unplaced_actions = [action for action in body.actions if getattr(action, "at", "") is None]
    if not unplaced_actions or not isinstance(model, ModalModel):
        return ()
    contact = model.contact()
    if not contact.point.size:  # recorded at one place
        return ()
    is_unnamed = not (model.recorded or contact.name)
    location = f"{contact.place}{', where its lowest modes speak most' if is_unnamed else ''}"
    verbs = dict.fromkeys(
        _VERBS.get(type(action).__name__, "touched") for action in unplaced_actions
    )
    return tuple(f"{verb} at {location}; no place was given" for verb in verbs)


_VERBS = {"Strike": "struck", "Pluck": "plucked", "Hold": "held"}


def doubts(bodies: Sequence[Body], seconds: float | None) -> tuple[str, ...]:
    """Warn of implausible speeds and impulses; return a note of actions after the end."""
    from struck.excitation.strike import Strike

    actions = [action for body in bodies for action in body.actions]
    speeds = (action.speed for action in actions if isinstance(action, Strike))
    max_speed = max((speed or 0.0 for speed in speeds), default=0.0)
    max_velocity_change = max(map(_pushed, bodies), default=0.0)
    if max_velocity_change > _PLAUSIBLE_SPEED:
        warnings.warn(
            f"an impulse moves its body at {rounded(max_velocity_change, 3)} m/s, above "
            f"{_PLAUSIBLE_SPEED:g} m/s: impulses are given in N s, forces times the step dt",
            ScaleWarning,
            stacklevel=4,
        )
    if max_speed > _PLAUSIBLE_SPEED:
        warnings.warn(
            f"a striker's speed is {rounded(max_speed)} m/s: above {_PLAUSIBLE_SPEED:g} m/s "
            f"nothing stays elastic, as Hertz's law of the blow has it; {rounded(max_speed)} cm/s "
            f"is {rounded(max_speed / 100)}",
            ScaleWarning,
            stacklevel=4,
        )
    late_actions = [action for action in actions if _is_late(action, seconds)]
    if seconds is None or not late_actions:
        return ()
    kinds = " and ".join(sorted({type(action).__name__.lower() for action in late_actions}))
    note = (
        f"{len(late_actions)} of {len(actions)} excitations ({kinds}) begin after the end at "
        f"{rounded(seconds)} s of the sound and are left out: give more seconds, or times in s"
    )
    return (note,)


_LONGEST_BLOW = 0.1  # s; a fingertip at 0.01 m/s pushes for 0.02 s


def long_contacts(body: Body, seconds: float | None) -> tuple[str, ...]:
    """Return notes on strikes that push for longer than 0.1 s, with the option probably meant."""
    from struck.excitation.strike import Strike

    strikes = {
        (strike.striker, strike.speed, strike.impulse, strike.energy, strike.duration): strike
        for strike in body.actions
        if isinstance(strike, Strike)
    }
    notes = {}
    for strike in strikes.values():
        duration = strike.duration
        if duration is None:
            place = body.sounding.contact(strike.at, strike.direction)
            duration = strike.resolved(body.sounding, place).duration
        if duration <= _LONGEST_BLOW:
            continue
        if strike.duration is None:
            hint = "give a higher speed=, in m/s, or a lighter striker"
        elif seconds is None:
            hint = f"did you mean seconds={rounded(duration)}, the length of the sound?"
        else:
            hint = f"did you mean duration={rounded(duration / 1000)}, in s?"
        clause = f"a strike pushes for {rounded(duration, 3)} s"
        notes[f"{clause}, and blows last at most {_LONGEST_BLOW:g} s: {hint}"] = None
    return tuple(notes)


def _pushed(body: Body) -> float:
    """Return the largest change of a body's speed by one impulse, m/s."""
    mass = getattr(body.model, "mass", None)
    impulses = [getattr(action, "impulse", None) or 0.0 for action in body.actions]
    return max(impulses, default=0.0) / mass if mass else 0.0


def _is_late(action: Action, seconds: float | None) -> bool:
    start_times = getattr(action, "times", getattr(action, "time", 0.0))  # of a `TouchLog` many
    return seconds is not None and float(np.min(np.append(start_times, np.inf))) >= seconds


def without_late_holds(body: Body, seconds: float | None) -> Body:
    """Return the body without hands that come after the end, for which decays would be stepped."""
    actions = [e for e in body.actions if not (isinstance(e, Hold) and _is_late(e, seconds))]
    return body if len(actions) == len(body.actions) else replace(body, excitations=actions)


def _require_actions(actions: Sequence[object]) -> None:
    for action in actions:
        if isinstance(action, type):
            raise OptionError(f"{action.__name__} is a class: give {action.__name__}(...)")
        if not (isinstance(action, Hold) or callable(getattr(action, "begin", None))):
            raise OptionError(f"{action!r} is no excitation: give Strike(...) or several of them")
