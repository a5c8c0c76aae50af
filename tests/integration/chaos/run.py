#!/usr/bin/env python3
"""Kills the server with SIGKILL at random moments, while clients upload (gRPC, tus, PUT), commit, create jobs, wait,
cancel, try again, fetch and delete, and holds it to what it acknowledged (ledger.py).

    DEPTHTWEEN_BIN=build/dev/bin python3 tests/integration/chaos/run.py --rounds 200

After every kill the database passes SQLite's integrity check, as it lies on the disk. After every restart each
acknowledged recording and job is there in a state that can follow, acknowledged bytes are committed, and what was
deleted stays deleted. At the end every job that nobody cancelled has SUCCEEDED and every result is bit for bit that of
`depthtween-core upsample` on the same recording; the data folder holds what the listing names and nothing else, and
`depthtween-server scrub` finds no damage. Exit code 1 if anything is lost; the journal then tells what was asked and
acknowledged until then. The short form of it is chaos_test.py; figures of long runs stand in RESULTS.md."""

import argparse
import collections
import contextlib
import json
import pathlib
import random
import shutil
import sqlite3
import sys
import tempfile
import threading
import time

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1]), str(pathlib.Path(__file__).resolve().parent)]

import harness  # pylint: disable=wrong-import-position
from clients import ENDED, RESULTS, Api, GrpcClient, PutClient, TusClient  # pylint: disable=wrong-import-position
from ledger import Ledger  # pylint: disable=wrong-import-position

CLIENTS = (GrpcClient, PutClient, TusClient, GrpcClient)


class Clip:
    """A recording, and what depthtween-core makes of it."""

    def __init__(self, folder, scene, frames):
        self.folder = folder / scene
        harness.synth(self.folder, frames, scene, size="64x48")
        self.files = {str(path.relative_to(self.folder)): path.read_bytes()
                      for path in self.folder.rglob("*") if path.is_file()}
        self.references = {}
        for result, (options, _) in RESULTS.items():
            out = folder / f"{scene}_{result}"
            harness.upsample(self.folder, out, *options)
            self.references[result] = harness.result_files(out)


def database_is_whole(data_dir, scratch):
    """SQLite's own check of a copy of the database, as the dead server left it. Returns what it says."""
    copy = pathlib.Path(scratch) / "copy"
    shutil.rmtree(copy, ignore_errors=True)
    copy.mkdir()
    for suffix in ("", "-wal"):
        with contextlib.suppress(FileNotFoundError):
            shutil.copy(data_dir / f"depthtween.sqlite{suffix}", copy)
    with contextlib.closing(sqlite3.connect(copy / "depthtween.sqlite")) as database:
        return (database.execute("PRAGMA integrity_check").fetchall() +
                database.execute("PRAGMA foreign_key_check").fetchall())


