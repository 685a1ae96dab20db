"""Restitution: how fast two bodies part, as a share of how fast they met.

By Newton's law of impact v+ = -e v-. MuJoCo has no such number: its contacts are springs with
dashpots, whose reference acceleration is -b v - k r for a depth r that grows at v. With
b = (1 + e) / dt and a weak spring the law holds within one step, whatever the masses are and
however many points touch; a stiff spring would instead take ten steps, through which thin bodies
fall, or explode. How MuJoCo's integrators and cones really follow is found by letting a ball
rebound in it.
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import combinations, permutations, product
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import OptionError, SimulationError, nearest
from struck.model.arrays import require_number
from struck.model.material import Material, materials
from struck.model.provenance import table_of
from struck.scene.engines.links import Link, touches

if TYPE_CHECKING:
    import mujoco
    from typing_extensions import TypeIs

# Of a pair of bodies by patterns of their names, of all pairs, or "materials".
PairValues = float | str | Mapping[tuple[str, str], float]
IMPEDANCE = (0.99, 0.99, 0.001, 0.5, 2.0)  # nearly rigid: the law is followed to 1 %
_RECOVERY = 0.1  # s: in which a body that rests too deep comes up
_CLOSE, _CLOSE_ENOUGH = 0.002, 0.02  # to the restitution asked for: tried for, and accepted
_TRIES = 6
_MOST_PAIRS = 20_000  # of geoms, that have a law of their own
_LEAST = 1e-5  # of MuJoCo's friction
_SPEED = 1.0  # m/s, of the ball that rebounds


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactLaw:
    """Stiffness and damping that MuJoCo's solver uses at a contact."""

    stiffness: float  # 1/s^2
    damping: float  # 1/s
    restitution: float  # of a ball that rebounds by it

    @property
    def solref(self) -> tuple[float, float]:
        """MuJoCo's direct format."""
        return -self.stiffness, -self.damping


def contact_law(restitution: float, options: mujoco.MjOption) -> ContactLaw:
    """Return the law by which a ball rebounds with some restitution, as the engine itself shows.

    Raises
    ------
    SimulationError
        Where none does, as with Runge-Kutta steps, in which four pushes make one.
    """
    asked, found, law = restitution, np.inf, None
    for _ in range(_TRIES):
        damping = (1 + asked) / options.timestep
        stiffness = damping / _RECOVERY
        found = rebound((-stiffness, -damping), IMPEDANCE, options)
        law = ContactLaw(stiffness=stiffness, damping=damping, restitution=found)
        if abs(found - restitution) < _CLOSE:
            return law
        asked += restitution - found
    if law and abs(found - restitution) < _CLOSE_ENOUGH:
        return law
    raise SimulationError(
        f"restitution is {restitution}: a ball rebounds with {found:.2f} in MuJoCo with these "
        "solver settings: set integrator to Euler or implicitfast, or leave restitution= out"
    )


def rebound(
    solref: tuple[float, float], solimp: tuple[float, ...], options: mujoco.MjOption
) -> float:
    """Return the restitution of a ball that falls on a plane, in MuJoCo with some options."""
    import mujoco

    spec = mujoco.MjSpec()
    for name in ("timestep", "integrator", "cone", "jacobian", "solver", "impratio", "iterations"):
        setattr(spec.option, name, getattr(options, name))
    spec.option.gravity = (0.0, 0.0, 0.0)
    common = {"solref": solref, "solimp": solimp}
    plane, ball = mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_SPHERE
    spec.worldbody.add_geom(type=plane, size=(1, 1, 0.1), **common)
    body = spec.worldbody.add_body(pos=(0, 0, 0.0523))
    body.add_freejoint()
    body.add_geom(type=ball, size=(0.05, 0, 0), density=1000.0, **common)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qvel[2] = -_SPEED
    touched = False
    for _ in range(int(0.5 / options.timestep) + 50):
        mujoco.mj_step(model, data)
        touched = touched or data.ncon > 0
        if touched and not data.ncon and data.qvel[2] > 0:
            break
    return max(0.0, float(data.qvel[2]) / _SPEED)


