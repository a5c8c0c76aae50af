"""A client in another language: Node, from the .proto files alone (grpc_js/client.js, which checks what it is told).
This driver starts the server, kills it in the middle, and compares the frames with the local command's."""

import json
import os
import pathlib
import subprocess

import harness
from harness import Server

# The folder where `npm ci` has put the packages that package-lock.json pins.
NODE_CLIENT = pathlib.Path(os.environ["DEPTHTWEEN_NODE_CLIENT"])


class GrpcJsTest(harness.IntegrationTest):

    def node(self, server, step, *arguments):
        result = subprocess.run(
            ["node", "client.js", step, server.address, harness.SOURCE / "proto", *map(str, arguments)], cwd=NODE_CLIENT,
            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=2 * harness.PATIENCE_S)
        self.assertEqual(result.returncode, 0, result.stderr)
        return json.loads(result.stdout)

    def test_uploads_watches_and_streams(self):
        sequence, local = self.folder / "kick", self.folder / "local"
        harness.synth(sequence, frames=25)
        harness.upsample(sequence, local)
        with Server(self.folder / "data") as server:
            begun = self.node(server, "start-upload", sequence)
            server.kill()
            server.start()
            self.node(server, "finish-upload", sequence, begun["sequence"], begun["upload"], begun["committed"])
            done = self.node(server, "run-job", begun["sequence"])
            local_names = sorted(path.stem for path in (local / "depth").glob("*.png"))
            self.assertEqual(done["stems"], local_names)
            # The frames that Node decoded, as the command of this project fetches them.
            harness.check(server.client("fetch", done["job"], "-o", self.folder / "out"))
            self.assert_same_result(self.folder / "out", local)

    def test_misbehaving_clients_get_a_status(self):
        with Server(self.folder / "data") as server:
            self.node(server, "misbehave")
            self.assertTrue(server.is_serving())


if __name__ == "__main__":
    harness.main()
