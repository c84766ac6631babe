"""The wheel of the driver alone: some modules of CMR, with metadata of their own; the file is reproducible."""

import base64
import hashlib
import re
import time
import zipfile
from pathlib import Path

from documentation.imports import PROJECT

from cmr.distribution import DRIVER_NAME
from shipping.contents import driver_files

SCRIPTS = {"cmr": "cmr.commands:umbrella", "cmr-driver": "cmr.commands:driver", "cmr-agent": "cmr.commands:agent"}
REQUIRED = ("lcm", "pyserial", "PyYAML")
SUMMARY = "The driver of Calibrated Mixed Reality alone, for a robot's own computer"
ANYWHERE = "Wheel-Version: 1.0\nGenerator: scripts/release\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
FILE = 0o100644 << 16  # rw-r--r-- in a zip file


def write_wheel(root: Path, version: str, folder: Path, epoch: int) -> Path:
    """Write the wheel of the modules in an import root into a folder; return its path. All files have the same time."""
    name = f"{DRIVER_NAME.replace('-', '_')}-{version}"
    files = {path: (root / path).read_bytes() for path in driver_files(root)} | metadata_files(
        version, f"{name}.dist-info"
    )
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


def metadata_files(version: str, folder: str) -> dict[str, bytes]:
    """Return the files of the dist-info folder by path, without RECORD, the list of files."""
    scripts = "".join(f"{name} = {function}\n" for name, function in SCRIPTS.items())
    return {
        f"{folder}/METADATA": metadata(version).encode(),
        f"{folder}/WHEEL": ANYWHERE.encode(),
        f"{folder}/entry_points.txt": f"[console_scripts]\n{scripts}".encode(),
        f"{folder}/licenses/LICENSE": (PROJECT / "LICENSE").read_bytes(),
    }


def metadata(version: str) -> str:
    """Return the METADATA file; the driver needs only some requirements of the whole distribution."""
    project = (PROJECT / "pyproject.toml").read_text(encoding="utf-8")
    [python] = re.findall(r'^requires-python = "(.+)"$', project, re.MULTILINE)
    required = [re.findall(rf'^    "({name}[<>=][^"]*)",', project, re.MULTILINE)[0] for name in REQUIRED]
    fields = {"Metadata-Version": "2.4", "Name": DRIVER_NAME, "Version": version, "Summary": SUMMARY}
    lines = [f"{key}: {value}" for key, value in fields.items()]
    lines += ["License-Expression: BSD-3-Clause", "License-File: LICENSE", f"Requires-Python: {python}"]
    return "\n".join([*lines, *(f"Requires-Dist: {requirement}" for requirement in required)]) + "\n"


def _digest(content: bytes) -> str:
    digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest())
    return f"sha256={digest.rstrip(b'=').decode()}"
