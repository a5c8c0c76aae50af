"""Clients that use a server which is killed all the time. Each repeats lives of recordings: upload, commit, jobs that are
waited for, cancelled, tried again, fetched, deleted. A client asks again until it has an answer, and says in the ledger
what it asks and what was acknowledged."""

import base64
import hashlib
import http.client
import json
import pathlib
import random
import shutil
import threading
import time
import traceback
import urllib.parse
import uuid

import harness
from ledger import Job, Sequence

ENDED = ("STATE_SUCCEEDED", "STATE_FAILED", "STATE_CANCELLED")

# What jobs compute, as the command line and as the interface say it.
RESULTS = {
    "hold": (["--method", "hold"], {"method": "hold"}),
    "fast": (["--preset", "fast"], {"preset": "fast"}),
}


class Answer:

    def __init__(self, status, body, headers, attempts):
        self.status, self.body, self.headers = status, body, headers
        self.attempts = attempts  # more than one: an earlier request may have been carried out, its answer lost

    def json(self):
        return json.loads(self.body)


class Api:
    """HTTP, again and again until the server answers."""

    def __init__(self, server):
        self._server = server

    def send(self, method, path, body=None, headers=None):
        """One request. OSError or HTTPException if the server went away."""
        connection = http.client.HTTPConnection("127.0.0.1", self._server.http_port, timeout=harness.PATIENCE_S)
        try:
            connection.request(method, path, body, headers or {})
            response = connection.getresponse()
            return Answer(response.status, response.read(), response.headers, 1)
        finally:
            connection.close()

    def call(self, method, resource, body=None, **query):
        """JSON. Returns what was answered at last, whatever its status but 503."""
        path = f"/v1/{resource}" + (f"?{urllib.parse.urlencode(query)}" if query else "")
        data = None if body is None else json.dumps(body).encode()
        headers = {} if data is None else {"Content-Type": "application/json"}
        attempts = 0
        deadline = time.monotonic() + harness.PATIENCE_S
        while True:
            attempts += 1
            try:
                answer = self.send(method, path, data, headers)
                if answer.status != 503:
                    answer.attempts = attempts
                    return answer
            except (OSError, http.client.HTTPException):
                pass
            if time.monotonic() > deadline:
                raise AssertionError(f"no answer to {method} {path} in {harness.PATIENCE_S} s")
            time.sleep(0.05)

    def must(self, method, resource, body=None, **query):
        answer = self.call(method, resource, body, **query)
        if answer.status != 200:
            raise AssertionError(f"{method} {resource}: {answer.status} {answer.body[:500]!r}")
        return answer.json()

    def get(self, name):
        """The resource, or None if there is none."""
        answer = self.call("GET", name)
        if answer.status == 404:
            return None
        if answer.status != 200:
            raise AssertionError(f"GET {name}: {answer.status} {answer.body[:500]!r}")
        return answer.json()

    def list(self, kind):
        return {item["name"]: item for item in self._pages(kind)}

    def _pages(self, kind):
        token = ""
        while True:
            page = self.must("GET", kind, pageSize=1000, pageToken=token)
            yield from page.get(kind, [])
            token = page.get("nextPageToken", "")
            if not token:
                return


