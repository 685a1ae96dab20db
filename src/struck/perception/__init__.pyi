from .audibility import audible as audible
from .sonic_distance import sonic_distance as sonic_distance
from .sound_map import SoundMap as SoundMap
from .sound_map import sound_map as sound_map
from .wav_bank import write_bank as write_bank