def pair_value(
    name: str,
    values: PairValues | None,
    pair: tuple[str, str],
    made_of: tuple[Material | None, Material | None],
) -> float | None:
    """Return the restitution or friction of two bodies; None where none was given."""
    if values is None:
        return None
    if isinstance(values, Mapping):
        for (one, other), value in values.items():
            if _both(pair, (one, other)) or _both(pair, (other, one)):
                return _checked(name, value)
        return None
    if not isinstance(values, str):
        return _checked(name, values)
    if values != "materials":
        raise OptionError(f'{name} is {values!r}: give a number, "materials", or one for each pair')
    first, second = made_of
    if first is None or second is None:
        return None
    return _RULES[name](first, second)


def restitution_between(first: Material, second: Material) -> float:
    """Return the restitution of two materials, the softer of which counts most (Hodgkinson 1834).

    e = (e1 E2 + e2 E1) / (E1 + E2) of the values of each on its own kind, which stand in
    ``restitution.toml`` by material or by group.
    """
    share = first.youngs_modulus / (first.youngs_modulus + second.youngs_modulus)
    own, other = (_entry(each, "restitution") for each in (first, second))
    return own * (1 - share) + other * share


def friction_between(first: Material, second: Material) -> float:
    """Return the coefficient of sliding friction: the geometric mean of both."""
    return float(np.sqrt(_entry(first, "friction") * _entry(second, "friction")))


_RULES = {"restitution": restitution_between, "friction": friction_between}


def _is_pair(given: object) -> TypeIs[tuple[str, str]]:
    """Return whether a key is two texts."""
    return isinstance(given, tuple) and [type(each) for each in given] == [str, str]


def _both(names: tuple[str, str], patterns: tuple[str, str]) -> bool:
    return all(fnmatchcase(name, each) for name, each in zip(names, patterns, strict=True))


def _checked(name: str, value: float) -> float:
    most, bound = (1.0, "0 to 1") if name == "restitution" else (10.0, "0 to 10")
    require_number(name, value, 0.0, most, hint=f"it must lie from {bound}")
    return float(value)


def _entry(material: Material, kind: str) -> float:
    """Return a material's own value, or that of its group; "other" where neither is known."""
    own = table_of("struck.scene.engines", "restitution")["material"].get(material.name, {})
    entry = materials().get(material.name)
    group = "other" if entry is None else str(entry["group"])
    return float(
        own.get(kind, table_of("struck.scene.engines", "restitution")["group"][group][kind])
    )


