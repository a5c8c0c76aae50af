#!/usr/bin/env python3
"""What the server costs beside the work itself, and how it bears load. Ratios within one run; figures stand in SERVER.md.

    DEPTHTWEEN_BIN=build/dev/bin python3 tests/bench/server_load.py small
    DEPTHTWEEN_BIN=build/dev/bin python3 tests/bench/server_load.py queue
    ninja -C build/dev server_load_client
    DEPTHTWEEN_BIN=build/dev/bin python3 tests/bench/server_load.py transfer
    DEPTHTWEEN_BIN=build/dev/bin python3 tests/bench/server_load.py streams

small  Jobs on clips of 17 and 65 frames, and on one of 10 s at 240 fps, beside `depthtween-core upsample` on the same
       clip with the same threads: one worker, one thread. Job: from its creation to its end, by the server's clock.
queue  A cancellation while 500 clients watch queued jobs, beside one while nobody watches; and GetJob while 4 clients
       list 1,000 jobs, beside GetJob alone.
transfer  An upload, and a stream of frames, beside the same messages to and from a gRPC server that does nothing else,
          and beside a file of that size written and synced, which no upload that is acknowledged can overtake.
streams   GetJob, health and the server's memory with 1,000 idle watchers and 200 readers of frames that stop reading,
       beside those without.
"""

import argparse
import contextlib
import datetime
import http.client
import json
import os
import pathlib
import random
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "integration"))

import harness  # pylint: disable=wrong-import-position

ENDED = ("STATE_SUCCEEDED", "STATE_FAILED", "STATE_CANCELLED")


def seconds(work):
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def to_time(text):
    """Of RFC 3339 with any number of digits."""
    whole, _, fraction = text.rstrip("Z").partition(".")
    return datetime.datetime.fromisoformat(whole).timestamp() + float(f"0.{fraction or 0}")


class Client:
    """One connection to the HTTP listener, kept."""

    def __init__(self, server):
        self._connection = http.client.HTTPConnection("127.0.0.1", server.http_port, timeout=harness.PATIENCE_S)

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body)
        self._connection.request(method, path, data, {} if data is None else {"Content-Type": "application/json"})
        response = self._connection.getresponse()
        answer = json.loads(response.read())
        if response.status != 200:
            raise AssertionError(f"{method} {path}: {response.status} {answer}")
        return answer


def upload(server, folder):
    """The name of a sequence that is READY: that of a job that was submitted and has ended."""
    harness.check(server.client("submit", folder, "--wait", "--method", "hold"))
    return Client(server).call("GET", "/v1/sequences")["sequences"][0]["name"]


def run_job(client, sequence):
    """The seconds that a job took."""
    job = client.call("POST", "/v1/jobs", {"sequence": sequence})
    while job["state"] not in ENDED:
        time.sleep(0.01)
        job = client.call("GET", f"/v1/{job['name']}")
    if job["state"] != "STATE_SUCCEEDED":
        raise AssertionError(job)
    return to_time(job["endTime"]) - to_time(job["createTime"])


def small(folder, arguments):
    print("| clip | local, s | job, s | job / local | upload, validation and job / local |")
    print("|---|---|---|---|---|")
    for frames, size, rounds in ((17, "160x120", arguments.rounds), (65, "160x120", arguments.rounds),
                                 (2401, "64x48", 1))[:2 if arguments.short else 3]:
        clip = folder / f"clip{frames}"
        harness.synth(clip, frames, size=size)
        with harness.Server(folder / f"data{frames}", http=True) as server:
            local, job, whole = [], [], []
            sequence = upload(server, clip)
            for i in range(rounds):
                local.append(seconds(lambda i=i: harness.upsample(clip, folder / f"out{frames}_{i}", "--threads", "1")))
                job.append(run_job(Client(server), sequence))
            with harness.Server(folder / f"new{frames}") as new:
                whole.append(seconds(lambda: harness.check(new.client("submit", clip, "--wait"))))
        medians = [statistics.median(values) for values in (local, job, whole)]
        print(f"| {frames} frames of {size} | {medians[0]:.2f} | {medians[1]:.2f} | {medians[1] / medians[0]:.2f} | "
              f"{medians[2] / medians[0]:.2f} |", flush=True)


