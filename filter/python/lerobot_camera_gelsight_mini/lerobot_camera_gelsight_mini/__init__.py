"""The tactile sensor GelSight Mini as a camera of LeRobot: type `gelsight_mini`."""

from .config_gelsight_mini import GelSightMiniConfig
from .devices import Device
from .gelsight_mini import GelSightMini

__all__ = ["Device", "GelSightMini", "GelSightMiniConfig"]