class Client(threading.Thread):
    """One after another, lives of recordings, until `ending` is set."""

    def __init__(self, number, server, ledger, clips, folder, seed, ending):
        super().__init__(name=f"client-{number}", daemon=True)
        self.random = random.Random(f"{seed}/{number}")
        self.server = server
        self.api = Api(server)
        self.ledger = ledger
        self.clips = clips
        self.folder = pathlib.Path(folder) / self.name
        self.ending = ending
        self.phase = "between"  # read by the driver when it kills
        self.fetched = 0

    def run(self):
        while not self.ending.is_set():
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.mkdir(parents=True)
            try:
                self.life()
            except Exception:  # pylint: disable=broad-except
                self.ledger.loses(f"{self.name} in {self.phase}: {traceback.format_exc()}")
                time.sleep(1)
            self.phase = "between"

    def life(self):
        raise NotImplementedError

    # What all kinds of clients do with a job that is there.

    def follow_job(self, name):
        # The first one is followed to its end, so that every run has results to compare.
        if self.fetched > 0 and self.random.random() < 0.3:
            time.sleep(self.random.random() * 0.5)
            self.cancel(name)
            if self.random.random() < 0.5:
                self.retry(name)
        job = self.wait_until_ended(name)
        if job["state"] == "STATE_SUCCEEDED" and (self.fetched == 0 or self.random.random() < 0.5):
            self.fetch(name)
        if self.random.random() < 0.4:
            self.delete(name)

    def cancel(self, name):
        self.phase = "cancel"
        self.ledger.asks("cancel", name, cancel_asked=True)
        answer = self.api.call("POST", f"{name}:cancel", {})
        if answer.status == 200:
            self.ledger.acknowledges("cancel", name, cancelled=True)
        elif answer.json()["details"] is None or self.api.get(name)["state"] not in ENDED:
            raise AssertionError(f"cancel {name}: {answer.status} {answer.body[:500]!r}")

    def retry(self, name):
        job = self.wait_until_ended(name)
        if job["state"] != "STATE_CANCELLED":
            return
        self.phase = "retry"
        self.ledger.asks("retry", name, retry_asked=True)
        answer = self.api.call("POST", f"{name}:retry", {})
        # Refused after an answer that was lost: it runs, or has ended, already.
        if answer.status != 200 and answer.attempts == 1:
            raise AssertionError(f"retry {name}: {answer.status} {answer.body[:500]!r}")
        self.ledger.acknowledges("retry", name, retried=True)

    def wait_until_ended(self, name):
        self.phase = "job runs"

        def ended():
            job = self.api.get(name)
            if job is None:
                raise AssertionError(f"{name} is lost")
            if job["state"] == "STATE_FAILED":
                raise AssertionError(f"{name} failed: {job['error']}")
            return job if job["state"] in ENDED else None

        job = harness.wait_for(f"the end of {name}", ended)
        if job["state"] == "STATE_SUCCEEDED":
            self.ledger.acknowledges("wait", name, succeeded=True)
        return job

    def fetch(self, name):
        self.phase = "fetch"
        out = self.folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        harness.check(self.server.client("fetch", name, "-o", out))
        self.compare(name, out)
        self.ledger.acknowledges("fetch", name)

    def compare(self, name, out):
        job = self.ledger.jobs[name]
        clip = self.ledger.sequences[job.sequence].clip
        ours, theirs = harness.result_files(out), self.clips[clip].references[job.result]
        differing = [file for file in sorted(ours.keys() | theirs.keys()) if ours.get(file) != theirs.get(file)]
        if differing:
            raise AssertionError(f"{name} ({job.result} of {clip}): not the bits of depthtween-core: {differing}")
        self.fetched += 1

    def delete(self, name):
        self.phase = "delete"
        self.ledger.asks("delete", name, delete_asked=True)
        answer = self.api.call("DELETE", name)
        if answer.status != 200 and not (answer.status == 404 and answer.attempts > 1):
            raise AssertionError(f"DELETE {name}: {answer.status} {answer.body[:500]!r}")
        self.ledger.acknowledges("delete", name, deleted=True)

    def delete_sequence_perhaps(self, name):
        """A recording may go once its jobs have ended; they outlive it."""
        if self.random.random() < 0.5:
            self.delete(name)


class GrpcClient(Client):
    """With the program `depthtween`."""

    def life(self):
        clip = self.random.choice(sorted(self.clips))
        recording = self.folder / "recording"
        shutil.copytree(self.clips[clip].folder, recording)
        # The client makes the same recording the same sequence: blanks at the end make it another one.
        with open(recording / "camera.json", "a", encoding="utf-8") as camera:
            camera.write(" " * self.random.randrange(1 << 16) + "\n")
        result = self.random.choice(sorted(RESULTS))
        self.phase = "submit"
        self.ledger.marks(event="asks", operation="submit", client=self.name)
        submitted = self.server.client_json("submit", recording, *RESULTS[result][0])
        sequence, job = submitted["sequence"]["name"], submitted["job"]["name"]
        self.ledger.makes("submit", sequence, Sequence(clip=clip, committed=True, ready=True))
        self.ledger.makes("create job", job, Job(sequence=sequence, result=result))
        self.follow_job(job)
        self.delete_sequence_perhaps(sequence)

    def delete(self, name):
        self.phase = "delete"
        self.ledger.asks("delete", name, delete_asked=True)
        deleted = self.server.client("delete", name)
        # The program asks again by itself, and may then find nothing.
        if deleted.returncode != 0 and f"there is no {name}" not in deleted.stderr:
            raise AssertionError(f"delete {name}: {deleted.stderr}")
        self.ledger.acknowledges("delete", name, deleted=True)


