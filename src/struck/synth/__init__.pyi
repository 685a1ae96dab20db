from .resonators import Resonators as Resonators
