"""Bytes that manuals and standards print, or that programs of other people send: what each protocol looks like.

Where they are from stands above each. `tests/robot_driver/test_golden_vectors.py` holds the driver and
the emulator to them.
"""

# Check values of the catalogue of CRC algorithms (reveng.sourceforge.io): CRC-16/XMODEM, CRC-32/MPEG-2.
CHECKED = b"123456789"
CRC_16_OF_CHECKED = 0x31C3
CRC_32_OF_CHECKED = 0x0376E6E7
# kingananas20/roboclaw, lib.rs.
CRC_16_OF_FF = 0x1EF0

# RoboClaw, unit 0x80. Written by the tests of dumbotics/roboclaw_serial: velocity PID of motor 1 (D, P, I, QPPS).
ROBOCLAW_PID = bytes.fromhex("80 1c 00000000 000021b7 0000036e 0003135a 7d8e")
# Answered in the same tests: the counts 0x30F0 and 0xCFDC.
ROBOCLAW_COUNTS = bytes.fromhex("000030f0 0000cfdc d4db")
# Sent by the client tcr-roboclaw: duties 8000 and -8000, speeds 1000 and -2000, a timeout of 0.5 s.
ROBOCLAW_DUTIES = bytes.fromhex("80 22 1f40 e0c0 830d")
ROBOCLAW_SPEEDS = bytes.fromhex("80 25 000003e8 fffff830 eb3e")
ROBOCLAW_TIMEOUT = bytes.fromhex("80 0e 05 48f0")
# Accepted by it: 24.5 V.
ROBOCLAW_BATTERY = bytes.fromhex("00f5 8840")
# By the rules of the RoboClaw user manual, "Packet serial": duties of zero, encoders to zero; the timeout of 0.5 s
# and healthy status words of the firmware's three ages as they are answered.
ROBOCLAW_STOP = bytes.fromhex("80 22 0000 0000 9817")
ROBOCLAW_RESET_ENCODERS = bytes.fromhex("80 14 492d")
ROBOCLAW_TIMEOUT_READ = bytes.fromhex("05 7bc1")
ROBOCLAW_HEALTHY = {1: bytes.fromhex("00 da2e"), 2: bytes.fromhex("0000 4437"), 4: bytes.fromhex("00000000 87bc")}
# The same manual: what is asked by address and command alone.
ROBOCLAW_READS = {
    "version": bytes.fromhex("80 15"),
    "timeout": bytes.fromhex("80 0f"),
    "battery": bytes.fromhex("80 18"),
    "currents": bytes.fromhex("80 31"),
    "encoders": bytes.fromhex("80 4e"),
    "temperature": bytes.fromhex("80 52"),
    "status": bytes.fromhex("80 5a"),
}

# MBot: VEL_CMD at 7 us, 0.5 m/s forward and -0.25 rad/s, with the payload that mbot_lcm_serial sends.
MBOT_VELOCITY = bytes.fromhex("fffe1400ebd600 0700000000000000 0000003f 00000000 000080be a5")
# By the rules of mbot_firmware, comms/src/protocol.c, at 7 us: the time; duties of 0.5 and -0.25; duties of zero.
MBOT_TIME = bytes.fromhex("fffe0800f7c900 0700000000000000 2f")
MBOT_DUTIES = bytes.fromhex("fffe1400ebe600 0700000000000000 0000003f 000080be 00000000 95")
MBOT_STOP = bytes.fromhex("fffe1400ebe600 0700000000000000 00000000 00000000 00000000 12")

# Roboteq "Advanced Digital Motor Controller User Manual", serial commands: a right answer to each question.
ROBOTEQ_ANSWERS = {
    b"?FID\r": b"FID=Roboteq v1.6 RCB500 05/01/2016\r",
    b"^ECHOF 1\r": b"+\r",
    b"~MMOD 1\r": b"MMOD=0\r",
    b"~MMOD 2\r": b"MMOD=0\r",
    b"~MXMD\r": b"MXMD=0\r",
    b"~CLIN 1\r": b"CLIN=0\r",
    b"~CLIN 2\r": b"CLIN=0\r",
    b"^RWD 500\r": b"+\r",
    b"~RWD\r": b"RWD=500\r",
    b"!M 500 -250\r": b"+\r",
    b"?M\r": b"M=500:-250\r",
    b"?C\r": b"C=-2147483648:2147483647\r",
    b"?V\r": b"V=135:246:4730\r",
    b"?A\r": b"A=15:-3\r",
    b"?T\r": b"T=30:31:29\r",
    b"?FF\r": b"FF=0\r",
    b"?FM\r": b"FM=0:0\r",
}

# KVH 1775 IMU technical manual 56-0298 Rev. B: the printed sample of format A.
KVH_SAMPLE = bytes.fromhex("FE81FF55 37A96A6E 38586C1F B75BF862 BF803E78 BB650D28 3B0A37AC 77 3D 0028 4BFA34D8")
# By the rules of the same manual, table 5-10: a self-test that found nothing.
KVH_SELF_TEST = bytes.fromhex("FE8100AA 7F7F7F7F7F7F 23")

# ros-drivers/kvh_drivers, test of the DSP-3000's parser: a whole line, its end, and the end of the next.
DSP3000_LINE = b"       0.015733   1\r\n"
DSP3000_END_OF_A_LINE = b"0.015733   1\r\n"
DSP3000_WITHOUT_A_VALUE = b"  1\r\n"
