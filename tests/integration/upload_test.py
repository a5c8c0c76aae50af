"""Uploads over lines that are cut: what arrives is whole, and nothing is sent twice that was acknowledged. The line is a
proxy that counts bytes; the truth is that the server checks the SHA-256 of every file."""

import random
import socket
import threading

import harness
from harness import Server


class Line:
    """A loopback proxy to `port` whose first connection carries only `most_bytes` from client to server: then it is cut,
    or with `stall`, carries nothing more. Later connections are whole."""

    def __init__(self, port, most_bytes, stall=False):
        self._target = ("127.0.0.1", port)
        self._most_bytes = most_bytes
        self._stall = stall
        self.reached = threading.Event()  # the limit
        self._ended = threading.Event()
        self._sockets = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self._listener.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self):
        self._ended.set()
        for end in [self._listener, *self._sockets]:
            end.close()

    def _accept(self):
        budget = self._most_bytes
        while not self._ended.is_set():
            try:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._target)
            except OSError:
                return
            self._sockets += [client, server]
            threading.Thread(target=self._carry, args=(client, server, budget), daemon=True).start()
            threading.Thread(target=self._carry, args=(server, client, None), daemon=True).start()
            budget = None

    def _carry(self, source, sink, budget):
        try:
            while data := source.recv(1 << 16):
                if budget is not None and len(data) > budget:
                    sink.sendall(data[:budget])
                    self.reached.set()
                    if self._stall:
                        self._ended.wait()
                    break
                sink.sendall(data)
                if budget is not None:
                    budget -= len(data)
        except OSError:
            pass
        for end in (source, sink):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass


def stored_bytes(server):
    """Bytes of uploads on the server's disk, kept for good or not yet."""
    return sum(path.stat().st_size for path in server.data_dir.rglob("*.png"))


class UploadTest(harness.IntegrationTest):

    def setUp(self):
        super().setUp()
        self.sequence = self.folder / "noise"
        recording = harness.Recording(width=320, height=240, color_frames=25)
        generator = random.Random(1)
        for name in recording.files:
            if name.startswith("rgb/"):  # noise, which no compression makes small
                recording.files[name] = harness.png_of(320, 240, 8, 2, generator.randbytes(320 * 240 * 3))
        recording.write(self.sequence)
        self.size_bytes = sum(path.stat().st_size for path in self.sequence.rglob("*") if path.is_file())
        self.assertGreater(self.size_bytes, 4 << 20)  # several messages of 1 MiB

    def test_upload_survives_a_line_cut_at_any_byte(self):
        seed = 20240602
        print(f"seed {seed}")
        generator = random.Random(seed)
        for round_number in range(3):
            cut_at = generator.randrange(1000, self.size_bytes)
            with self.subTest(cut_at=cut_at), Server(self.folder / f"data{round_number}") as server:
                line = Line(server.port, cut_at)
                self.addCleanup(line.close)
                client = server.start_client("submit", str(self.sequence), server=line.address)
                _, stderr = client.communicate(timeout=harness.PATIENCE_S)
                self.assertTrue(line.reached.is_set())
                self.assertEqual(client.returncode, 0, stderr)
                sequence = server.client_json("list", "--sequences")["sequences"][0]
                self.assertEqual(sequence["state"], "STATE_READY")

    def test_killed_upload_goes_on_where_it_stopped(self):
        with Server(self.folder / "data", options=["--log-level", "debug"]) as server:
            line = Line(server.port, 3 << 20, stall=True)
            self.addCleanup(line.close)
            client = server.start_client("submit", str(self.sequence), server=line.address)
            self.addCleanup(lambda: client.poll() is None and client.kill())
            self.assertTrue(line.reached.wait(harness.PATIENCE_S))
            # What has passed the line may still lie unread before the server, and is lost with it.
            harness.wait_for("the first message to be stored", lambda: stored_bytes(server) >= 1 << 20)
            client.kill()
            client.communicate()
            line.close()
            # The server has noticed and kept what arrived.
            harness.wait_for("the end of the upload's stream", lambda: "WriteUpload" in server.log_text())
            result = server.client_json("submit", str(self.sequence))
            self.assertGreaterEqual(result["upload"]["foundBytes"], 1 << 20)
            self.assertLess(result["upload"]["foundBytes"], result["upload"]["totalBytes"])
            self.assertEqual(result["sequence"]["state"], "STATE_READY")

    def test_nobody_there(self):
        with socket.create_server(("127.0.0.1", 0)) as unused:
            port = unused.getsockname()[1]
        result = harness.run("depthtween", "submit", self.sequence, "--server", f"127.0.0.1:{port}", "--patience", 1)
        self.assertEqual(result.returncode, harness.EXIT_UNREACHABLE)
        self.assertIn("trying again for up to 1 s (--patience)", result.stderr)
        self.assertIn(f"127.0.0.1:{port}", result.stderr)
        self.assertIn("depthtween-server serve", result.stderr)


if __name__ == "__main__":
    harness.main()
