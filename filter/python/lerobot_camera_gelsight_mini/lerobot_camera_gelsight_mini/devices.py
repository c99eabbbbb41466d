"""The GelSight Minis that are connected, as Linux lists them."""

from dataclasses import dataclass
from pathlib import Path

VIDEO_DEVICES = Path("/sys/class/video4linux")

NAME = "GelSight Mini"


@dataclass(frozen=True)
class Device:
    """A sensor, such as `GelSight Mini R0B 2BNK-CE0U: Ge` at `/dev/video2`."""

    name: str
    path: Path


def connected() -> list[Device]:
    """All sensors, by the number of their device. A sensor has two devices; the one with index 0 gives pictures."""
    found = []
    for folder in VIDEO_DEVICES.glob("video*"):
        try:
            name, index = ((folder / file).read_text().strip() for file in ("name", "index"))
        except OSError:
            continue  # unplugged in the meantime
        if _letters(NAME) in _letters(name) and index == "0":
            found.append(Device(name, Path("/dev") / folder.name))
    return sorted(found, key=lambda device: (len(device.path.name), device.path.name))


def choose(sensor: str | None) -> Device:
    """The sensor whose name has this part, or the only one.

    Raises:
        ConnectionError: None is found, or several; the message lists what is connected.
    """
    devices = connected()
    chosen = [device for device in devices if _letters(sensor or NAME) in _letters(device.name)]
    if len(chosen) == 1:
        return chosen[0]
    wanted = NAME if sensor is None else f"{NAME} with {sensor!r} in its name"
    listed = ", ".join(f"{device.name!r} at {device.path}" for device in devices)
    if chosen:
        raise ConnectionError(f"sensor: expected a part of one name, got {sensor!r} for {listed}")
    raise ConnectionError(f"no {wanted} in {VIDEO_DEVICES}/*/name; connected: {listed or 'none'}")


def _letters(name: str) -> str:
    """What counts of a name: the serial number 2BNK-CE0U is also written 2BNKCE0U."""
    return "".join(character for character in name.lower() if character.isalnum())
