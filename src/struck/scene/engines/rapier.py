"""Rapier: the bodies of a scene file moved by another engine, with the same log.

MuJoCo reads the file; its free and fixed bodies and their shapes go to Rapier (rapier3d 0.36). For
each point of contact Rapier gives the impulse of the last step along the normal and two tangents.
Points that have left the solver keep stale impulses: only those it names as solver contacts count.
The tangents are those of its solver with the friction model of Coulomb: Duff et al., "Building an
orthonormal basis, revisited" (Journal of Computer Graphics Techniques 6(1), 2017).
"""

# MuJoCo is compiled, and has no stubs.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from struck.errors import MissingDependencyError, OptionError, SimulationError
from struck.model.arrays import Array, Index
from struck.scene.contacts import Contacts
from struck.scene.engines.explosion import free_masses, require_slow
from struck.scene.engines.links import Link, geom_placement, mass_properties, touches, triangles
from struck.scene.engines.mujoco import MujocoEngine
from struck.scene.engines.restitution import ContactLaws
from struck.scene.engines.step_log import StepLog

if TYPE_CHECKING:
    import mujoco

    from struck.scene.engines.mujoco import Control

_PLANE, _FIELD, _SPHERE, _CAPSULE, _CYLINDER, _BOX = 0, 1, 2, 3, 5, 6
# A cylinder of Rapier stands along y, MuJoCo's along z.
_UPRIGHT_ROTATION = Rotation.from_euler("x", 90, degrees=True)


