"""The wheel of the driver alone: modules of the whole distribution with metadata of their own, reproducible."""

import base64
import hashlib
import re
import time
import zipfile
from pathlib import Path

from documentation.imports import PROJECT

from cmr.distribution import DRIVER_NAME
from shipping.contents import files_there

SCRIPTS = {"cmr": "cmr.commands:umbrella", "cmr-driver": "cmr.commands:driver", "cmr-agent": "cmr.commands:agent"}
REQUIRED = ("lcm", "pyserial", "PyYAML")
SUMMARY = "The driver of Calibrated Mixed Reality alone, for a robot's own computer"
ANYWHERE = "Wheel-Version: 1.0\nGenerator: scripts/release\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
FILE = 0o100644 << 16  # a zip file's way to say rw-r--r--


def write_wheel(root: Path, version: str, folder: Path, epoch: int) -> Path:
    """Write the wheel, of what lies below an import root, into a folder; return its path. All in it has one time."""
    name = f"{DRIVER_NAME.replace('-', '_')}-{version}"
    files = {path: (root / path).read_bytes() for path in files_there(root)} | information(version, f"{name}.dist-info")
    record = f"{name}.dist-info/RECORD"
    lines = [f"{path},{_digest(content)},{len(content)}\n" for path, content in files.items()]
    files[record] = "".join([*lines, f"{record},,\n"]).encode()
    wheel = folder / f"{name}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, content in files.items():
            entry = zipfile.ZipInfo(path, time.gmtime(epoch)[:6])
            entry.external_attr, entry.compress_type = FILE, zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return wheel


def information(version: str, folder: str) -> dict[str, bytes]:
    """Return the files that say what is installed, but for the list of files, by path."""
    scripts = "".join(f"{name} = {function}\n" for name, function in SCRIPTS.items())
    return {
        f"{folder}/METADATA": metadata(version).encode(),
        f"{folder}/WHEEL": ANYWHERE.encode(),
        f"{folder}/entry_points.txt": f"[console_scripts]\n{scripts}".encode(),
        f"{folder}/licenses/LICENSE": (PROJECT / "LICENSE").read_bytes(),
    }


def metadata(version: str) -> str:
    """Return what package managers read; what is required are some of the whole distribution's requirements."""
    project = (PROJECT / "pyproject.toml").read_text(encoding="utf-8")
    [python] = re.findall(r'^requires-python = "(.+)"$', project, re.MULTILINE)
    required = [re.findall(rf'^    "({name}[<>=][^"]*)",', project, re.MULTILINE)[0] for name in REQUIRED]
    fields = {"Metadata-Version": "2.4", "Name": DRIVER_NAME, "Version": version, "Summary": SUMMARY}
    lines = [f"{key}: {value}" for key, value in fields.items()]
    lines += ["License-Expression: BSD-3-Clause", "License-File: LICENSE", f"Requires-Python: {python}"]
    return "\n".join([*lines, *(f"Requires-Dist: {one}" for one in required)]) + "\n"


def _digest(content: bytes) -> str:
    digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest())
    return f"sha256={digest.rstrip(b'=').decode()}"
