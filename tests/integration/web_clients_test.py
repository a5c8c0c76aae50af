"""Programs of others on what this project offers the web: connect-web calls the HTTP listener by gRPC-Web, openapi-typescript
and Redocly read /openapi.json, buf reads the .proto files. The truth is the command line's own result, and what each program
says of what is wrong on purpose."""

import hashlib
import json
import os
import pathlib
import shutil
import subprocess

import harness
from harness import Recording, Server, check, run

# The folder where `npm ci` has put the packages that package-lock.json pins.
CLIENTS = pathlib.Path(os.environ["DEPTHTWEEN_WEB_CLIENTS"])
PROGRAMS = CLIENTS / "node_modules" / ".bin"
PROTO = harness.SOURCE / "proto"


class WebClientsTest(harness.IntegrationTest):

    def program(self, *words, folder=CLIENTS):
        # buf keeps a cache in the home folder.
        surroundings = {**os.environ, "HOME": str(self.folder), "XDG_CACHE_HOME": str(self.folder)}
        return subprocess.run([str(word) for word in words], cwd=folder, stdin=subprocess.DEVNULL, capture_output=True,
                              text=True, timeout=2 * harness.PATIENCE_S, env=surroundings)

    def node(self, *words):
        return json.loads(check(self.program("node", "client.js", *words)).stdout)

    def test_a_job_by_grpc_web(self):
        sequence, local = self.folder / "clip", self.folder / "local"
        Recording().write(sequence)
        harness.upsample(sequence, local)
        tokens, secret = self.folder / "tokens.json", self.folder / "secret"
        made = check(run("depthtween-server", "token", "new", "--tokens", tokens, "--tenant", "studio", "--scopes",
                         "read,write"))
        secret.write_text(made.stdout.splitlines()[-1])
        descriptors = self.folder / "api.binpb"
        check(self.program(PROGRAMS / "buf", "build", PROTO, "-o", descriptors))
        with Server(self.folder / "data", http=True, options=["--tokens", tokens]) as server:
            first = check(server.client("submit", sequence, "--wait", "--token-file", secret)).stdout
            name = server.http("GET", "/v1/sequences", headers={"Authorization": f"Bearer {secret.read_text()}"})
            found = self.node("calls", server.http_address, descriptors, secret.read_text(),
                              name[1]["sequences"][0]["name"])
            self.assertEqual(found["failures"], {
                "stranger": {"code": "Unauthenticated", "reason": "NO_TOKEN"},
                "missing": {"code": "NotFound", "reason": "NO_SUCH_RESOURCE"},
                "malformed": {"code": "InvalidArgument", "reason": "BAD_FIELD", "fields": ["name"]},
                "stream": {"code": "NotFound", "reason": "NO_SUCH_RESOURCE"},
            })
            self.assertEqual(found["state"], 4, "SUCCEEDED")
            self.assertGreater(found["events"], 1)
            self.assertEqual(found["listed"][0], found["job"])
            self.assertIn(found["listed"][1], first)
            self.assertEqual(found["frames"], [hashlib.sha256(frame.read_bytes()).hexdigest()
                                               for frame in sorted((local / "depth").glob("*.png"))])

    def test_the_openapi_document_is_one(self):
        document = self.folder / "openapi.json"
        with Server(self.folder / "data", http=True) as server:
            document.write_text(json.dumps(server.http("GET", "/openapi.json")[1]))
        self.assertEqual(self.node("lint", document)["problems"], [])
        broken = json.loads(document.read_text())
        broken["paths"]["/v1/jobs"]["get"]["responses"]["200"]["content"] = [7]
        (self.folder / "broken.json").write_text(json.dumps(broken))
        self.assertTrue(self.node("lint", self.folder / "broken.json")["problems"], "the linter finds what is wrong")

        types = self.folder / "types"
        types.mkdir()
        check(self.program("node", PROGRAMS / "openapi-typescript", document, "--output", types / "types.d.ts"))
        shutil.copy(CLIENTS / "use.ts", types)
        check(self.program("node", PROGRAMS / "tsc", "--noEmit", "--strict", types / "use.ts"))

    def test_the_interface_is_in_order(self):
        check(self.program(PROGRAMS / "buf", "lint", PROTO))
        # Against itself, and against one that had what this one lacks.
        check(self.program(PROGRAMS / "buf", "breaking", PROTO, "--against", PROTO))
        before = self.folder / "before"
        shutil.copytree(PROTO, before)
        file = before / "depthtween" / "v1" / "sequence.proto"
        file.write_text(file.read_text().replace("message Sequence {", "message Sequence {\n  string colour = 77;\n", 1))
        broken = self.program(PROGRAMS / "buf", "breaking", PROTO, "--against", before)
        self.assertNotEqual(broken.returncode, 0)
        self.assertIn('field "77" with name "colour"', broken.stdout + broken.stderr)

    def test_what_was_released_still_holds(self):
        tags = self.program("git", "tag", "--list", "v*", "--sort=-version:refname", folder=harness.SOURCE)
        released = tags.stdout.split() if tags.returncode == 0 else []
        if not released:
            self.skipTest("nothing was released yet")
        check(self.program(PROGRAMS / "buf", "breaking", PROTO, "--against",
                           f"{harness.SOURCE}/.git#tag={released[0]},subdir=proto"))


if __name__ == "__main__":
    harness.main()
