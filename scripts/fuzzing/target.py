"""Fuzz one protocol in this process: target.py PROTOCOL [libFuzzer's options and folders ...]."""

import sys

import atheris

with atheris.instrument_imports(include=["robot_driver.controllers", "robot_driver.emulator", "robot_driver.gyros"]):
    from tests.robot_driver.any_bytes import CHECKS

if __name__ == "__main__":
    program, protocol, *arguments = sys.argv
    atheris.Setup([program, *arguments], CHECKS[protocol])
    atheris.Fuzz()