@dataclass(kw_only=True)
class ContactLaws:
    """Restitution and friction of the pairs of bodies, as the options give them."""

    materials: Mapping[str, Material | None]  # of each body
    restitution: PairValues | None = None
    friction: PairValues | None = None

    def __post_init__(self) -> None:
        """Refuse patterns that fit no pair of bodies."""
        for name in _RULES:
            values = getattr(self, name)
            for pair in values if isinstance(values, Mapping) else ():
                if not _is_pair(pair) or not any(
                    _both(each, pair) for each in permutations(self.materials, 2)
                ):
                    two, known = pair if _is_pair(pair) else (str(pair),), self.materials
                    wrong = [each for each in two if not any(fnmatchcase(k, each) for k in known)]
                    offer = "".join(nearest(each, known) for each in wrong)
                    raise OptionError(
                        f"{name} names {' and '.join(map(repr, two))}, which fit no two of "
                        f"{', '.join(map(repr, known))}: {offer}give two names or patterns, as "
                        "'ball*' and 'floor'"
                    )

    @property
    def any_given(self) -> bool:
        """Whether the options give any restitution or friction."""
        return self.restitution is not None or self.friction is not None

    @property
    def notes(self) -> tuple[str, ...]:
        """Note of bodies without a material, which restitution="materials" would need."""
        asked = [name for name in _RULES if getattr(self, name) == "materials"]
        lacking = [name for name, material in self.materials.items() if material is None]
        told = (
            f"{' and '.join(asked)} of pairs with {', '.join(map(repr, lacking))} stay as the file "
            f"says, for want of a material: give one by materials="
        )
        return (told,) if asked and lacking else ()

    def between(self, one: str, other: str) -> tuple[float | None, float | None]:
        """Return restitution and friction of two bodies; None where the file's own count."""
        made_of = self.materials[one], self.materials[other]
        return (
            pair_value("restitution", self.restitution, (one, other), made_of),
            pair_value("friction", self.friction, (one, other), made_of),
        )

    def give(self, spec: mujoco.MjSpec, model: mujoco.MjModel, links: Sequence[Link]) -> None:
        """Write the laws into a specification: the commonest to geoms, others to pairs of geoms."""
        touching = [[int(g) for g in link.geoms if touches(model, int(g))] for link in links]
        values = {}
        for one, other in combinations(range(len(links)), 2):
            if touching[one] and touching[other] and not links[one].fixed & links[other].fixed:
                values[one, other] = self.between(links[one].name, links[other].name)
        asked = Counter(value for value, _ in values.values() if value is not None)
        laws = {value: contact_law(value, model.opt) for value in asked}
        everywhere = len(asked) == 1 and all(value is not None for value, _ in values.values())
        common = asked.most_common(1)[0][0] if everywhere else None
        if common is not None:
            for geom in (spec.geom(model.geom(g).name) for each in touching for g in each):
                geom.solref, geom.solimp = laws[common].solref, IMPEDANCE
        made = {(p.geomname1, p.geomname2): p for p in spec.pairs}
        count = 0
        for (one, other), (bounce, friction) in values.items():
            law = None if bounce is None or bounce == common else laws[bounce]
            if law is None and friction is None:
                continue
            for first, second in product(touching[one], touching[other]):
                if _may_touch(model, first, second):
                    _pair(spec, model, made, (first, second), law or (laws.get(bounce)), friction)
                    count += 1
            if count > _MOST_PAIRS:
                raise OptionError(
                    f"more than {_MOST_PAIRS} pairs of parts have values of their own: give one "
                    'for all pairs, or convex="hull"'
                )


def _may_touch(model: mujoco.MjModel, one: int, other: int) -> bool:
    """Return whether MuJoCo lets two geoms of different bodies touch."""
    masks = (model.geom_contype[one] & model.geom_conaffinity[other]) | (
        model.geom_contype[other] & model.geom_conaffinity[one]
    )
    bodies = sorted(int(model.geom_bodyid[geom]) for geom in (one, other))
    excluded = (bodies[0] << 16) + bodies[1] in model.exclude_signature
    first, second = (int(model.body_weldid[body]) for body in bodies)
    parents = [int(model.body_weldid[model.body_parentid[each]]) for each in (first, second)]
    family = first and second and (parents[0] == second or parents[1] == first)
    return bool(masks) and not excluded and not family and first != second


def _pair(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    made: Mapping[tuple[str, str], mujoco.MjsPair],
    geoms: tuple[int, int],
    law: ContactLaw | None,
    friction: float | None,
) -> None:
    """Give two geoms a law of their own, all else as MuJoCo would mix it of theirs."""
    names = [model.geom(geom).name for geom in geoms]
    own = made.get((names[0], names[1])) or made.get((names[1], names[0]))
    if own is None:
        own = spec.add_pair(geomname1=names[0], geomname2=names[1])
        one, other = geoms
        apart = int(model.geom_priority[one]) - int(model.geom_priority[other])
        chosen = [one, other] if apart == 0 else [one if apart > 0 else other]
        own.condim = int(model.geom_condim[chosen].max())
        sliding, torsion, rolling = model.geom_friction[chosen].max(axis=0)
        own.friction = (sliding, sliding, torsion, rolling, rolling)
        own.margin = float(model.geom_margin[[one, other]].max())
        own.gap = float(model.geom_gap[[one, other]].max())
        own.solref, own.solimp = model.geom_solref[chosen[0]], model.geom_solimp[chosen[0]]
    if law is not None:
        own.solref, own.solimp = law.solref, IMPEDANCE
    if friction is not None:
        own.friction = (max(friction, _LEAST), max(friction, _LEAST), *own.friction[2:])
