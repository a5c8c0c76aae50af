"""The main job over HTTP alone, with curl: a recording goes up by PUT and by tus, also after a cut; a job runs and is
watched; frames, files and archives come down, in parts where a download broke. The truth is what
`depthtween-core upsample` writes on this machine."""

import base64
import io
import json
import shutil
import socket
import subprocess
import tempfile
import zipfile

import harness
from harness import Server

FRAMES = 17  # 240 fps colour, 30 fps depth: three depth frames


class HttpFilesTest(harness.IntegrationTest):

    @classmethod
    def setUpClass(cls):
        cls.shared = harness.pathlib.Path(tempfile.mkdtemp(prefix="depthtween_http_files_"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)
        cls.sequence = cls.shared / "kick"
        cls.local = cls.shared / "local"
        harness.synth(cls.sequence, FRAMES)
        harness.upsample(cls.sequence, cls.local)

    def setUp(self):
        super().setUp()
        self.server = Server(self.folder / "data", http=True)
        self.server.__enter__()
        self.addCleanup(self.server.__exit__)

    def curl(self, *arguments, expect=None):
        """What curl prints. `expect`: the status of the answer."""
        result = subprocess.run(["curl", "--silent", "--show-error", "--max-time", str(harness.PATIENCE_S),
                                 "--write-out", "%{stderr}status=%{http_code}", *map(str, arguments)],
                                stdin=subprocess.DEVNULL, capture_output=True, timeout=2 * harness.PATIENCE_S)
        self.assertEqual(result.returncode, 0, result.stderr)
        if expect is not None:
            self.assertIn(f"status={expect}".encode(), result.stderr, result.stdout)
        return result.stdout

    def url(self, path):
        return f"{self.server.http_address}/v1/{path}"

    def call(self, method, path, body=None):
        status, answer = self.server.http(method, f"/v1/{path}", body)
        self.assertEqual(status, 200, answer)
        return answer

    def upload_by_put(self, name, files):
        """One upload of these files, in three parts."""
        manifest = [{"path": file, "sizeBytes": (self.sequence / file).stat().st_size} for file in files]
        upload = self.call("POST", f"{name}/uploads", {"files": manifest})
        data = b"".join((self.sequence / file).read_bytes() for file in files)
        third = len(data) // 3
        for first, last in ((0, third), (third, 2 * third), (2 * third, len(data))):
            part = self.folder / "part"
            part.write_bytes(data[first:last])
            answer = self.curl("--upload-file", part, "--header", f"Content-Range: bytes {first}-{last - 1}/{len(data)}",
                               self.url(upload["name"]), expect=200)
            self.assertEqual(int(json.loads(answer)["committedSize"]), last)
        self.assertEqual(self.call("GET", upload["name"])["state"], "STATE_FINISHED")

    def upload_by_tus(self, name, file):
        """One file, over a connection that breaks in the middle."""
        data = (self.sequence / file).read_bytes()
        encoded = base64.b64encode(file.encode()).decode()
        headers = self.curl("--request", "POST", "--dump-header", "-", "--header", "Tus-Resumable: 1.0.0", "--header",
                            f"Upload-Length: {len(data)}", "--header", f"Upload-Metadata: path {encoded}",
                            self.url(f"{name}/uploads:tus"), expect=201).decode()
        location = next(line.split(": ", 1)[1] for line in headers.splitlines() if line.lower().startswith("location:"))
        half = len(data) // 2
        with socket.create_connection(("127.0.0.1", self.server.http_port)) as broken:
            broken.sendall(f"PATCH {location} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\n"
                           "Content-Type: application/offset+octet-stream\r\n"
                           f"Content-Length: {len(data)}\r\n\r\n".encode() + data[:half])

        upload = location.removeprefix("/v1/").removesuffix(":tus")
        head = self.curl("--head", "--header", "Tus-Resumable: 1.0.0", self.server.http_address + location,
                         expect=200).decode().lower()
        offset = int(next(line.split(": ")[1] for line in head.splitlines() if line.startswith("upload-offset:")))
        self.assertLessEqual(offset, half)
        rest = self.folder / "rest"
        rest.write_bytes(data[offset:])
        self.curl("--request", "PATCH", "--header", "Tus-Resumable: 1.0.0", "--header", f"Upload-Offset: {offset}",
                  "--header", "Content-Type: application/offset+octet-stream", "--data-binary", f"@{rest}",
                  self.server.http_address + location, expect=204)
        self.assertEqual(self.call("GET", upload)["state"], "STATE_FINISHED")

    def finished_job(self):
        name = self.call("POST", "sequences", {"displayName": "kick"})["name"]
        files = sorted(str(path.relative_to(self.sequence)) for path in self.sequence.rglob("*") if path.is_file())
        by_tus = next(file for file in files if file.startswith("rgb/"))
        self.upload_by_put(name, [file for file in files if file != by_tus])
        self.upload_by_tus(name, by_tus)
        self.call("POST", f"{name}:commit", {})
        harness.wait_for("the validation", lambda: self.call("GET", name)["state"] == "STATE_READY")
        job = self.call("POST", "jobs", {"sequence": name})["name"]
        events = self.curl("--no-buffer", "--header", "Accept: text/event-stream", self.url(f"{job}:watch"), expect=200)
        self.assertIn(b"STATE_SUCCEEDED", events)
        return job

    def test_a_recording_goes_up_and_its_result_comes_down(self):
        job = self.finished_job()
        outputs = f"{job}/outputs"

        # Every frame, and one of them in two parts.
        frames = sorted((self.local / "depth").glob("*.png"))
        for number, frame in enumerate(frames):
            data = self.curl(self.url(f"{outputs}/depth/frames/{number}.png"), expect=200)
            self.assertEqual(data, frame.read_bytes(), frame.name)
        partial = self.folder / "frame.png"
        self.curl("--range", "0-99", "--output", partial, self.url(f"{outputs}/depth/frames/3.png"), expect=206)
        self.assertEqual(partial.stat().st_size, 100)
        self.curl("--continue-at", "-", "--output", partial, self.url(f"{outputs}/depth/frames/3.png"), expect=206)
        self.assertEqual(partial.read_bytes(), frames[3].read_bytes())
        self.curl(self.url(f"{outputs}/depth/frames/{len(frames)}.png"), expect=404)

        # A file.
        camera = self.curl(self.url(f"{outputs}/camera:download"), expect=200)
        self.assertEqual(camera, (self.local / "camera.json").read_bytes())

        # An archive, whole and from where a download broke.
        archive = self.curl(self.url(f"{outputs}/depth.zip"), expect=200)
        with zipfile.ZipFile(io.BytesIO(archive)) as opened:
            self.assertIsNone(opened.testzip())
            self.assertEqual(sorted(opened.namelist()), [f"depth/{frame.name}" for frame in frames])
            for frame in frames:
                self.assertEqual(opened.read(f"depth/{frame.name}"), frame.read_bytes(), frame.name)
        partial = self.folder / "depth.zip"
        partial.write_bytes(archive[:len(archive) // 2])
        self.curl("--continue-at", "-", "--output", partial, self.url(f"{outputs}/depth.zip"), expect=206)
        self.assertEqual(partial.read_bytes(), archive)
        unzip = subprocess.run(["unzip", "-t", "-q", partial], capture_output=True, text=True)
        self.assertEqual(unzip.returncode, 0, unzip.stdout + unzip.stderr)

    def test_what_is_wrong_gets_a_status(self):
        name = self.call("POST", "sequences", {})["name"]
        self.curl(self.url("jobs/none/outputs/depth/frames/0.png"), expect=404)
        self.curl("--upload-file", __file__, self.url(f"{name}/uploads/none"), expect=404)
        self.curl("--request", "POST", self.url(f"{name}/uploads:tus"), expect=412)
        upload = self.call("POST", f"{name}/uploads", {"files": [{"path": "a", "sizeBytes": 4}]})["name"]
        self.curl("--request", "PUT", "--data-binary", "abcde", self.url(upload), expect=413)
        self.curl("--request", "PUT", "--data-binary", "cd", "--header", "Content-Range: bytes 2-3/4", self.url(upload),
                  expect=409)
        self.curl("--request", "DELETE", self.url(f"{upload}:tus"), expect=412)
        tus = ("--request", "DELETE", "--header", "Tus-Resumable: 1.0.0")
        self.curl(*tus, self.url(f"{upload}:tus"), expect=204)
        self.curl(*tus, self.url(f"{upload}:tus"), expect=404)
        self.curl("--request", "POST", self.url(f"{upload}:tus"), "--header", "Tus-Resumable: 1.0.0", expect=405)
        self.assertTrue(self.server.is_serving())


if __name__ == "__main__":
    harness.main()
