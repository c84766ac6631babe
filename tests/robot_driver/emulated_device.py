"""What tests of the emulated devices share: a request and its answer, and time that passes."""

from robot_driver.emulator.device import Device
from robot_driver.emulator.plant import Plant


def answer(device: Device, request: bytes, time: float = 1.0) -> bytes:
    """Return all that a device sends back to a request at this time [s]."""
    return b"".join(transmission.data for transmission in device.receive(request, time))


def said_until(device: Device, plant: Plant, until: float) -> list[bytes]:
    """Let time pass until this moment [s] as the engine does; return what the device says of its own accord."""
    said = []
    while device.wake_time <= until:
        time = device.wake_time
        plant.advance(time)
        said += [transmission.data for transmission in device.wake(time)]
    plant.advance(until)
    return said


def let_pass(device: Device, plant: Plant, until: float) -> None:
    """Let time pass until this moment [s] with a device that says nothing unless it is asked."""
    assert said_until(device, plant, until) == []