class RapierEngine:
    """A simulation in Rapier from its beginning, with its log."""

    def __init__(
        self, model: mujoco.MjModel, links: Sequence[Link], laws: ContactLaws, keyframe: str | None
    ) -> None:
        try:
            import rapier3d
        except ImportError:
            raise MissingDependencyError('Rapier is an extra: pip install "struck[sim]"') from None
        self._rapier, self._model, self._links, self._laws = rapier3d, model, links, laws
        _require_free(model, links)
        self.step = float(model.opt.timestep)
        self._world = rapier3d.PhysicsWorld(gravity=np.array(model.opt.gravity))
        self._world.set_num_threads(1)  # the same log on every machine
        settings = self._world.integration_parameters
        settings.dt = self.step
        settings.length_unit = _size(model, links)
        settings.friction_model = rapier3d.FrictionModel.COULOMB
        if laws.has_values:
            self._world.physics_hooks = self
        self._pair_laws: dict[tuple[Any, Any], tuple[float | None, float | None]] = {}
        self._begin(MujocoEngine(model, links, keyframe).data)
        self.time, self._log = 0.0, StepLog(links)

    def advance(self, control: Control | None = None) -> None:
        """Take one step and note it."""
        if control is not None:
            raise OptionError('control= is MuJoCo\'s own: take engine="mujoco"')
        state = self._state()
        start = self.time
        self._world.step()
        self.time += self.step
        has_contacts = self._note_contacts(start, state)
        if has_contacts or self._log.is_due(start):
            self._log.pose(start, state[0], state[1])

    def contacts(self, *, forget: bool = False) -> Contacts:
        """Return the log so far, or since the last call with `forget`."""
        return self._log.contacts(forget=forget)

    def velocity(self, name: str) -> Array:
        """Return how fast a body's centre of mass moves, m/s (3,)."""
        return self._state()[2][[link.name for link in self._links].index(name)]

    # The world.

    def _begin(self, data: mujoco.MjData) -> None:
        """Make the bodies, where MuJoCo's stand."""
        self._bodies, self._numbers = [], {}
        self._centres = np.zeros((len(self._links), 3))  # of mass, in the frames
        for number, link in enumerate(self._links):
            position, rotation = _frame(data, link)
            maker = self._rapier.RigidBody
            body = maker.fixed() if link.fixed else maker.dynamic()
            body = body.translation(tuple(position.tolist())).rotation(_axis(rotation))
            if not link.fixed:
                body = self._weighing(body, number, link).can_sleep(False)  # noqa: FBT003 - Rapier's own
                at = self._model.body_dofadr[link.frame]
                # MuJoCo gives angular velocities of free bodies in body coordinates, Rapier in the
                # world's.
                angular_velocity = rotation.apply(data.qvel[at + 3 : at + 6])
                body = body.linvel(tuple(data.qvel[at : at + 3].tolist()))
                body = body.angvel(tuple(angular_velocity.tolist())).ccd_enabled(True)  # noqa: FBT003
            colliders = [c for geom in link.geoms for c in self._colliders(int(geom), link)]
            handle = self._world.add_body(body, colliders)
            self._bodies.append(handle)
            self._numbers[handle] = number

    def _weighing(self, body: Any, number: int, link: Link) -> Any:  # noqa: ANN401 - of Rapier
        """Return a body with its mass and moments of inertia."""
        link_mass = mass_properties(self._model, link)
        if link_mass is None:
            raise SimulationError(f"{link.name!r} weighs nothing: give it a mass or a density")
        frame_mass = link_mass.seen_from(link.placement)
        self._centres[number] = frame_mass.centre
        moments, axes = np.linalg.eigh(frame_mass.inertia)
        if np.linalg.det(axes) < 0:
            axes[:, 0] *= -1
        frame = tuple(Rotation.from_matrix(axes).as_quat().tolist())
        properties = self._rapier.MassProperties(
            tuple(frame_mass.centre.tolist()), frame_mass.mass, tuple(moments.tolist()), frame
        )
        return body.additional_mass_properties(properties)

    def _colliders(self, geom: int, link: Link) -> list[Any]:
        """Return the colliders of a geom, in the coordinates of its body."""
        model, kind = self._model, int(self._model.geom_type[geom])
        if not touches(model, geom):
            return []
        size = [float(length) for length in model.geom_size[geom]]
        factory = self._rapier.Collider
        rotation = _UPRIGHT_ROTATION if kind == _CYLINDER else Rotation.identity()
        if kind == _PLANE:
            collider = factory.halfspace((0.0, 0.0, 1.0))
        elif kind == _FIELD:
            raise SimulationError(f"{link.name!r} is a height field: take engine='mujoco'")
        elif kind == _SPHERE:
            collider = factory.ball(size[0])
        elif kind == _BOX:
            collider = factory.cuboid(*size)
        elif kind == _CYLINDER:
            collider = factory.cylinder(size[1], size[0])
        elif kind == _CAPSULE:
            collider = factory.capsule_z(size[1], size[0])
        else:
            points, _ = triangles(model, geom)
            collider = factory.convex_hull(np.ascontiguousarray(points, np.float32))
        place = geom_placement(model, geom, link)
        placed_collider = collider.translation(tuple(place.offset.tolist())).rotation(
            _axis(place.rotation * rotation)
        )
        placed_collider = (
            placed_collider.density(0.0)
            .friction(float(model.geom_friction[geom][0]))
            .restitution(0.0)
        )
        placed_collider = placed_collider.friction_combine_rule(
            self._rapier.CoefficientCombineRule.MAX
        )
        if self._laws.has_values:
            placed_collider = placed_collider.active_hooks(
                self._rapier.ActiveHooks.MODIFY_SOLVER_CONTACTS
            )
        return [placed_collider]

    def modify_solver_contacts(self, context: Any) -> None:  # noqa: ANN401 - Rapier calls it
        """Set the restitution and friction of two bodies, if the options give them."""
        pair = context.rigid_body1, context.rigid_body2
        if pair not in self._pair_laws:
            name_a, name_b = (self._links[self._numbers[body]].name for body in pair)
            self._pair_laws[pair] = self._laws.find_values(name_a, name_b)
        restitution, friction = self._pair_laws[pair]
        if restitution is not None:
            context.restitution = restitution
        if friction is not None:
            context.friction = friction

    # One step.

    def _state(self) -> tuple[Array, Array, Array, Array]:
        """Return positions, quaternions (w, x, y, z), velocities of centres of mass and spins."""
        states = np.zeros((len(self._bodies), 13))
        for row, handle in zip(states, self._bodies, strict=True):
            body = self._world.rigid_bodies[handle]
            position, rotation, velocity, angular_velocity = (
                body.translation,
                body.rotation,
                body.linvel,
                body.angvel,
            )
            row[:3] = position.x, position.y, position.z
            row[3:7] = rotation.w, rotation.i, rotation.j, rotation.k
            row[7:10] = velocity.x, velocity.y, velocity.z
            row[10:] = angular_velocity.x, angular_velocity.y, angular_velocity.z
        require_slow(self.time, states[:, 7:], states[:, :3])
        positions, rotations, velocities, angular_velocities = np.split(states, (3, 7, 10), axis=1)
        return positions, rotations, velocities, angular_velocities

    def _note_contacts(self, start: float, state: tuple[Array, ...]) -> bool:
        """Keep the rows of one step; return whether there are any."""
        rows = [row for pair in self._world.narrow_phase.contact_pairs() for row in self._of(pair)]
        if not rows:
            return False
        table = np.array(rows)
        bodies = table[:, :2].astype(np.int64)
        # Rapier gives points at the end of the step: they are moved back to its start.
        end_state = self._state()
        sides = [
            _carried_back(table[:, 2 + 3 * side : 5 + 3 * side], bodies[:, side], state, end_state)
            for side in (0, 1)
        ]
        points = (sides[0] + sides[1]) / 2
        velocity = self._speed(state, bodies[:, 1], points) - self._speed(
            state, bodies[:, 0], points
        )
        normals, impulses = table[:, 8:11], table[:, 11:]
        self._log.touch(start, self.step, bodies, points, normals, velocity, impulses)
        return True

    def _of(self, pair: Any) -> Iterator[tuple[float, ...]]:  # noqa: ANN401 - of Rapier
        """Yield bodies, place on each, normal and impulse of the points of a pair that push."""
        for manifold in pair.manifolds:
            data, points = manifold.data, manifold.points
            solver_contacts = data.solver_contacts
            if not solver_contacts:
                continue
            numbers = self._numbers[data.rigid_body1], self._numbers[data.rigid_body2]
            normal = _array(data.normal)
            tangents = _tangents(-normal)
            for contact in solver_contacts:
                point = points[int(np.ravel(contact.contact_id)[0])]
                if point.impulse > 0:
                    impulse = normal * point.impulse - np.array(point.tangent_impulse) @ tangents
                    ends = data.solver_contact_world_points(contact, self._world.rigid_bodies)
                    places = (_array(end) for end in ends)
                    yield (*numbers, *next(places), *next(places), *normal, *impulse)

    def _speed(self, state: tuple[Array, ...], bodies: Index, points: Array) -> Array:
        """Return the velocities of points of bodies, m/s (K, 3)."""
        origins, rotations, velocities, angular_velocities = (values[bodies] for values in state)
        frames = Rotation.from_quat(rotations, scalar_first=True)
        centres = origins + frames.apply(self._centres[bodies])
        return velocities + np.cross(angular_velocities, points - centres)