def show(what, alone, loaded):
    for name, share in (("median", 0.5), ("99th percentile", 0.99)):
        values = [each[min(len(each) - 1, int(share * len(each)))] for each in (alone, loaded)]
        print(f"| {what}, {name} | {values[0]:.2f} | {values[1]:.2f} | {values[1] / values[0]:.2f} |", flush=True)


def watch(server, job):
    """A socket that follows a job and has had its snapshot."""
    connection = socket.create_connection(("127.0.0.1", server.http_port), timeout=harness.PATIENCE_S)
    connection.sendall(f"GET /v1/{job}:watch HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream\r\n\r\n".encode())
    seen = b""
    while b"data:" not in seen:
        piece = connection.recv(1 << 16)
        if not piece:
            raise AssertionError(f"the watch of {job} ended with {seen}")
        seen += piece
    return connection


def drain(connections, stop):
    while not stop.is_set():
        for connection in connections:
            with contextlib.suppress(BlockingIOError):
                connection.recv(1 << 16)
        stop.wait(0.2)


def queue(folder, arguments):
    harness.synth(folder / "clip", 17)
    harness.synth(folder / "long", 241)
    options = ("--max-streams", "2000", "--max-streams-of-client", "2000", "--max-queued-jobs", "3000")
    print("| | alone, ms | loaded, ms | ratio |")
    print("|---|---|---|---|")
    with harness.Server(folder / "data", options=options, http=True) as server:
        long = Client(server).call("POST", "/v1/jobs", {
            "sequence": upload(server, folder / "long"), "options": {"method": "dolson"}})
        client = Client(server)
        sequence = upload_only(server, folder / "clip", client)
        harness.wait_for("the long job to run", lambda: client.call("GET", f"/v1/{long['name']}")["state"] ==
                         "STATE_RUNNING")
        jobs = [client.call("POST", "/v1/jobs", {"sequence": sequence})["name"] for _ in range(1000)]

        def cancel(some):
            return sorted(1000 * seconds(lambda job=job: client.call("POST", f"/v1/{job}:cancel", {})) for job in some)

        alone = cancel(jobs[:40])
        watched = [watch(server, job) for job in jobs[100:100 + arguments.watchers]]
        for connection in watched:
            connection.setblocking(False)
        stop = threading.Event()
        reader = threading.Thread(target=drain, args=(watched, stop))
        reader.start()
        show(f"CancelJob, {arguments.watchers} watch queued jobs", alone, cancel(jobs[40:80]))
        stop.set()
        reader.join()
        for connection in watched:
            connection.close()

        alone, stop = load_client("get", server.address, jobs[-1], "2000"), threading.Event()

        def list_jobs():
            other = Client(server)
            while not stop.is_set():
                other.call("GET", "/v1/jobs?pageSize=1000")

        listers = [threading.Thread(target=list_jobs) for _ in range(4)]
        for lister in listers:
            lister.start()
        loaded = load_client("get", server.address, jobs[-1], "500")
        for name, key in (("median", "median"), ("99th percentile", "p99")):
            print(f"| GetJob, 4 clients list 1,000 jobs, {name} | {alone[key]:.2f} | {loaded[key]:.2f} | "
                  f"{loaded[key] / alone[key]:.2f} |", flush=True)
        stop.set()
        for lister in listers:
            lister.join()


def upload_only(server, folder, client):
    """The name of a sequence that is READY, of which no job needs to have run."""
    known = {entry["name"] for entry in client.call("GET", "/v1/sequences").get("sequences", [])}
    harness.check(server.client("submit", folder))
    name, = {entry["name"] for entry in client.call("GET", "/v1/sequences")["sequences"]} - known
    harness.wait_for("the recording to be checked", lambda: client.call("GET", f"/v1/{name}")["state"] == "STATE_READY")
    return name


def load_client(*arguments):
    return json.loads(harness.check(harness.run("server_load_client", *arguments)).stdout)