class Chaos:

    def __init__(self, rounds, seed, folder):
        self.rounds = rounds
        self.random = random.Random(seed)
        self.seed = seed
        self.folder = pathlib.Path(folder)
        self.ledger = Ledger(self.folder / "journal.jsonl")
        self.server = harness.Server(self.folder / "data", workers=2, http=True)
        self.api = Api(self.server)
        self.kills = collections.Counter()  # by what clients were doing
        self.kills_in_start = 0
        self.rounds_done = 0
        self.results_compared = 0

    def run(self, until_s=None):
        """Returns what was lost: nothing, it is hoped. With `until_s`, begins no round later than that."""
        clips = {scene: Clip(self.folder, scene, frames) for scene, frames in (("kick", 9), ("bounce", 17))}
        began = time.monotonic()
        ending = threading.Event()
        with self.server:
            clients = [kind(number, self.server, self.ledger, clips, self.folder, self.seed, ending)
                       for number, kind in enumerate(CLIENTS)]
            for client in clients:
                client.start()
            while self.rounds_done < self.rounds and (until_s is None or time.monotonic() - began < until_s):
                self.round(clients)
            ending.set()
            for client in clients:
                client.join(timeout=2 * harness.PATIENCE_S)
                if client.is_alive():
                    self.ledger.loses(f"{client.name} does not come to an end, in {client.phase}")
            self.check_end(clients[0])
            self.results_compared = sum(client.fetched for client in clients)
            self.check_folder(clips)
            code = self.server.stop()
            if code != 0:
                self.ledger.loses(f"SIGTERM ended the server with {code}")
            self.check_stopped()
            if self.ledger.lost:
                shutil.copy(self.server.log, self.folder / "server.log")
        self.ledger.close()
        return self.ledger.lost

    def round(self, clients):
        # Most moments soon after the start, some late: what goes on differs.
        time.sleep(0.05 * 60 ** self.random.random())
        doing = [client.phase for client in clients]
        self.server.kill()
        self.rounds_done += 1
        self.kills.update(doing)
        self.ledger.marks(event="kill", round=self.rounds_done, doing=doing)
        verdict = database_is_whole(self.server.data_dir, self.folder)
        if verdict != [("ok",)]:
            self.ledger.loses(f"round {self.rounds_done}: the database is damaged: {verdict}")
        owed = self.ledger.state()
        if self.random.random() < 0.15:
            self.kill_while_it_starts()
        self.server.start()
        self.check_restart(*owed)

    def kill_while_it_starts(self):
        ended = threading.Event()

        def kill_soon(before):
            harness.wait_for("the process", lambda: self.server.process is not before)
            time.sleep(self.random.random() * 0.2)
            self.server.process.kill()
            ended.set()

        killer = threading.Thread(target=kill_soon, args=(self.server.process,))
        killer.start()
        with contextlib.suppress(AssertionError):  # it ended before it was ready, as it should
            self.server.start()
        killer.join()
        self.server.process.wait()
        self.kills_in_start += 1

    def check_restart(self, sequences, jobs):
        """What was acknowledged before the kill is there. Clients go on meanwhile, so what they ask for now is looked
        up again before anything counts as lost."""
        lose = lambda what: self.ledger.loses(f"after restart {self.rounds_done}: {what}")
        there, jobs_there = self.api.list("sequences"), self.api.list("jobs")
        for name, owed in sequences.items():
            now, found = self.ledger.sequences[name], there.get(name)
            if found is None:
                if not now.delete_asked:
                    lose(f"{name} is gone")
            elif owed.deleted:
                lose(f"{name} was deleted and is back: {found['state']}")
            elif owed.ready and found["state"] != "STATE_READY":
                lose(f"{name} was READY and is {found['state']}")
            elif owed.committed and found["state"] not in ("STATE_VALIDATING", "STATE_READY"):
                lose(f"{name} was committed and is {found['state']}")
            elif not owed.committed:
                for upload, bytes_owed in owed.uploads.items():
                    record = self.api.get(upload)
                    if record is None:
                        if not now.delete_asked:
                            lose(f"{upload} is gone")
                    elif int(record.get("committedSize", 0)) < bytes_owed.acknowledged_bytes:
                        lose(f"{upload}: {bytes_owed.acknowledged_bytes} bytes were acknowledged, {record} is there")
        for name, owed in jobs.items():
            now, found = self.ledger.jobs[name], jobs_there.get(name)
            if found is None:
                if not now.delete_asked:
                    lose(f"{name} is gone")
                continue
            state = found["state"]
            if owed.deleted:
                lose(f"{name} was deleted and is back: {state}")
            elif state == "STATE_FAILED":
                lose(f"{name} FAILED: {found.get('error')}")
            elif owed.succeeded and state != "STATE_SUCCEEDED":
                lose(f"{name} had SUCCEEDED and is {state}")
            elif owed.cancelled and not now.retry_asked and state not in ("STATE_CANCELLING", "STATE_CANCELLED"):
                lose(f"{name} was cancelled and is {state}")
            elif not now.cancel_asked and state in ("STATE_CANCELLING", "STATE_CANCELLED"):
                lose(f"nobody cancelled {name}, which is {state}")

    def check_end(self, client):
        """Nobody kills any more, and all clients have ended."""
        for name, job in self.ledger.jobs.items():
            try:
                found = self.api.get(name)
                if job.deleted:
                    if found is not None:
                        self.ledger.loses(f"{name} was deleted and is there at the end")
                    continue
                found = harness.wait_for(f"the end of {name}", lambda name=name: self.ended(name))
                may_be_cancelled = job.cancel_asked and not job.retried
                if found["state"] == "STATE_SUCCEEDED":
                    client.folder.mkdir(parents=True, exist_ok=True)
                    client.fetch(name)
                elif not (may_be_cancelled and found["state"] == "STATE_CANCELLED"):
                    self.ledger.loses(f"{name} ended {found['state']}: {found.get('error')}, and {job}")
            except AssertionError as error:
                self.ledger.loses(f"at the end, {name}: {error}")

    def ended(self, name):
        job = self.api.get(name)
        if job is None:
            raise AssertionError("it is gone")
        return job if job["state"] in ENDED else None

    def check_folder(self, clips):
        """The data folder against the listing: nothing that no record names, nothing half-written."""
        lose = lambda what: self.ledger.loses(f"in the data folder: {what}")
        data = self.server.data_dir
        sequences, jobs = self.api.list("sequences"), self.api.list("jobs")
        for folder in ("tasks", "trash"):
            try:
                harness.wait_for(f"{folder}/ to be empty", lambda folder=folder: not any((data / folder).iterdir()))
            except AssertionError:
                lose(f"left in {folder}/: {[path.name for path in (data / folder).iterdir()]}")
        for kind, listed in (("sequences", sequences), ("jobs", jobs)):
            for path in (data / kind).iterdir():
                if f"{kind}/{path.name}" not in listed:
                    lose(f"{path.relative_to(data)} has no record")
        # A server that dies between a record's end and its files' leaves a folder, which is kept for some days.
        asked = {name.split("/")[1] for kind in (self.ledger.sequences, self.ledger.jobs)
                 for name, record in kind.items() if record.delete_asked}
        for path in (data / "quarantine").iterdir():
            if not any(path.name.endswith(f"-{name}") for name in asked):
                lose(f"{path.relative_to(data)} holds what nobody deleted")
        for path in data.rglob("*.tmp"):
            if "quarantine" not in path.parts:
                lose(f"{path.relative_to(data)} is rubbish")
        for name, found in sequences.items():
            if found["state"] != "STATE_READY":
                continue
            clip = clips[self.ledger.sequences[name].clip].files
            stored = harness.result_files(data / name)
            # Clients of gRPC put blanks at the end of camera.json.
            differing = [file for file in sorted(stored.keys() | clip.keys())
                         if stored.get(file, b"").rstrip() != clip.get(file, b"").rstrip()]
            if differing:
                lose(f"{name} is not what was uploaded: {differing}")
        for name, found in jobs.items():
            if found["state"] != "STATE_SUCCEEDED":
                continue
            job = self.ledger.jobs[name]
            reference = clips[self.ledger.sequences[job.sequence].clip].references[job.result]
            stored = {file: content for file, content in harness.result_files(data / name / "out").items()
                      if not file.startswith("interval_")}
            differing = [file for file in sorted(stored.keys() | reference.keys())
                         if stored.get(file) != reference.get(file)]
            if differing:
                lose(f"{name}/out is not what depthtween-core makes: {differing}")

    def check_stopped(self):
        verdict = database_is_whole(self.server.data_dir, self.folder)
        if verdict != [("ok",)]:
            self.ledger.loses(f"at the end the database is damaged: {verdict}")
        scrub = harness.run("depthtween-server", "scrub", "--data-dir", self.server.data_dir)
        if scrub.returncode != 0:
            self.ledger.loses(f"scrub ended with {scrub.returncode}: {scrub.stdout}{scrub.stderr}")

    def figures(self):
        return {"seed": self.seed, "rounds": self.rounds_done, "kills_while_starting": self.kills_in_start,
                "clients_doing_at_kill": dict(self.kills.most_common()),
                "acknowledged": dict(sorted(self.ledger.acknowledged.items())),
                "acknowledged_total": sum(self.ledger.acknowledged.values()),
                "sequences": len(self.ledger.sequences), "jobs": len(self.ledger.jobs),
                "results_compared": self.results_compared, "lost": len(self.ledger.lost)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=200)
    parser.add_argument("--seed", type=int, default=None, help="of the moments and of what clients do; printed")
    parser.add_argument("--seconds", type=float, default=None, help="begin no round later than that")
    parser.add_argument("--keep", help="folder for data, journal and log, kept; otherwise temporary")
    arguments = parser.parse_args()
    seed = random.SystemRandom().randrange(1 << 32) if arguments.seed is None else arguments.seed
    print(f"seed {seed}", flush=True)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="depthtween_chaos_") as temporary:
        folder = arguments.keep or temporary
        pathlib.Path(folder).mkdir(parents=True, exist_ok=True)
        chaos = Chaos(arguments.rounds, seed, folder)
        lost = chaos.run(arguments.seconds)
    for what in lost:
        print(f"LOST: {what}")
    print(json.dumps({**chaos.figures(), "seconds": round(time.monotonic() - began, 1)}, indent=1))
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
