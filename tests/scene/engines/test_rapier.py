from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from struck.errors import OptionError, SimulationError
from struck.scene import Simulation
from struck.scene.engines.rapier import RapierEngine
from tests.samples import sampled

pytest.importorskip("mujoco")
pytest.importorskip("rapier3d")

GRAVITY = np.array([0.0, 0.0, -9.81])
BODIES = """
<body name="floor" euler="10 -15 0"><geom type="box" size="1 1 .05" pos="0 0 -.05"/></body>
<body name="plank" pos="0 0 .12" euler="20 15 0"><freejoint/>
  <geom type="box" size=".15 .05 .005" mass="2.355"/></body>
<body name="rod" pos="0 .02 .3" euler="80 10 40"><freejoint/>
  <geom type="cylinder" size=".0125 .2525" mass=".1028" pos=".01 0 0"/></body>
<body name="pill" pos=".2 .2 .2"><freejoint/>
  <geom type="capsule" size=".02 .03" mass=".1"/><geom size=".03" pos="0 0 .05" mass=".2"/></body>
"""


def written(folder: Path, bodies: str, *, options: str = "", rest: str = "") -> Path:
    path = folder / "scene.xml"
    path.write_text(f"<mujoco><option {options}/><worldbody>{bodies}</worldbody>{rest}</mujoco>")
    return path


def velocity(engine: RapierEngine, name: str) -> np.ndarray:
    """Return how fast a body's centre of mass moves, m/s."""
    return engine._state()[2][[link.name for link in engine._links].index(name)]


@pytest.mark.prove
def test_momentum_closes_with_friction_on_a_slope(tmp_path: Path) -> None:
    path = written(tmp_path, BODIES, options='timestep=".001"')
    simulation = Simulation(path, engine="rapier", restitution=0.5, friction=0.3)
    _, contacts = simulation.run(0.5)
    engine, steps = simulation.started(), 500
    for _ in range(steps):
        engine.advance()
    impulse = np.asarray(contacts.impulse)
    slid = impulse - np.einsum("ki,ki->k", impulse, contacts.normal)[:, None] * contacts.normal
    assert np.linalg.norm(slid, axis=1).sum() > 0.05 * np.linalg.norm(impulse, axis=1).sum()
    for name in ("plank", "rod", "pill"):
        body = simulation.model.body(name)
        number, mass = contacts.names.index(name), body.mass[0]
        second = np.asarray(contacts.body1) == number
        mine = second | (np.asarray(contacts.body0) == number)
        total = impulse[second].sum(axis=0) - impulse[mine & ~second].sum(axis=0)
        gained = velocity(engine, name) - GRAVITY * steps * 0.001
        exchanged = np.linalg.norm(impulse[mine], axis=1).sum()
        assert np.linalg.norm(total - mass * gained) < 1e-3 * exchanged


@pytest.mark.parametrize("step", sampled([0.0005, 0.001], 0.001))
@pytest.mark.parametrize("asked", [0.3, 0.5, 0.8])
def test_bodies_rebound_as_asked(tmp_path: Path, step: float, asked: float) -> None:
    ball = '<body name="ball" pos=".3 0 {0}"><freejoint/><geom size=".013" density="7850"/></body>'
    heavy = '<body name="heavy" pos=".3 0 0"><freejoint/><geom size=".026" density="7850"/></body>'
    plane = '<geom name="floor" type="plane" size="1 1 .1"/>'
    options = f'timestep="{step}" gravity="0 0 0"'
    for speed in (0.5, 1.7, 5.0):
        states = {
            plane: (0.0177, f"0 0 {-speed} 0 0 0", ""),
            heavy: (0.0437, f"0 0 {-speed} 0 0 0", " 0 0 0 0 0 0"),
        }
        for other, (height, own, rest) in states.items():
            key = f'<keyframe><key name="k" qvel="{own}{rest}"/></keyframe>'
            path = written(tmp_path, ball.format(height) + other, options=options, rest=key)
            simulation = Simulation(path, engine="rapier", restitution=asked, keyframe="k")
            engine = simulation.started()
            for _ in range(int(0.01 / speed / step) + 30):
                engine.advance()
            apart = velocity(engine, "ball") - (velocity(engine, "heavy") if rest else 0.0)
            assert apart[2] / speed == pytest.approx(asked, abs=0.05)


def test_contacts_are_where_bodies_meet(tmp_path: Path) -> None:
    plane = '<geom name="floor" type="plane" size="1 1 .1"/>'
    ball = '<body name="ball" pos=".1 .2 .1"><freejoint/><geom size=".03" mass="1"/></body>'
    path = written(tmp_path, plane + ball, options='timestep=".001"')
    _, contacts = Simulation(path, engine="rapier", restitution=0.5).run(0.3)
    first = np.asarray(contacts.position)[0]
    np.testing.assert_allclose(first, [0.1, 0.2, 0.0], atol=2e-3)
    # It falls 70 mm; the plane is body0 or body1, and the ball is pushed upward.
    speed = np.sqrt(2 * 9.81 * 0.07)
    up = np.asarray(contacts.normal)[0] * (1 if contacts.body1[0] == 1 else -1)
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-6)
    assert abs(contacts.velocity[0][2]) == pytest.approx(speed, rel=0.02)
    assert np.linalg.norm(contacts.impulse[0]) == pytest.approx(1.5 * speed, rel=0.02)


@pytest.mark.parametrize(
    ("bodies", "said"),
    [
        ('<body name="door"><joint/><geom size=".1"/></body>', "'door' has joints"),
        ('<geom name="land" type="plane" size="1 1 1"/>', ""),
    ],
)
def test_what_rapier_is_not_given_is_refused(tmp_path: Path, bodies: str, said: str) -> None:
    path = written(tmp_path, bodies)
    if said:
        with pytest.raises(SimulationError, match=said):
            Simulation(path, engine="rapier").run(0.1)
    else:
        with pytest.raises(OptionError, match="engine="):
            Simulation(path, engine="rapier").run(0.1, control=print)