class Held:
    """Streams that are held open."""

    def __init__(self, what, server, name, count):
        self._process = subprocess.Popen([harness.BIN / "server_load_client", what, server.address, name, str(count)],
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.open = json.loads(self._process.stdout.readline() or '{"open": 0}')["open"]
        if self.open != count:
            raise AssertionError(f"{what}: {self.open} of {count} streams")

    def close(self):
        self._process.stdin.close()
        self._process.wait(timeout=harness.PATIENCE_S)


def resident_kib(server):
    for line in pathlib.Path(f"/proc/{server.process.pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1])
    raise AssertionError("no VmRSS")


def write_durably(file, mib):
    """MiB a second of the file system alone, synced as often as the server does (kFlushBytes of server/jobs)."""
    data = random.randbytes(16 << 20)

    def write():
        with open(file, "wb", buffering=0) as out:
            for _ in range(mib // 16):
                out.write(data)
                os.fdatasync(out.fileno())

    rate = mib / seconds(write)
    file.unlink()
    return rate


def transfer(folder, arguments):
    harness.synth(folder / "clip", 97, size="640x480")
    print("| | bare gRPC, MiB/s | disk alone, MiB/s | server, MiB/s | server / bare |")
    print("|---|---|---|---|---|")
    with harness.Server(folder / "data", http=True) as server:
        upload(server, folder / "clip")
        job = Client(server).call("GET", "/v1/jobs")["jobs"][0]["name"]
        for i in range(arguments.rounds):
            sequence = Client(server).call("POST", "/v1/sequences", {"displayName": f"round {i}"})["name"]
            for what, name, more in (("upload", sequence, ["256"]), ("download", f"{job}/outputs/depth", [])):
                disk = f"{write_durably(folder / 'file', int(more[0])):.0f}" if more else ""
                result = load_client(what, server.address, name, *more)
                print(f"| {what} | {result['bare']:.0f} | {disk} | {result['server']:.0f} | "
                      f"{result['server'] / result['bare']:.2f} |", flush=True)
            # Else each round would be measured with a fuller page cache, as a virtual machine gets it from its host.
            Client(server).call("DELETE", f"/v1/{sequence}")


def streams(folder, arguments):
    harness.synth(folder / "clip", 9, size="640x480")
    options = ("--max-streams", "3000", "--max-streams-of-client", "3000")
    print("| | median, ms | 99th percentile, ms | resident memory, MiB | KiB a stream | health |")
    print("|---|---|---|---|---|---|")
    with harness.Server(folder / "data", options=options, http=True) as server:
        sequence = upload(server, folder / "clip")
        done = Client(server).call("GET", "/v1/jobs")["jobs"][0]["name"]
        # Watched while it waits: for a job that takes long.
        client = Client(server)
        client.call("POST", "/v1/jobs", {"sequence": sequence, "options": {"method": "dolson"}})
        job = client.call("POST", "/v1/jobs", {"sequence": sequence})["name"]

        def measure(what, held, before):
            answer, memory = load_client("get", server.address, job, "2000"), resident_kib(server)
            each = f"{(memory - before) / held:.0f}" if held else ""
            print(f"| {what} | {answer['median']:.2f} | {answer['p99']:.2f} | {memory / 1024:.0f} | {each} | "
                  f"{'answers' if server.is_serving() else 'FAILS'} |", flush=True)
            return memory

        before = measure("nobody else", 0, 0)
        watchers = Held("watch", server, job, 1000)
        between = measure("1,000 watchers", 1000, before)
        readers = Held("stall", server, f"{done}/outputs/depth", 200)
        measure("and 200 readers that stop", 200, between)
        watchers.close()
        readers.close()
        measure("nobody else again", 0, 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("small", "queue", "transfer", "streams"))
    parser.add_argument("--rounds", type=int, default=5, help="of which medians are taken")
    parser.add_argument("--short", action="store_true", help="without the clip of 10 s")
    parser.add_argument("--watchers", type=int, default=450)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="depthtween_load_") as folder:
        {"small": small, "queue": queue, "transfer": transfer, "streams": streams}[arguments.what](pathlib.Path(folder), arguments)


if __name__ == "__main__":
    main()