class HttpClient(Client):
    """JSON over HTTP, and bytes in pieces by `send_piece`."""

    def life(self):
        clip = self.random.choice(sorted(self.clips))
        files = self.clips[clip].files
        sequence = self.create_sequence(clip)
        paths = sorted(files)
        cut = self.random.randrange(1, len(paths))
        for part in (paths[:cut], paths[cut:]):
            if not self.upload(sequence, {path: files[path] for path in part}):
                if self.random.random() < 0.7:
                    self.delete(sequence)
                return
        self.phase = "commit"
        self.ledger.asks("commit", sequence)
        self.api.must("POST", f"{sequence}:commit", {})
        self.ledger.acknowledges("commit", sequence, committed=True)
        if self.random.random() < 0.1:
            self.delete(sequence)
            return
        self.wait_until_ready(sequence)
        jobs = [self.create_job(sequence) for _ in range(self.random.choice((1, 1, 2)))]
        for job in jobs:
            self.follow_job(job)
        self.delete_sequence_perhaps(sequence)

    def create_sequence(self, clip):
        self.phase = "create sequence"
        request = str(uuid.UUID(int=self.random.getrandbits(128)))
        self.ledger.marks(event="asks", operation="create sequence", request=request)
        name = self.api.must("POST", "sequences", {"displayName": clip}, requestId=request)["name"]
        self.ledger.makes("create sequence", name, Sequence(clip=clip))
        return name

    def create_job(self, sequence):
        self.phase = "create job"
        result = self.random.choice(sorted(RESULTS))
        request = str(uuid.UUID(int=self.random.getrandbits(128)))
        self.ledger.marks(event="asks", operation="create job", request=request)
        name = self.api.must("POST", "jobs", {"sequence": sequence, "options": RESULTS[result][1]},
                             requestId=request)["name"]
        self.ledger.makes("create job", name, Job(sequence=sequence, result=result))
        return name

    def wait_until_ready(self, sequence):
        self.phase = "validate"

        def ready():
            record = self.api.get(sequence)
            if record is None or record["state"] == "STATE_INVALID":
                raise AssertionError(f"{sequence} was good, and is now {record}")
            return record["state"] == "STATE_READY"

        harness.wait_for(f"{sequence} to be READY", ready)
        self.ledger.acknowledges("validation", sequence, ready=True)

    def upload(self, sequence, files):
        """False if the client lost interest on the way, as some do."""
        self.phase = "start upload"
        manifest = [{"path": path, "sizeBytes": len(data),
                     "sha256": base64.b64encode(hashlib.sha256(data).digest()).decode()}
                    for path, data in files.items()]
        upload = self.api.must("POST", f"{sequence}/uploads", {"files": manifest},
                               requestId=str(uuid.UUID(int=self.random.getrandbits(128))))["name"]
        self.ledger.stores(sequence, upload, 0)
        self.phase = "upload"
        data = b"".join(files.values())
        interested = self.random.random() > 0.05
        while True:
            offset = self.committed_bytes(sequence, upload)
            if offset == len(data):
                return True
            if not interested and offset > 0:
                return False
            piece = data[offset:offset + self.random.randrange(1, 5000)]
            self.ledger.marks(event="asks", operation="bytes", name=upload, first=offset, size=len(piece))
            try:
                answer = self.send_piece(upload, offset, piece, len(data))
            except (OSError, http.client.HTTPException):
                continue
            if answer.status in (200, 204):
                self.ledger.stores(sequence, upload, offset + len(piece))
            elif answer.status not in (409, 503):
                raise AssertionError(f"{upload} at {offset}: {answer.status} {answer.body[:500]!r}")

    def committed_bytes(self, sequence, upload):
        offset = int(self.api.must("GET", upload).get("committedSize", 0))
        owed = self.ledger.sequences[sequence].uploads[upload].acknowledged_bytes
        if offset < owed:
            raise AssertionError(f"{upload}: {owed} bytes were acknowledged, {offset} are there")
        return offset

    def send_piece(self, upload, offset, piece, size):
        raise NotImplementedError


class PutClient(HttpClient):

    def send_piece(self, upload, offset, piece, size):
        return self.api.send("PUT", f"/v1/{upload}", piece,
                             {"Content-Range": f"bytes {offset}-{offset + len(piece) - 1}/{size}"})


class TusClient(HttpClient):

    def send_piece(self, upload, offset, piece, size):
        checksum = base64.b64encode(hashlib.sha256(piece).digest()).decode()
        return self.api.send("PATCH", f"/v1/{upload}:tus", piece,
                             {"Tus-Resumable": "1.0.0", "Upload-Offset": str(offset),
                              "Upload-Checksum": f"sha256 {checksum}",
                              "Content-Type": "application/offset+octet-stream"})