def _carried_back(
    points: Array, bodies: Index, state: tuple[Array, ...], end_state: tuple[Array, ...]
) -> Array:
    """Return where points of bodies that are there when a step ends were when it began (K, 3)."""
    end_rotations = Rotation.from_quat(end_state[1][bodies], scalar_first=True)
    start_rotations = Rotation.from_quat(state[1][bodies], scalar_first=True)
    return (
        start_rotations.apply(end_rotations.inv().apply(points - end_state[0][bodies]))
        + state[0][bodies]
    )


def _array(vector: Any) -> Array:  # noqa: ANN401 - of Rapier
    return np.array([vector.x, vector.y, vector.z])


def _tangents(direction: Array) -> Array:
    """Return the two tangents along which Rapier counts friction (2, 3)."""
    x, y, z = direction
    sign = 1.0 if z >= 0 else -1.0
    a = -1 / (sign + z)
    first = np.array([x * y * a, sign + y * y * a, -y])
    return np.stack([first, np.cross(direction, first)])


def _axis(rotation: Rotation) -> tuple[float, ...]:
    """Return a rotation as Rapier takes it: an axis as long as the angle."""
    return tuple(rotation.as_rotvec().tolist())


def _frame(data: mujoco.MjData, link: Link) -> tuple[Array, Rotation]:
    """Return the position of a link's frame, m (3,), and its rotation."""
    if link.frame_is_body:
        rotation = Rotation.from_quat(data.xquat[link.frame], scalar_first=True)
        return np.array(data.xpos[link.frame]), rotation
    rotation = Rotation.from_matrix(data.geom_xmat[link.frame].reshape(3, 3))
    return np.array(data.geom_xpos[link.frame]), rotation


def _require_free(model: mujoco.MjModel, links: Sequence[Link]) -> None:
    """Refuse joints, actuators, tendons and equalities, which are not passed to Rapier."""
    masses = free_masses(model, links)
    jointed_names = [
        link.name
        for link, mass in zip(links, masses, strict=True)
        if not (link.fixed or np.isfinite(mass))
    ]
    if jointed_names or model.nu or model.neq or model.ntendon:
        problem = (
            f"{jointed_names[0]!r} has joints"
            if jointed_names
            else "the scene has actuators or constraints"
        )
        raise SimulationError(
            f"{problem}: Rapier gets free and fixed bodies alone; take engine='mujoco'"
        )


def _size(model: mujoco.MjModel, links: Sequence[Link]) -> float:
    """Return the typical length of moving bodies, m, by which Rapier sets its tolerances."""
    sizes = [float(model.geom_rbound[g]) for link in links if not link.fixed for g in link.geoms]
    return float(np.clip(np.median(sizes or [1.0]), 1e-3, 10.0))
