"""deploy/systemd/depthtween.service, judged by systemd's own checker, and what the real server says to a service manager,
which here is a socket of the test's. The messages are those of sd_notify(3)."""

import os
import shlex
import shutil
import signal
import socket
import subprocess
import unittest
from unittest import mock

import harness
from access_test import new_token
from harness import BIN, SOURCE, Server

UNIT = SOURCE / "deploy/systemd/depthtween.service"
PROGRAM = "/usr/local/bin/depthtween-server"


def settings():
    """name -> values, in the unit's order."""
    found = {}
    for line in UNIT.read_text().splitlines():
        if "=" in line and not line.startswith("#"):
            name, value = line.split("=", 1)
            found.setdefault(name, []).append(value)
    return found


class Manager:
    """The other end of NOTIFY_SOCKET."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))
        self.socket.settimeout(harness.PATIENCE_S)

    def next(self):
        return self.socket.recv(4096).decode().splitlines()


class SystemdTest(harness.IntegrationTest):

    @unittest.skipUnless(shutil.which("systemd-analyze"), "systemd-analyze is not installed")
    def test_the_unit_is_as_systemd_wants_it(self):
        text = UNIT.read_text()
        self.assertIn(f"ExecStart={PROGRAM} ", text)
        copy = self.folder / UNIT.name
        copy.write_text(text.replace(PROGRAM, str(BIN / "depthtween-server")))
        result = subprocess.run(["systemd-analyze", "verify", copy], capture_output=True, text=True,
                                timeout=harness.PATIENCE_S)
        # It warns, with exit code 0, of names that it does not know.
        self.assertEqual((result.returncode, result.stdout + result.stderr), (0, ""))

    def test_the_server_takes_the_flags_of_the_unit(self):
        tokens = self.folder / "tokens.json"
        new_token(tokens)
        command = shlex.split(settings()["ExecStart"][0])
        self.assertEqual(command[:2], [PROGRAM, "serve"])
        for flag in ("--data-dir", "--listen"):  # the harness has its own
            at = command.index(flag)
            del command[at:at + 2]
        for flag, value in (("--tokens", tokens), ("--http-listen", "127.0.0.1:0")):
            command[command.index(flag) + 1] = str(value)
        with Server(self.folder / "data", options=command[2:]) as server:
            self.assertEqual(server.stop(), 0)

    def test_systemd_waits_longer_than_the_server_drains(self):
        command = shlex.split(settings()["ExecStart"][0])
        drain_s = float(command[command.index("--drain-seconds") + 1])
        self.assertGreaterEqual(float(settings()["TimeoutStopSec"][0].removesuffix("s")), drain_s + 30)
        self.assertEqual(settings()["Type"], ["notify"])

    def test_the_server_says_that_it_is_ready_lives_and_stops(self):
        manager = Manager(self.folder / "notify")
        self.addCleanup(manager.socket.close)
        with mock.patch.dict(os.environ, {"NOTIFY_SOCKET": str(self.folder / "notify"), "WATCHDOG_USEC": "200000"}):
            server = Server(self.folder / "data", options=["--drain-seconds", "7"])
            with server:
                ready = manager.next()
                self.assertEqual(ready[0], "READY=1")
                self.assertIn(server.address, ready[1])
                for _ in range(3):
                    self.assertEqual(manager.next(), ["WATCHDOG=1"])
                server.process.send_signal(signal.SIGTERM)
                said = manager.next()
                while said == ["WATCHDOG=1"]:
                    said = manager.next()
                self.assertEqual(said[0], "STOPPING=1")
                asked_us = next(int(line.split("=")[1]) for line in said if line.startswith("EXTEND_TIMEOUT_USEC="))
                self.assertGreater(asked_us, 7_000_000)
                self.assertEqual(server.process.wait(timeout=harness.PATIENCE_S), 0)


if __name__ == "__main__":
    harness.main()
