"""The HTTP listener under a client of tus that others wrote, tus-js-client on Node. The truth is the file itself: what the
server has stored in the end is compared byte for byte."""

import email.utils
import json
import os
import pathlib
import subprocess
import time

import harness
from harness import Server

# The folder where `npm ci` has put the packages that package-lock.json pins.
TUS_CLIENT = pathlib.Path(os.environ["DEPTHTWEEN_TUS_CLIENT"])
FILE_BYTES = 2_000_000


class TusJsTest(harness.IntegrationTest):

    def node(self, *arguments):
        result = subprocess.run(["node", "client.js", *map(str, arguments)], cwd=TUS_CLIENT, stdin=subprocess.DEVNULL,
                                capture_output=True, text=True, timeout=2 * harness.PATIENCE_S)
        self.assertEqual(result.returncode, 0, result.stderr)
        return json.loads(result.stdout)

    def test_uploads_whole_and_goes_on_after_a_cut(self):
        file = self.folder / "big.bin"
        file.write_bytes(bytes((i * i) % 251 for i in range(1000)) * (FILE_BYTES // 1000))
        with Server(self.folder / "data", http=True) as server:
            status, sequence = server.http("POST", "/v1/sequences", {})
            self.assertEqual(status, 200, sequence)
            endpoint = f"{server.http_address}/v1/{sequence['name']}/uploads:tus"

            whole = self.node("whole", endpoint, file, "whole.bin")
            self.assertEqual(whole["statuses"][0], "POST 201")
            self.assertEqual(set(whole["statuses"][1:]), {"PATCH 204"})

            cut = self.node("cut", endpoint, file, "cut.bin")
            self.assertLess(cut["acceptedBytes"], FILE_BYTES)
            upload = cut["url"].split("/v1/")[1].removesuffix(":tus")
            _, before = server.http("GET", f"/v1/{upload}")
            self.assertEqual(before["state"], "STATE_RECEIVING")
            resumed = self.node("resume", endpoint, file, "cut.bin", cut["url"])
            self.assertEqual(resumed["statuses"][0], "HEAD 200")
            self.assertGreaterEqual(resumed["firstOffset"], cut["acceptedBytes"])
            _, after = server.http("GET", f"/v1/{upload}")
            self.assertEqual(after["state"], "STATE_FINISHED")

            # Taken back: nothing of it is left, and its name is free.
            gone = self.node("terminate", endpoint, file, "gone.bin")
            self.assertEqual(gone["statuses"][-1], "DELETE 204")
            upload = gone["url"].split("/v1/")[1].removesuffix(":tus")
            self.assertEqual(server.http("GET", f"/v1/{upload}")[0], 404)
            self.assertGreater(email.utils.parsedate_to_datetime(gone["expires"]).timestamp(), time.time())

            stored = {path.name: path.read_bytes() for path in server.data_dir.rglob("*.bin")}
            self.assertEqual(sorted(stored), ["cut.bin", "whole.bin"])
            for name, data in stored.items():
                self.assertEqual(data, file.read_bytes(), name)


if __name__ == "__main__":
    harness.main()
