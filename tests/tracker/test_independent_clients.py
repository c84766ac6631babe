"""The emulated trackers speak the published formats: clients that others wrote read them without a wrong answer."""

import asyncio
import json
import math
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("natnet", reason="the extra [tracker] is not installed")
pytest.importorskip("qtm_rt", reason="the extra [tracker] is not installed")
import natnet
import qtm_rt

from tests.support.trackers.bench import Server
from tests.support.trackers.frame import Body, Emitted
from tests.support.trackers.natnet_server import TICKS, NatNetServer
from tests.support.trackers.qtm_server import QtmServer
from tests.support.trackers.vrpn_server import VrpnServer

pytestmark = pytest.mark.waits
PATIENCE = 60.0  # s
GROUP = "239.255.42.98"
BODIES = [Body(f"robot_{k}", 0.5 * k - 1.0, 0.25 * k, 0.3 * k - 1.0) for k in range(6)]
LOST = BODIES[3]._replace(tracked=False)
SENT = [*BODIES[:3], LOST, *BODIES[4:]]
EXPOSED, PROCESSED = 12.5, 0.004  # s
MOTION_CAPTURE = """
import json, sys, motioncapture
tracker = motioncapture.connect(sys.argv[1], json.loads(sys.argv[2]))
found = {}
while len(found) < int(sys.argv[3]):
    tracker.waitForNextFrame()
    for name, body in tracker.rigidBodies.items():
        turn = body.rotation
        found[name] = [*map(float, body.position), turn.x, turn.y, turn.z, turn.w]
print("\\n" + json.dumps(found), flush=True)
import os
os._exit(0)
"""


@contextmanager
def sending(server: Server) -> Iterator[None]:
    """Send the same frame again and again, under new numbers."""
    is_over = threading.Event()

    def send() -> None:
        number = 0
        while not is_over.wait(0.01):
            number += 1
            server.send(Emitted(number, EXPOSED + 0.01 * number, EXPOSED + 0.01 * number + PROCESSED, SENT))

    thread = threading.Thread(target=send)
    thread.start()
    try:
        yield
    finally:
        is_over.set()
        thread.join()
        server.close()


def assert_is(body: Body, x: float, y: float, z: float, theta: float) -> None:
    assert (x, y, z) == pytest.approx((body.x, body.y, body.z), abs=1e-5)
    assert math.remainder(theta - body.theta, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-5)


def heading(quaternion: "tuple[float, float, float, float]") -> float:
    x, y, z, w = quaternion
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


@pytest.mark.parametrize("version", [(3, 1), (4, 0), (4, 1), (4, 2)])
@pytest.mark.parametrize("group", [None, GROUP])
def test_natnet_reads_the_emulated_motive(version: tuple[int, int], group: str | None) -> None:
    server = NatNetServer(version, group=group)
    frames: list[Any] = []
    described: list[Any] = []
    with sending(server):
        client = natnet.NatNetClient(
            server_ip_address="127.0.0.1",
            local_ip_address="127.0.0.1",
            multicast_address=group or "239.255.42.99",
            command_port=server.port,
            data_port=server.data_port,
            use_multicast=group is not None,
        )
        client.on_data_frame_received_event.handlers.append(frames.append)
        client.on_data_description_received_event.handlers.append(described.append)
        client.connect(PATIENCE)
        try:
            client.request_modeldef()
            deadline = time.monotonic() + PATIENCE
            while not (frames and described) and time.monotonic() < deadline:
                client.update_sync()
                time.sleep(0.01)
        finally:
            client.shutdown()
    assert client.protocol_version is not None
    assert [body.name for body in described[-1].rigid_bodies] == [body.name for body in SENT]
    frame = frames[-1]
    assert len(frame.rigid_bodies) == len(SENT)
    for sent, read in zip(SENT, frame.rigid_bodies, strict=True):
        assert read.tracking_valid == sent.tracked
        x, y, z = read.pos
        assert_is(sent, x, y, z, heading(read.rot))
    exposed = EXPOSED + 0.01 * frame.prefix.frame_number
    assert frame.suffix.stamp_camera_mid_exposure == pytest.approx(exposed * TICKS, abs=1)
    assert frame.suffix.stamp_transmit == pytest.approx((exposed + PROCESSED) * TICKS, abs=1)


@pytest.mark.parametrize("component", ["6d", "6deuler"])
def test_qtm_rt_reads_the_emulated_qtm(component: str) -> None:
    server = QtmServer()
    with sending(server):
        names, packet = asyncio.run(asyncio.wait_for(_of_qtm(server.port, component), PATIENCE))
    assert names == [body.name for body in SENT]
    _, bodies = packet.get_6d() if component == "6d" else packet.get_6d_euler()
    for sent, (position, turn) in zip(SENT, bodies, strict=True):
        if not sent.tracked:
            assert math.isnan(position.x)
            continue
        theta = math.atan2(turn.matrix[1], turn.matrix[0]) if component == "6d" else math.radians(turn.a3)
        assert_is(sent, position.x / 1e3, position.y / 1e3, position.z / 1e3, theta)
    assert packet.timestamp == pytest.approx(10_000 * (packet.framenumber - 1), abs=1)


async def _of_qtm(port: int, component: str) -> "tuple[list[str], Any]":
    """Return the names of bodies, and a packet."""
    import xml.etree.ElementTree as ET

    connection = await qtm_rt.connect("127.0.0.1", port=port, version="1.19", timeout=PATIENCE)
    assert connection is not None
    packets: asyncio.Queue[Any] = asyncio.Queue()
    settings = ET.fromstring(await connection.get_parameters(parameters=["6d"]))
    names = [element.text or "" for element in settings.iterfind("The_6D/Body/Name")]
    await connection.stream_frames(components=[component], on_packet=packets.put_nowait)
    packet = await packets.get()
    connection.disconnect()
    return names, packet


@pytest.mark.parametrize("kind", ["optitrack 3.1", "optitrack 4.1", "qualisys", "vrpn"])
def test_motioncapture_reads_the_emulated_trackers(kind: str) -> None:
    pytest.importorskip("motioncapture", reason="has no wheel for this Python or processor")
    type_name, server, settings = _for_motion_capture(kind)
    tracked = [body for body in SENT if body.tracked]
    with sending(server):
        run = subprocess.run(
            [sys.executable, "-c", MOTION_CAPTURE, type_name, json.dumps(settings), str(len(tracked))],
            env={"PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout.splitlines()[-1])
    assert set(found) == {body.name for body in tracked}
    for body in tracked:
        x, y, z, *quaternion = found[body.name]
        assert_is(body, x, y, z, heading((quaternion[0], quaternion[1], quaternion[2], quaternion[3])))


def _for_motion_capture(kind: str) -> "tuple[str, Server, dict[str, str]]":
    """Return the type, a server, and how motioncapture finds it."""
    if kind == "qualisys":
        qtm = QtmServer()
        return "qualisys", qtm, {"hostname": "127.0.0.1", "port": str(qtm.port - 1)}  # of which it takes the next one
    if kind == "vrpn":
        vrpn = VrpnServer()
        return "vrpn", vrpn, {"hostname": f"tcp://127.0.0.1:{vrpn.port}"}
    motive = NatNetServer((4, 1) if kind.endswith("4.1") else (3, 1), group=GROUP)
    local = {"hostname": "127.0.0.1", "interface_ip": "127.0.0.1", "port_command": str(motive.port)}
    return "optitrack", motive, local
