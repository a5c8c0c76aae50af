"""What clients asked for and what the server acknowledged. Every entry is written to a journal before the request leaves
and after its answer has come, so that nobody has to trust the server's memory to know what it owes.

Facts about one resource are written by one client thread; the driver reads them from another."""

import copy
import dataclasses
import json
import threading
import time


@dataclasses.dataclass
class Upload:
    acknowledged_bytes: int = 0


@dataclasses.dataclass
class Sequence:
    uploads: dict = dataclasses.field(default_factory=dict)  # by name
    clip: str = ""
    committed: bool = False
    ready: bool = False  # READY was seen
    delete_asked: bool = False
    deleted: bool = False


@dataclasses.dataclass
class Job:
    sequence: str
    result: str  # which reference its files must be
    succeeded: bool = False  # SUCCEEDED was seen
    cancel_asked: bool = False
    cancelled: bool = False
    retry_asked: bool = False
    retried: bool = False
    delete_asked: bool = False
    deleted: bool = False


class Ledger:

    def __init__(self, path):
        self._journal = open(path, "a", encoding="utf-8", buffering=1)
        self._lock = threading.Lock()
        self.sequences = {}
        self.jobs = {}
        self.acknowledged = {}  # operation -> how often
        self.lost = []

    def close(self):
        self._journal.close()

    def asks(self, operation, name, **facts):
        """Before the request leaves. `facts` become true of the resource now: from here on it may have happened."""
        self._note("asks", operation, name, facts)

    def acknowledges(self, operation, name, **facts):
        self._note("acknowledged", operation, name, facts)

    def makes(self, operation, name, record):
        """A resource was made, and its name came back."""
        with self._lock:
            (self.jobs if name.startswith("jobs/") else self.sequences)[name] = record
        self._note("acknowledged", operation, name, {})

    def stores(self, sequence, upload, acknowledged_bytes):
        with self._lock:
            self.sequences[sequence].uploads[upload] = Upload(acknowledged_bytes)
        self._note("acknowledged", "bytes", upload, {}, acknowledged_bytes=acknowledged_bytes)

    def loses(self, what):
        """Something that must not be."""
        with self._lock:
            self.lost.append(what)
            self._write(event="LOST", what=what)

    def state(self):
        """The facts as they are now, apart from what becomes true later."""
        with self._lock:
            return copy.deepcopy(self.sequences), copy.deepcopy(self.jobs)

    def marks(self, **what):
        with self._lock:
            self._write(**what)

    def _note(self, event, operation, name, facts, **more):
        with self._lock:
            record = self.jobs.get(name) or self.sequences.get(name)
            for fact, value in facts.items():
                setattr(record, fact, value)
            if event == "acknowledged":
                self.acknowledged[operation] = self.acknowledged.get(operation, 0) + 1
            self._write(event=event, operation=operation, name=name, **more)

    def _write(self, **what):
        self._journal.write(json.dumps({"time": round(time.time(), 3), **what}) + "\n")
