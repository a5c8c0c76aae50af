"""Recordings that come as one zip archive: over HTTP and gRPC, by the packers of others, hostile ones, and with the server
killed while it unpacks. The truth is the folder that was packed: the server must store its files, byte for byte."""

import contextlib
import io
import pathlib
import random
import shutil
import stat
import time
import urllib.request
import zipfile

import harness
from harness import Recording, Server, check


def packed(files, compression=zipfile.ZIP_DEFLATED):
    """An archive of (name or ZipInfo, bytes), in this order."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", compression) as opened:
        for name, data in files:
            opened.writestr(name, data)
    return archive.getvalue()


def link(name, target):
    info = zipfile.ZipInfo(name)
    info.create_system = 3
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info, target


class ArchiveTest(harness.IntegrationTest):

    def setUp(self):
        super().setUp()
        self.sequence = self.folder / "clip"
        Recording(color_frames=5).write(self.sequence)
        self.files = {str(path.relative_to(self.sequence)): path.read_bytes()
                      for path in sorted(self.sequence.rglob("*")) if path.is_file()}

    def upload(self, server, archive, name="clip.zip"):
        """By PUT. Returns the sequence's name, committed."""
        sequence = server.http("POST", "/v1/sequences", {})[1]["name"]
        status, upload = server.http("POST", f"/v1/{sequence}/uploads",
                                     {"files": [{"path": name, "sizeBytes": len(archive)}]})
        self.assertEqual(status, 200, upload)
        request = urllib.request.Request(f"{server.http_address}/v1/{upload['name']}", data=archive, method="PUT")
        with urllib.request.urlopen(request, timeout=harness.PATIENCE_S) as answer:
            self.assertEqual(answer.status, 200)
        status, committed = server.http("POST", f"/v1/{sequence}:commit", {})
        self.assertEqual(status, 200, committed)
        return sequence

    def validated(self, server, sequence):

        def ended():
            found = server.http("GET", f"/v1/{sequence}")[1]
            return found if found["state"] != "STATE_VALIDATING" else None

        return harness.wait_for("the validation", ended)

    def stored(self, server, sequence):
        folder = server.data_dir / sequence
        return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}

    def test_a_packed_folder_is_the_folder(self):
        packers = {
            "deflated": packed(self.files.items()),
            "stored": packed(self.files.items(), zipfile.ZIP_STORED),
            "with a folder on top, as a Mac packs": packed(
                [("clip/", b""), *(("clip/" + name, data) for name, data in self.files.items()),
                 ("__MACOSX/clip/._rgb.txt", b"mac"), ("clip/.DS_Store", b"mac")]),
            "shutil": pathlib.Path(shutil.make_archive(self.folder / "made", "zip", self.folder, "clip")).read_bytes(),
        }
        with Server(self.folder / "data", http=True) as server:
            for name, archive in packers.items():
                with self.subTest(name):
                    sequence = self.upload(server, archive, "Clip one.ZIP")
                    found = self.validated(server, sequence)
                    self.assertEqual(found["state"], "STATE_READY", found)
                    self.assertEqual(found["fileCount"], len(self.files))
                    self.assertEqual(int(found["sizeBytes"]), sum(map(len, self.files.values())))
                    self.assertEqual(self.stored(server, sequence), self.files)
            # Computed from, checked, deleted like any other.
            job = server.http("POST", "/v1/jobs", {"sequence": sequence})[1]["name"]
            harness.wait_for("the job", lambda: server.http("GET", f"/v1/{job}")[1]["state"] == "STATE_SUCCEEDED")
            check(harness.run("depthtween-server", "scrub", "--data-dir", server.data_dir))
            self.assertEqual(server.http("DELETE", f"/v1/{sequence}")[0], 200)
            self.assertFalse((server.data_dir / sequence).exists())
            # The client sends one over gRPC.
            archive = self.folder / "clip.zip"
            archive.write_bytes(packers["deflated"])
            out, reference = self.folder / "out", self.folder / "reference"
            check(server.client("submit", archive, "--wait", "-o", out))
            harness.upsample(self.sequence, reference)
            self.assert_same_result(out, reference)

    def test_hostile_archives_are_refused(self):
        files = list(self.files.items())
        bomb = bytes(4 << 20)
        hostile = {
            "leaves its folder": packed([*files, ("../../evil", b"x")]),
            "is absolute": packed([*files, ("/tmp/evil", b"x")]),
            "a link": packed([*files, link("rgb/link.png", "/etc/passwd")]),
            "twice": packed([*files, ("RGB.TXT", b"x")]),
            "more bytes than are allowed": packed([*files, *((f"{i}", bomb) for i in range(5))]),
            "more files than are allowed": packed([*files, *((f"{i}", b"") for i in range(100))]),
            "a name that no sequence has": packed([*files, ("rgb/a:b.png", b"x")]),
            "no archive": b"PK but not really",
            "without files": packed([("clip/", b"")]),
            "cut off": packed(files)[:-30],
            "damaged": packed(files, zipfile.ZIP_STORED).replace(self.files["rgb.txt"], self.files["rgb.txt"][::-1]),
            "encrypted": packed(files).replace(b"PK\x01\x02\x14\x03\x14\x00\x00", b"PK\x01\x02\x14\x03\x14\x00\x01"),
        }
        limits = ["--max-sequence-bytes", str(16 << 20), "--max-files-per-sequence", "100"]
        with Server(self.folder / "data", http=True, options=limits) as server:
            for name, archive in hostile.items():
                with self.subTest(name):
                    sequence = self.upload(server, archive)
                    found = self.validated(server, sequence)
                    self.assertEqual(found["state"], "STATE_INVALID", found)
                    self.assertTrue(found["violations"], found)
                    self.assertTrue(found["violations"][0]["status"]["message"], found)
                    self.assertNotIn(str(server.data_dir), str(found))
                    self.assertEqual(self.stored(server, sequence), {"clip.zip": archive}, "nothing else is left")
                    self.assertFalse(list(self.folder.rglob("evil")))
            self.assertTrue(server.is_serving())

    def test_a_killed_server_unpacks_again(self):
        seed = 16
        choose = random.Random(seed)
        padding = choose.randbytes(200_000)  # so that unpacking takes a while
        archive = packed([*self.files.items(), *((f"extra/{i}", padding) for i in range(60))], zipfile.ZIP_STORED)
        expected = {**self.files, **{f"extra/{i}": padding for i in range(60)}}
        with Server(self.folder / "data", http=True) as server:
            for moment in range(6):
                with self.subTest(moment=moment, seed=seed):
                    sequence = self.upload(server, archive)
                    time.sleep(choose.uniform(0, 0.25))
                    server.kill()
                    server.start()
                    found = self.validated(server, sequence)
                    self.assertEqual(found["state"], "STATE_READY", found)
                    self.assertEqual(sorted(self.stored(server, sequence)), sorted(expected))
                    self.assertEqual(self.stored(server, sequence), expected)
            with contextlib.suppress(FileNotFoundError):
                self.assertEqual([path.name for path in (server.data_dir / "tasks").iterdir()], [])


if __name__ == "__main__":
    harness.main()
