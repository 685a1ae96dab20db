"""Restitution: the speed at which two bodies part over that at which they met.

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

# One value for all pairs, one for each pair of patterns of names, or "materials".
PairValues = float | str | Mapping[tuple[str, str], float]
IMPEDANCE = (0.99, 0.99, 0.001, 0.5, 2.0)  # nearly rigid: the law is followed to 1 %
_RECOVERY_SECONDS = 0.1  # s: in which a body that rests too deep comes up
_TARGET_ERROR, _MAX_ERROR = 0.002, 0.02  # of the restitution: sought, and accepted
_MAX_TRIALS = 6
_MAX_PAIRS = 20_000  # of geoms with a separate law
_MIN_FRICTION = 1e-5  # of MuJoCo's friction
_IMPACT_SPEED = 1.0  # m/s, of the ball that rebounds


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
    target, rebound_ratio, law = restitution, np.inf, None
    for _ in range(_MAX_TRIALS):
        damping = (1 + target) / options.timestep
        stiffness = damping / _RECOVERY_SECONDS
        rebound_ratio = rebound((-stiffness, -damping), IMPEDANCE, options)
        law = ContactLaw(stiffness=stiffness, damping=damping, restitution=rebound_ratio)
        if abs(rebound_ratio - restitution) < _TARGET_ERROR:
            return law
        target += restitution - rebound_ratio
    if law and abs(rebound_ratio - restitution) < _MAX_ERROR:
        return law
    raise SimulationError(
        f"restitution is {restitution}: a ball rebounds with {rebound_ratio:.2f} in MuJoCo with "
        "these solver settings: set integrator to Euler or implicitfast, or leave restitution= out"
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
    data.qvel[2] = -_IMPACT_SPEED
    has_touched = False
    for _ in range(int(0.5 / options.timestep) + 50):
        mujoco.mj_step(model, data)
        has_touched = has_touched or data.ncon > 0
        if has_touched and not data.ncon and data.qvel[2] > 0:
            break
    return max(0.0, float(data.qvel[2]) / _IMPACT_SPEED)


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
        for (pattern_a, pattern_b), value in values.items():
            if _match_both(pair, (pattern_a, pattern_b)) or _match_both(
                pair, (pattern_b, pattern_a)
            ):
                return _require_value(name, value)
        return None
    if not isinstance(values, str):
        return _require_value(name, values)
    if values != "materials":
        raise OptionError(f'{name} is {values!r}: give a number, "materials", or one for each pair')
    material_a, material_b = made_of
    if material_a is None or material_b is None:
        return None
    return _RULES[name](material_a, material_b)


def restitution_between(first: Material, second: Material) -> float:
    """Return the restitution of two materials, the softer of which counts most (Hodgkinson 1834).

    e = (e1 E2 + e2 E1) / (E1 + E2) of the values of each against the same material, which
    ``restitution.toml`` lists by material or by group.
    """
    weight = first.youngs_modulus / (first.youngs_modulus + second.youngs_modulus)
    first_value, second_value = (_entry(material, "restitution") for material in (first, second))
    return first_value * (1 - weight) + second_value * weight


def friction_between(first: Material, second: Material) -> float:
    """Return the coefficient of sliding friction: the geometric mean of both."""
    return float(np.sqrt(_entry(first, "friction") * _entry(second, "friction")))


_RULES = {"restitution": restitution_between, "friction": friction_between}


def _is_pair(key: object) -> TypeIs[tuple[str, str]]:
    """Return whether a key is two texts."""
    return isinstance(key, tuple) and [type(part) for part in key] == [str, str]


def _match_both(names: tuple[str, str], patterns: tuple[str, str]) -> bool:
    return all(fnmatchcase(name, pattern) for name, pattern in zip(names, patterns, strict=True))


def _require_value(name: str, value: float) -> float:
    max_value, bounds = (1.0, "0 to 1") if name == "restitution" else (10.0, "0 to 10")
    require_number(name, value, 0.0, max_value, hint=f"it must lie from {bounds}")
    return float(value)


def _entry(material: Material, kind: str) -> float:
    """Return a material's own value, or that of its group; "other" where neither is known."""
    values = table_of("struck.scene.engines", "restitution")["material"].get(material.name, {})
    entry = materials().get(material.name)
    group = "other" if entry is None else str(entry["group"])
    return float(
        values.get(kind, table_of("struck.scene.engines", "restitution")["group"][group][kind])
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
                    _match_both(couple, pair) for couple in permutations(self.materials, 2)
                ):
                    patterns, names = pair if _is_pair(pair) else (str(pair),), self.materials
                    unknown_patterns = [
                        pattern
                        for pattern in patterns
                        if not any(fnmatchcase(k, pattern) for k in names)
                    ]
                    suggestion = "".join(nearest(pattern, names) for pattern in unknown_patterns)
                    raise OptionError(
                        f"{name} names {' and '.join(map(repr, patterns))}, which fit no two of "
                        f"{', '.join(map(repr, names))}: {suggestion}give two names or patterns, "
                        "as 'ball*' and 'floor'"
                    )

    @property
    def has_values(self) -> bool:
        """Whether the options give any restitution or friction."""
        return self.restitution is not None or self.friction is not None

    @property
    def notes(self) -> tuple[str, ...]:
        """Note of bodies without a material, which restitution="materials" would need."""
        options = [name for name in _RULES if getattr(self, name) == "materials"]
        lacking = [name for name, material in self.materials.items() if material is None]
        note = (
            f"{' and '.join(options)} of pairs with {', '.join(map(repr, lacking))} stay as the "
            "file says, for want of a material: give one by materials="
        )
        return (note,) if options and lacking else ()

    def find_values(self, name_a: str, name_b: str) -> tuple[float | None, float | None]:
        """Return restitution and friction of two bodies; None where the file's own count."""
        made_of = self.materials[name_a], self.materials[name_b]
        return (
            pair_value("restitution", self.restitution, (name_a, name_b), made_of),
            pair_value("friction", self.friction, (name_a, name_b), made_of),
        )

    def give(self, spec: mujoco.MjSpec, model: mujoco.MjModel, links: Sequence[Link]) -> None:
        """Write the laws into a specification: the commonest to geoms, others to pairs of geoms."""
        touching = [[int(g) for g in link.geoms if touches(model, int(g))] for link in links]
        values = {}
        for link_a, link_b in combinations(range(len(links)), 2):
            if (
                touching[link_a]
                and touching[link_b]
                and not links[link_a].fixed & links[link_b].fixed
            ):
                values[link_a, link_b] = self.find_values(links[link_a].name, links[link_b].name)
        restitution_counts = Counter(value for value, _ in values.values() if value is not None)
        laws = {value: contact_law(value, model.opt) for value in restitution_counts}
        is_uniform = len(restitution_counts) == 1 and all(
            value is not None for value, _ in values.values()
        )
        common = restitution_counts.most_common(1)[0][0] if is_uniform else None
        if common is not None:
            for geom in (spec.geom(model.geom(g).name) for geoms in touching for g in geoms):
                geom.solref, geom.solimp = laws[common].solref, IMPEDANCE
        pair_specs = {(p.geomname1, p.geomname2): p for p in spec.pairs}
        count = 0
        for (link_a, link_b), (restitution, friction) in values.items():
            law = None if restitution is None or restitution == common else laws[restitution]
            if law is None and friction is None:
                continue
            for geom_a, geom_b in product(touching[link_a], touching[link_b]):
                if _may_touch(model, geom_a, geom_b):
                    _pair(
                        spec,
                        model,
                        pair_specs,
                        (geom_a, geom_b),
                        law or (laws.get(restitution)),
                        friction,
                    )
                    count += 1
            if count > _MAX_PAIRS:
                raise OptionError(
                    f"more than {_MAX_PAIRS} pairs of parts have values of their own: give one "
                    'for all pairs, or convex="hull"'
                )


