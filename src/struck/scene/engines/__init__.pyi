from .mujoco import MujocoRecorder as MujocoRecorder
from .simulation import Simulation as Simulation
