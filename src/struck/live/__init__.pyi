from .device import Device as Device
from .device import PortAudio as PortAudio
from .player import Player as Player
from .recorder import DeviceRecorder as DeviceRecorder
from .recorder import microphone as microphone