def _may_touch(model: mujoco.MjModel, geom_a: int, geom_b: int) -> bool:
    """Return whether MuJoCo lets two geoms of different bodies touch."""
    collision_bits = (model.geom_contype[geom_a] & model.geom_conaffinity[geom_b]) | (
        model.geom_contype[geom_b] & model.geom_conaffinity[geom_a]
    )
    bodies = sorted(int(model.geom_bodyid[geom]) for geom in (geom_a, geom_b))
    is_excluded = (bodies[0] << 16) + bodies[1] in model.exclude_signature
    link_a, link_b = (int(model.body_weldid[body]) for body in bodies)
    parents = [int(model.body_weldid[model.body_parentid[link]]) for link in (link_a, link_b)]
    family = link_a and link_b and (parents[0] == link_b or parents[1] == link_a)
    return bool(collision_bits) and not is_excluded and not family and link_a != link_b


def _pair(
    spec: mujoco.MjSpec,
    model: mujoco.MjModel,
    pair_specs: Mapping[tuple[str, str], mujoco.MjsPair],
    geoms: tuple[int, int],
    law: ContactLaw | None,
    friction: float | None,
) -> None:
    """Give two geoms a separate law; all else is mixed from theirs as MuJoCo does."""
    names = [model.geom(geom).name for geom in geoms]
    pair = pair_specs.get((names[0], names[1])) or pair_specs.get((names[1], names[0]))
    if pair is None:
        pair = spec.add_pair(geomname1=names[0], geomname2=names[1])
        geom_a, geom_b = geoms
        priority_difference = int(model.geom_priority[geom_a]) - int(model.geom_priority[geom_b])
        chosen = (
            [geom_a, geom_b]
            if priority_difference == 0
            else [geom_a if priority_difference > 0 else geom_b]
        )
        pair.condim = int(model.geom_condim[chosen].max())
        sliding, torsion, rolling = model.geom_friction[chosen].max(axis=0)
        pair.friction = (sliding, sliding, torsion, rolling, rolling)
        pair.margin = float(model.geom_margin[[geom_a, geom_b]].max())
        pair.gap = float(model.geom_gap[[geom_a, geom_b]].max())
        pair.solref, pair.solimp = model.geom_solref[chosen[0]], model.geom_solimp[chosen[0]]
    if law is not None:
        pair.solref, pair.solimp = law.solref, IMPEDANCE
    if friction is not None:
        pair.friction = (
            max(friction, _MIN_FRICTION),
            max(friction, _MIN_FRICTION),
            *pair.friction[2:],
        )
